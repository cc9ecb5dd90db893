"""How exact joint angles must be: executed success against the error of every joint.

    python benchmarks/error_to_success.py --data DIR --scenes 80 --out FOLDER

Runs `executed_success` for each noise, writes FOLDER/error_to_success.json, and draws it
beside the numbers of the feasibility study from which the aim of the networks was taken.
"""

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import matplotlib
import tyro
from executed_success import Config as Scenes
from executed_success import run, summary

from fusionnet.blocks import move_between
from fusionnet.corpora import load_corpus
from fusionnet.randomness import generator

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
        out: Folder for the numbers and the picture.
        redraw: Only draw what the folder's file holds.
    """

    data: Path = Path("../shared/data")
    scenes: int = 80
    noises: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
    seed: int = 0
    out: Path = Path("docs/images")
    redraw: bool = False


def measure(config: Config, noise: float) -> dict[str, Any]:
    """One point of the curve."""
    scenes = load_corpus("treebank", config.data).scenes.values()
    moves = [(scene, move_between(scene.before, scene.after)) for scene in scenes]
    executable = [(scene, move) for scene, move in moves if move is not None]
    order = generator(config.seed, "scenes").permutation(len(executable))[: config.scenes]
    options = Scenes(data=config.data, seed=config.seed, noise=noise)
    outcomes = [run((*executable[i], options)) for i in order]
    return {"noise_deg": noise, **summary(outcomes)}


def draw(points: Sequence[dict[str, Any]], file: Path) -> None:
    """The curve, with a 95 % interval (Wilson), beside the study's."""
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
    noises = [p["noise_deg"] for p in points]
    rates = [100 * p["success"] for p in points]
    bounds = [wilson(p["success"], p["n"]) for p in points]
    axes.fill_between(
        noises, [100 * b[0] for b in bounds], [100 * b[1] for b in bounds], alpha=0.2, lw=0
    )
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


def wilson(rate: float, count: int, z: float = 1.96) -> tuple[float, float]:
    """Interval of a proportion (Wilson, 1927)."""
    middle = (rate + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * (rate * (1 - rate) / count + (z / (2 * count)) ** 2) ** 0.5
    return max(0.0, middle - half), min(1.0, middle + half)


def main(config: Config) -> None:
    results = config.out / "error_to_success.json"
    if not config.redraw:
        commit = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
        )
        points = [measure(config, noise) for noise in config.noises]
        document = {
            "points": points,
            "seed": config.seed,
            "commit": commit.stdout.strip(),
            "cores": os.cpu_count(),
            "mujoco": version("mujoco"),
        }
        results.write_text(json.dumps(document, indent=1) + "\n")
    draw(json.loads(results.read_text())["points"], config.out / "error_to_success.png")


if __name__ == "__main__":
    main(tyro.cli(Config))
