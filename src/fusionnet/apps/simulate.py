"""`fusionnet simulate`: the arm alone, without networks: a move, given values, or a run again."""

import json
import platform
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from fusionnet import robots
from fusionnet.apps.cli import EXIT_MISSED, EXIT_REACHED
from fusionnet.apps.episode_file import RecordedEpisode, read_episode
from fusionnet.apps.setting import setting_of
from fusionnet.blocks import Cell, Layout, Move, apply, layout_to_json, move_between
from fusionnet.corpora import load_corpus
from fusionnet.errors import InputError
from fusionnet.simulation import Episode, World, joint_targets, make_world

RESULT_KIND = "fusionnet simulate"


def _says(default: str) -> Any:
    return tyro.conf.arg(help_behavior_hint=f"(default: {default})" if default else "")


@dataclass(frozen=True, kw_only=True)
class SimulateConfig:
    """What the arm is to do, where, and how to show it."""

    recording: Annotated[
        Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[RESULT]", help_behavior_hint="")
    ] = None
    """A recorded episode to do again: the folder of a run, its result.json, or what
    `fusionnet simulate --json` printed."""

    scene: Annotated[int | None, _says("the examples' first")] = None
    """Number of a scene of the corpus; its recorded move is done unless told otherwise."""

    corpus: str = "examples"
    """Where the scene comes from: "examples" (in this package) or "treebank" (with --data)."""

    data: Annotated[Path | None, _says("")] = None
    """Folder of the corpus's files."""

    layout: Annotated[Path | None, _says("")] = None
    """A file with a layout of your own, as JSON."""

    seed: Annotated[int | None, _says("")] = None
    """Seed of a random scene."""

    values: Annotated[
        tuple[float, ...] | None, tyro.conf.arg(metavar="V1 V2 ...", help_behavior_hint="")
    ] = None
    """What to do as numbers: joint angles and gripper (from 0.5: closed) of the grasp, then of
    the place; fourteen for NICO."""

    degrees: bool = False
    """Whether the angles among the values are degrees; otherwise radians."""

    move: Annotated[
        tuple[int, int, int, int, int, int] | None,
        tyro.conf.arg(metavar="X Y Z X Y Z", help_behavior_hint=""),
    ] = None
    """What to do as cells: where the block is, and where it is to go."""

    robot: Annotated[str | None, _says("nico, or the recording's")] = None
    """Who does it."""

    video: Annotated[Path | None, _says("")] = None
    """A film to write (mp4)."""

    viewer: bool = False
    """Watch it live in a window; needs a display."""

    json: bool = False
    """Print one JSON object instead of the summary."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """What is to be simulated.

    Attributes:
        origin: Where it came from, in words.
        robot: Who does it.
        layout: Before; random, by the seed, if None.
        targets: What to do.
        expected: The layout that should come out, if known.
        recorded: The episode that is done again, if it is one.
    """

    origin: str
    robot: str
    layout: Layout
    targets: np.ndarray
    expected: Layout | None
    recorded: RecordedEpisode | None = None


def simulate(config: SimulateConfig) -> int:
    """Let the simulated arm do a scene's move, given joint angles, or a recorded run again.

    No network is used. Without options it does the move of the examples' first scene, with the
    angles of the robot's joint table. Exit status 1 means that the world did not end as it should.
    """
    task = _task(config)
    recorded = task.recorded
    shifts = None if recorded is None else recorded.shifts
    world = make_world(task.robot, layout=task.layout, shifts=shifts)
    viewer = world.watch() if config.viewer else None
    begin = time.perf_counter()
    try:
        episode = world.execute(
            task.targets,
            task.expected,
            record=config.video is not None,
            look_again=recorded.look_again if recorded and recorded.corrections else None,
        )
    finally:
        if viewer is not None:
            viewer.close()
    wall = time.perf_counter() - begin
    if config.video is not None:
        episode.video(config.video)
    same_end = None if recorded is None else recorded.ends_like(episode)
    missed = episode.success is False or same_end is False
    status = EXIT_MISSED if missed else EXIT_REACHED
    document = {
        "kind": RESULT_KIND,
        "schema_version": 1,
        "origin": task.origin,
        "robot": task.robot,
        "success": episode.success,
        "verdict": _verdict(episode, same_end),
        "exit_status": status,
        "same_end_as_recorded": same_end,
        "layout_before": layout_to_json(task.layout),
        "layout_expected": None if task.expected is None else layout_to_json(task.expected),
        "episode": episode.as_json(),
        "wall_seconds": round(wall, 3),
        "times_real_time": round(episode.seconds / wall, 1),
        "video": None if config.video is None else str(config.video),
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("fusionnet", "mujoco", "numpy")},
        },
    }
    if config.json:
        print(json.dumps(document, allow_nan=False))
    else:
        _print_summary(world, task, episode, document)
    return status


def _task(config: SimulateConfig) -> Task:
    """What the options ask for.

    Raises:
        FusionNetError: If they contradict each other, or name what is not there.
    """
    if config.video is not None and config.video.suffix.lower() != ".mp4":
        raise InputError(f"The film {config.video} is an mp4; give it a name that ends in .mp4.")
    given = [n for n in ("recording", "values", "move") if getattr(config, n) is not None]
    if len(given) > 1:
        shown = " and ".join("RESULT" if n == "recording" else f"--{n}" for n in given)
        raise InputError(f"{shown} say two things to do; give one of them.")
    _check_used(config)
    if config.recording is not None:
        return _again(config, config.recording)
    name = config.robot or "nico"
    robot = robots.load(name)
    setting = setting_of(
        scene=config.scene,
        corpus=config.corpus,
        data=config.data,
        layout=config.layout,
        image=None,
        seed=config.seed,
    )
    layout = setting.layout
    if layout is None:
        layout = make_world(name, seed=config.seed or 0).layout
    expected: Layout | None = None
    if config.values is not None:
        targets = np.array(config.values, dtype=float)
        if config.degrees:
            angles = np.array([*robot.turning, False] * 2)
            if angles.shape == targets.shape:  # otherwise the world says what is wrong
                targets = np.where(angles, np.radians(targets), targets)
    elif config.move is not None:
        move = _move(config.move, layout)
        targets, expected = joint_targets(robot, move), apply(move, layout)
    else:
        if config.layout is not None or (config.scene is None and config.seed is not None):
            raise InputError("What is to be done there? Give --move X Y Z X Y Z, or --values.")
        scene = load_corpus(config.corpus, config.data).scenes[config.scene or 1]
        found = move_between(layout, scene.after)
        if found is None:
            raise InputError(
                f"Scene {config.scene} of {config.corpus} is not done by one move of one block; "
                "give --move or --values."
            )
        targets, expected = joint_targets(robot, found), scene.after
    return Task(
        origin=setting.origin, robot=name, layout=layout, targets=targets, expected=expected
    )


def _check_used(config: SimulateConfig) -> None:
    """Refuse options that would do nothing.

    Raises:
        InputError: If there are degrees without values, or a seed beside a scene or layout.
    """
    if config.degrees and config.values is None:
        raise InputError(
            "Without --values --degrees would do nothing; add --values, or leave --degrees out."
        )
    for option, place in (("--scene", config.scene), ("--layout", config.layout)):
        if place is not None and config.seed is not None:
            raise InputError(f"{option} and --seed name two worlds; give one of them.")


def _again(config: SimulateConfig, path: Path) -> Task:
    elsewhere = {
        "--scene": config.scene,
        "--layout": config.layout,
        "--seed": config.seed,
        "--corpus": None if config.corpus == SimulateConfig.corpus else config.corpus,
        "--data": config.data,
    }
    named = [option for option, value in elsewhere.items() if value is not None]
    if named:
        raise InputError(f"A recorded episode has its own scene; leave out {', '.join(named)}.")
    recorded = read_episode(path)
    if config.robot not in (None, recorded.robot):
        raise InputError(
            f"The episode in {path} was done by {recorded.robot!r}, not by {config.robot!r}."
        )
    robots.load(recorded.robot)
    return Task(
        origin=f"recorded in {path.name}",
        robot=recorded.robot,
        layout=recorded.before,
        targets=recorded.targets,
        expected=recorded.expected,
        recorded=recorded,
    )


def _move(cells: tuple[int, ...], layout: Layout) -> Move:
    source, target = Cell(*cells[:3]), Cell(*cells[3:])
    for cell in (source, target):
        if not cell.on_grid:
            raise InputError(f"The arm cannot reach {tuple(cell)}; x, y and z go from 0 to 7.")
    if layout.at(source) is None:
        raise InputError(f"There is no block at {tuple(source)} that could be moved.")
    held = layout.held
    if held is not None and held.cell != source:
        raise InputError(f"The hand holds the block at {tuple(held.cell)}; it can move only that.")
    if target != source and layout.at(target) is not None:
        raise InputError(f"The cell {tuple(target)} is occupied; give a free one.")
    return Move(source, target, begins_held=held is not None)


def _verdict(episode: Episode, same_end: bool | None) -> str:
    head = {True: "Reached", False: "Missed", None: "Done"}[episode.success]
    text = f"{head}: {episode.reason[:1].lower()}{episode.reason[1:]}"
    if same_end is None:
        return text
    return text + (
        " It ended as it was recorded." if same_end else " It did not end as it was recorded."
    )


def _print_summary(world: World, task: Task, episode: Episode, document: dict[str, Any]) -> None:
    count = len(world.robot.joint_names)
    print(f"scene   {task.origin}; {task.robot}")
    for name, part in (
        ("grasp", episode.targets[: count + 1]),
        ("place", episode.targets[-count - 1 :]),
    ):
        angles = [
            world.robot.with_unit(joint, value)
            for joint, value in zip(world.robot.joint_names, part[:-1], strict=True)
        ]
        print(f"{name}   {'  '.join(angles)}  {'closed' if part[-1] >= 0.5 else 'open'}")
    print(f"did     {document['verdict']}")
    print(f"        {episode.seconds:.1f} s, {document['times_real_time']} times real time")
    print(f"model   {episode.grasp_model}")
    if document["video"] is not None:
        print(f"film    {document['video']}")
