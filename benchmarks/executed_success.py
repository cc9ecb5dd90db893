"""How often a scene of the treebank is executed, given the exact joint angles.

    python benchmarks/executed_success.py --data DIR --out FILE

Each scene's move (from the layout before to the layout after) is turned into the robot's
fourteen values by its joint table, and simulated. Of the 1,000 scenes four need two moves,
which are done one after the other, and two need none; no command belongs to these six.
What fails is listed.
"""

import dataclasses
import json
import multiprocessing
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from fusionnet.blocks import Layout, Move, Scene, apply, move_between, validate
from fusionnet.corpora import load_corpus
from fusionnet.errors import FusionNetError
from fusionnet.evaluation.intervals import wilson_interval
from fusionnet.files import write_whole
from fusionnet.provenance import provenance
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
        out: A file for the numbers; they are printed in any case.
    """

    data: Path = Path("../shared/data")
    scenes: int = 1000
    seed: int = 0
    robot: str = "nico"
    noise: float = 0.0
    workers: int = 1
    out: Path | None = None


@dataclass(frozen=True)
class Outcome:
    """What came out of one scene."""

    scene: int
    gripper: str
    success: bool
    reason: str
    error: float
    displacement: float
    simulated: float
    wall: float


Job = tuple[Scene, tuple[Move, ...]]


def moves_between(before: Layout, after: Layout) -> tuple[Move, ...]:
    """The moves that lead from one layout to another: none, one, or one for each moved block."""
    one = move_between(before, after)
    if one is not None:
        return (one,)
    gone = sorted(set(before.blocks) - set(after.blocks), key=lambda b: b.class_index)
    come = sorted(set(after.blocks) - set(before.blocks), key=lambda b: b.class_index)
    moves = [Move(b.cell, a.cell) for b, a in zip(gone, come, strict=True)]
    for order in permutations(moves):
        layout = before
        try:
            for move in order:
                layout = apply(move, layout)
                validate(layout)
        except FusionNetError:
            continue
        return order
    raise ValueError("no order of these moves can be done")


def jobs(config: Config) -> tuple[list[Job], list[int]]:
    """Scenes drawn by the seed, with their moves; and which of them need no move."""
    scenes = list(load_corpus("treebank", config.data).scenes.values())
    order = generator(config.seed, "scenes").permutation(len(scenes))[: config.scenes]
    drawn = [(scenes[i], moves_between(scenes[i].before, scenes[i].after)) for i in order]
    return [job for job in drawn if job[1]], [scene.id or 0 for scene, moves in drawn if not moves]


def run(job: Job, config: Config) -> Outcome:
    """Execute one scene."""
    scene, moves = job
    world = make_world(config.robot, layout=scene.before)
    rng = generator(config.seed, "joint noise", scene.id or 0)
    start, layout, episodes = time.perf_counter(), scene.before, []
    for move in moves:
        targets = joint_targets(config.robot, move)
        if config.noise:
            count = len(world.robot.joint_names)
            for part in (slice(0, count), slice(count + 1, -1)):
                noisy = targets[part] + np.deg2rad(rng.normal(0.0, config.noise, count))
                targets[part] = np.clip(noisy, *world.robot.joint_limits.T)
        layout = scene.after if move is moves[-1] else apply(move, layout)
        episodes.append(world.execute(targets, expected=layout))
    last = episodes[-1]
    return Outcome(
        scene=scene.id or 0,
        gripper="take" if moves[-1].ends_held else "drop" if moves[0].begins_held else "open",
        success=bool(last.success),
        reason=last.reason,
        error=float(np.nanmax(last.errors, initial=0.0)),
        displacement=max(e.displacement for e in episodes),
        simulated=sum(e.seconds for e in episodes),
        wall=time.perf_counter() - start,
    )


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Rates with 95 % intervals (Wilson), and medians, over all scenes."""
    simulated, wall = (np.array([getattr(o, k) for o in outcomes]) for k in ("simulated", "wall"))
    moved = np.array([o.displacement for o in outcomes])
    return {
        "n": len(outcomes),
        **share("success", [o.success for o in outcomes]),
        **share("no_neighbour_moved_2_mm", moved <= 2.0),
        "median_error_mm": round(float(np.median([o.error for o in outcomes])), 3),
        "median_displacement_mm": round(float(np.median(moved)), 3),
        "largest_displacement_mm": round(float(moved.max()), 3),
        "median_wall_s": round(float(np.median(wall)), 3),
        "worst_wall_s": round(float(wall.max()), 3),
        "times_real_time": round(float(simulated.sum() / wall.sum()), 1),
    }


def share(name: str, truths: Sequence[bool] | np.ndarray) -> dict[str, Any]:
    """A rate and its interval."""
    count, trials = int(np.sum(truths)), len(truths)
    bounds = [round(bound, 4) for bound in wilson_interval(count, trials)]
    return {name: round(count / trials, 4), f"{name}_95": bounds}


GRIPPERS = ("open", "take", "drop")


def by_gripper(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Success of moves, of takes (the hand ends closed) and of drops (it begins closed)."""
    kinds = {kind: [o.success for o in outcomes if o.gripper == kind] for kind in GRIPPERS}
    return {
        kind: {"n": len(truths), **share("success", truths)}
        for kind, truths in kinds.items()
        if truths
    }


def main(config: Config) -> None:
    begun = provenance()
    drawn, without_move = jobs(config)
    work = [(job, config) for job in drawn]
    if config.workers == 1:
        outcomes = [run(*arguments) for arguments in work]
    else:
        with multiprocessing.get_context("spawn").Pool(config.workers) as pool:
            outcomes = pool.starmap(run, work, chunksize=10)
    document = {
        "command": f"python benchmarks/executed_success.py --scenes {config.scenes} "
        f"--robot {config.robot} --noise {config.noise:g} --seed {config.seed}",
        "robot": config.robot,
        "noise_deg": config.noise,
        **summary(outcomes),
        "by_gripper": by_gripper(outcomes),
        "two_moves": sorted(scene.id or 0 for scene, moves in drawn if len(moves) > 1),
        "nothing_to_move": sorted(without_move),
        "failures": [dataclasses.asdict(o) for o in outcomes if not o.success],
        "neighbour_moved_2_mm": [dataclasses.asdict(o) for o in outcomes if o.displacement > 2.0],
        "seed": config.seed,
        **begun,
    }
    text = json.dumps(document, indent=1)
    print(text)
    if config.out is not None:
        write_whole(config.out, text + "\n")


if __name__ == "__main__":
    main(tyro.cli(Config))
