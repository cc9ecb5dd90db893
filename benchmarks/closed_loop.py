"""What looking again is worth: executed success with displaced blocks and with joint noise.

    python benchmarks/closed_loop.py --data DIR --episodes 60 --out results/closed-loop.json

Every condition is measured with and without the closed loop on the same commands, looks,
displacements and noise, of groups that no network was trained on.
"""

import json
import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import torch
import tyro

from fusionnet.evaluation.intervals import wilson_interval
from fusionnet.evaluation.policy import PolicyEvaluation, evaluate
from fusionnet.files import write_whole

CONDITIONS = ((0.0, 0.0), (5.0, 0.0), (10.0, 0.0), (0.0, 0.5), (0.0, 1.0), (10.0, 1.0))
"""Largest displacement [mm] and joint noise [degrees]."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to run.

    Attributes:
        data: Folder of the treebank.
        split: Part of it.
        episodes: A condition.
        out: The file of numbers.
        figure: The picture.
        redraw: Only draw what the file holds.
    """

    data: Path = Path("../shared/data/treebank")
    split: str = "test"
    episodes: int = 60
    out: Path = Path("results/closed-loop.json")
    figure: Path = Path("docs/images/closed-loop.png")
    redraw: bool = False


def main(config: Config) -> None:
    """Measure, keep and draw."""
    torch.set_num_threads(1)
    if not config.redraw:
        rows = []
        for displaced, noise in CONDITIONS:
            for closed in (False, True):
                numbers = evaluate(
                    PolicyEvaluation(
                        data=config.data,
                        split=config.split,
                        episodes=config.episodes,
                        closed_loop=closed,
                        displaced=displaced,
                        joint_noise=noise,
                    )
                ).as_json()
                rows.append(
                    {
                        "displaced_mm": displaced,
                        "joint_noise_deg": noise,
                        "closed_loop": closed,
                        "n": numbers["n"],
                        "executed_success": numbers["executed_success"],
                        "executed_success_95": numbers["executed_success_95"],
                        "outcomes": numbers["outcomes"],
                    }
                )
                print(json.dumps(rows[-1]), flush=True)
        commit = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
        )
        document = {
            "command": f"python benchmarks/closed_loop.py --episodes {config.episodes}",
            "commit": commit.stdout.strip(),
            "split": config.split,
            "machine": platform.processor() or platform.machine(),
            "rows": rows,
        }
        write_whole(config.out, json.dumps(document, indent=1) + "\n")
    draw(json.loads(config.out.read_text()), config.figure)


def draw(document: dict, file: Path) -> None:
    """Bars of success with and without the loop, with 95 % intervals (Wilson)."""
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.2, 3.6), layout="constrained")
    for offset, closed, color, label in (
        (-0.2, False, "#999999", "looks once"),
        (0.2, True, "#0072b2", "looks again"),
    ):
        rows = [row for row in document["rows"] if row["closed_loop"] is closed]
        rates = [100 * row["executed_success"] for row in rows]
        bounds = [
            wilson_interval(round(row["executed_success"] * row["n"]), row["n"]) for row in rows
        ]
        errors = [
            [rate - 100 * low for rate, (low, _) in zip(rates, bounds, strict=True)],
            [100 * high - rate for rate, (_, high) in zip(rates, bounds, strict=True)],
        ]
        places = [number + offset for number in range(len(rows))]
        axes.bar(places, rates, 0.38, color=color, label=label, yerr=errors, capsize=3)
    axes.set_xticks(
        range(len(rows)),
        [f"{row['displaced_mm']:g} mm\n{row['joint_noise_deg']:g}°" for row in rows],
    )
    axes.set_xlabel("largest displacement of blocks, standard deviation of joint noise")
    axes.set_ylabel("executed success [%]")
    axes.set_ylim(0, 105)
    axes.legend(loc="lower left")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main(tyro.cli(Config))
