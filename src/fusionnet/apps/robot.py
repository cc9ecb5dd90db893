"""`fusionnet robot table`: the command that makes a cell-to-joint table; `fusionnet robot look`."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fusionnet import robots
from fusionnet.blocks import read_layout
from fusionnet.errors import InputError
from fusionnet.files import write_whole
from fusionnet.simulation import make_world

CAMERAS = ("left_eye", "right_eye", "external")
LARGEST = 4096
"""Of a picture's sides, in pixels."""


@dataclass(frozen=True, kw_only=True)
class TableConfig:
    """Which robot, and how carefully."""

    robot: str = "nico"
    """Name of the robot."""

    rounds: int = 60
    """Alternations of smoothing the table and solving every cell again."""

    check: bool = False
    """Only measure the table that the package holds, and write nothing."""

    def __post_init__(self) -> None:
        """Refuse rounds of a table that is not made."""
        if self.check and self.rounds != TableConfig.rounds:
            raise InputError(
                "With --check no table is made and --rounds would do nothing; leave one out."
            )


def table(config: TableConfig) -> dict[str, Any]:
    """Make the table of joint angles for each of the 512 cells, and measure it.

    Writes it into the robot's folder and prints its qualities as JSON.
    """
    robot = robots.load(config.robot)
    if config.check:
        angles = robot.joint_table
    else:
        angles = robots.make_joint_table(robot, rounds=config.rounds)
        robots.save_joint_table(robot, angles)
    quality = robots.measure_joint_table(robot, angles)

    def readable(values: np.ndarray) -> list[float]:
        rounded = np.where(robot.turning, np.round(np.degrees(values), 3), np.round(values, 6))
        return [float(value) for value in rounded]

    return {
        "robot": robot.name,
        "file": str(robot.joint_table_file),
        "written": not config.check,
        "largest_position_error_m": quality.position_error,
        "largest_tilt_degrees": round(float(np.degrees(quality.tilt)), 3),
        "joints": list(robot.joint_names),
        "units": ["degrees" if turns else "m" for turns in robot.turning],
        "smallest_distance_to_a_limit": readable(quality.limit_margin),
        "largest_step_between_adjacent_cells": readable(quality.adjacent),
        "mean_distance_to_a_cubic": readable(quality.cubic_residual),
        "largest_distance_to_a_cubic": readable(quality.largest_cubic_residual),
    }


@dataclass(frozen=True, kw_only=True)
class LookConfig:
    """Which robot, before which blocks."""

    out: Path
    """Folder for left_eye.png, right_eye.png and external.png."""

    robot: str = "nico"
    """Name of the robot."""

    layout: Path | None = None
    """Blocks to look at, as `--layout` of `fusionnet run`; random ones by default."""

    seed: int = 0
    """Of the random blocks."""

    size: tuple[int, int] = (960, 540)
    """Width and height, in pixels."""

    def __post_init__(self) -> None:
        """Refuse pictures that cannot be drawn, and a seed of blocks that are given."""
        if self.layout is not None and self.seed != LookConfig.seed:
            raise InputError("--layout and --seed name two worlds; give one of them.")
        if not 1 <= min(self.size) <= max(self.size) <= LARGEST:
            raise InputError(
                f"A picture's sides are 1 to {LARGEST} pixels; received {self.size[0]} x "
                f"{self.size[1]}."
            )


def look(config: LookConfig) -> dict[str, Any]:
    """Draw what a robot's eyes see, and the robot, before it does anything."""
    layout = None if config.layout is None else read_layout(config.layout)
    world = make_world(robot=config.robot, seed=config.seed, layout=layout)
    files = {}
    for camera in CAMERAS:
        drawn = io.BytesIO()
        Image.fromarray(world.image(camera, config.size)).save(drawn, "PNG")
        files[camera] = config.out / f"{camera}.png"
        write_whole(files[camera], drawn.getvalue())
    return {"robot": config.robot, "files": {name: str(file) for name, file in files.items()}}
