"""How exact joint angles must be: executed success against the error of every joint.

    python benchmarks/error_to_success.py --data DIR

Runs `executed_success` for each noise on the same scenes, and draws the curve beside the numbers
of the feasibility study from which the aim of the networks was taken.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import tyro
from executed_success import Config as Scenes
from executed_success import jobs, run, summary

from fusionnet.files import write_whole
from fusionnet.provenance import provenance

FINDINGS = {0.25: 0.97, 0.5: 0.97, 1.0: 0.55, 2.0: 0.28}
"""The feasibility study: 60 random scenes with stacks up to three, gate 13 mm."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to run.

    Attributes:
        data: Folder of the treebank.
        scenes: Scenes a point; the same ones for each.
        noises: Standard deviations of the error of every joint, in degrees.
        seed: Which scenes, and the noise.
        robot: Who acts.
        out: The file of numbers.
        figure: The picture.
        redraw: Only draw what the file holds.
    """

    data: Path = Path("../shared/data")
    scenes: int = 200
    noises: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
    seed: int = 0
    robot: str = "nico"
    out: Path = Path("results/error-to-success.json")
    figure: Path = Path("docs/images/error_to_success.png")
    redraw: bool = False


def measure(config: Config) -> dict[str, Any]:
    """The points of the curve, and where they come from."""
    points, begun = [], provenance()
    options = Scenes(data=config.data, scenes=config.scenes, seed=config.seed, robot=config.robot)
    drawn, _ = jobs(options)
    for noise in config.noises:
        noisy = replace(options, noise=noise)
        points.append({"noise_deg": noise, **summary([run(job, noisy) for job in drawn])})
        print(json.dumps(points[-1]), flush=True)
    return {
        "command": f"python benchmarks/error_to_success.py --scenes {config.scenes} "
        f"--robot {config.robot} --seed {config.seed}",
        "points": points,
        "seed": config.seed,
        **begun,
    }


def draw(points: Sequence[dict[str, Any]], file: Path) -> None:
    """The curve, with a 95 % interval (Wilson), beside the study's."""
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
    noises = [p["noise_deg"] for p in points]
    bounds = [[100 * bound for bound in p["success_95"]] for p in points]
    axes.fill_between(noises, *zip(*bounds, strict=True), alpha=0.2, lw=0)
    rates = [100 * p["success"] for p in points]
    axes.plot(noises, rates, "o-", label=f"treebank, {points[0]['n']} scenes a point")
    axes.plot(
        list(FINDINGS), [100 * r for r in FINDINGS.values()], "s--", label="feasibility study"
    )
    axes.set_xlabel("standard deviation of the error of each joint [degrees]")
    axes.set_ylabel("executed success [%]")
    axes.set_ylim(0, 102)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=110)


def main(config: Config) -> None:
    if not config.redraw:
        write_whole(config.out, json.dumps(measure(config), indent=1) + "\n")
    draw(json.loads(config.out.read_text())["points"], config.figure)


if __name__ == "__main__":
    main(tyro.cli(Config))
