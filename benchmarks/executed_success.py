"""How often a scene of the treebank is executed, given the exact joint angles.

    python benchmarks/executed_success.py --data DIR --scenes 300

Each scene's one move (from the layout before to the layout after) is turned into the
robot's fourteen values by its joint table, and simulated. What fails is listed.
"""

import dataclasses
import json
import multiprocessing
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from fusionnet.blocks import Move, Scene, move_between
from fusionnet.corpora import load_corpus
from fusionnet.randomness import generator
from fusionnet.simulation import joint_targets, make_world


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to run.

    Attributes:
        data: Folder of the treebank.
        scenes: How many scenes; all if as many as there are.
        seed: Which scenes, and the noise.
        robot: Who acts.
        noise: Standard deviation of an error added to every joint angle, in degrees.
        workers: Processes.
    """

    data: Path = Path("../shared/data")
    scenes: int = 300
    seed: int = 0
    robot: str = "nico"
    noise: float = 0.0
    workers: int = 1


@dataclass(frozen=True)
class Outcome:
    """What came out of one scene."""

    scene: int
    blocks: int
    success: bool
    reason: str
    error: float
    displacement: float
    simulated: float
    wall: float


def run(job: tuple[Scene, Move, Config]) -> Outcome:
    """Execute one scene."""
    scene, move, config = job
    world = make_world(config.robot, layout=scene.before)
    targets = joint_targets(config.robot, move)
    if config.noise:
        rng = generator(config.seed, "joint noise", scene.id or 0)
        count = len(world.robot.joint_names)
        for part in (slice(0, count), slice(count + 1, -1)):
            noisy = targets[part] + np.deg2rad(rng.normal(0.0, config.noise, count))
            targets[part] = np.clip(noisy, *world.robot.joint_limits.T)
    start = time.perf_counter()
    episode = world.execute(targets, expected=scene.after)
    return Outcome(
        scene=scene.id or 0,
        blocks=len(scene.before.blocks),
        success=bool(episode.success),
        reason=episode.reason,
        error=float(np.nanmax(episode.errors, initial=0.0)),
        displacement=episode.displacement,
        simulated=episode.seconds,
        wall=time.perf_counter() - start,
    )


def summary(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Rates and medians over all scenes."""
    simulated, wall = (np.array([getattr(o, k) for o in outcomes]) for k in ("simulated", "wall"))
    moved = np.array([o.displacement for o in outcomes])
    return {
        "n": len(outcomes),
        "success": round(float(np.mean([o.success for o in outcomes])), 4),
        "no_neighbour_moved_2_mm": round(float(np.mean(moved <= 2.0)), 4),
        "median_error_mm": round(float(np.median([o.error for o in outcomes])), 3),
        "median_displacement_mm": round(float(np.median(moved)), 3),
        "median_wall_s": round(float(np.median(wall)), 3),
        "worst_wall_s": round(float(wall.max()), 3),
        "times_real_time": round(float(simulated.sum() / wall.sum()), 1),
    }


def main(config: Config) -> None:
    scenes = list(load_corpus("treebank", config.data).scenes.values())
    moves = [(scene, move_between(scene.before, scene.after)) for scene in scenes]
    executable = [(scene, move, config) for scene, move in moves if move is not None]
    odd = [scene.id for scene, move in moves if move is None]
    order = generator(config.seed, "scenes").permutation(len(executable))[: config.scenes]
    jobs = [executable[i] for i in order]
    if config.workers == 1:
        outcomes = [run(job) for job in jobs]
    else:
        with multiprocessing.get_context("spawn").Pool(config.workers) as pool:
            outcomes = pool.map(run, jobs, chunksize=10)
    failures = [dataclasses.asdict(o) for o in outcomes if not o.success]
    report = {"robot": config.robot, "noise_deg": config.noise, **summary(outcomes)}
    print(json.dumps({**report, "not_one_move": odd, "failures": failures}, indent=1))


if __name__ == "__main__":
    main(tyro.cli(Config))
