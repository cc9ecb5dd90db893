"""`fusionnet robot table`: the committed command that makes a robot's cell-to-joint table."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusionnet import robots


@dataclass(frozen=True, kw_only=True)
class TableConfig:
    """Which robot, and how carefully."""

    robot: str = "nico"
    """Name of the robot."""

    rounds: int = 60
    """Alternations of smoothing the table and solving every cell again."""

    check: bool = False
    """Only measure the table that the package holds, and write nothing."""


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
    slides = np.array([name in robot.sliding_joints for name in robot.joint_names])

    def readable(values: np.ndarray) -> list[float]:
        rounded = np.where(slides, np.round(values, 6), np.round(np.degrees(values), 3))
        return [float(value) for value in rounded]

    return {
        "robot": robot.name,
        "file": str(robot.joint_table_file),
        "written": not config.check,
        "largest_position_error_m": quality.position_error,
        "largest_tilt_degrees": round(float(np.degrees(quality.tilt)), 3),
        "joints": list(robot.joint_names),
        "units": ["m" if slide else "degrees" for slide in slides],
        "smallest_distance_to_a_limit": readable(quality.limit_margin),
        "largest_step_between_adjacent_cells": readable(quality.adjacent),
        "mean_distance_to_a_cubic": readable(quality.cubic_residual),
        "largest_distance_to_a_cubic": readable(quality.largest_cubic_residual),
    }
