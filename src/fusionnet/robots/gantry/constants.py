"""The gantry's joints, poses and workplace. Nothing here has a source but the task itself.

Its three joints slide along x, y and z, and their values are the coordinates of the pinch
over the middle of the board, in metres, so that everything can be checked in the head.
"""

from pathlib import Path

import numpy as np

from fusionnet.blocks.grid import BLOCK_SIZE, GRID
from fusionnet.robots import Robot, TableTop

JOINT_NAMES = ("gantry_x", "gantry_y", "gantry_z")
"""Forward, left and up."""

FINGER_POSITIONS = {"finger_left": (0.02, 0.0), "finger_right": (-0.02, 0.0)}
"""Open and closed on a block [m]."""

POSES = {
    "seed": np.array([0.0, 0.0, 0.12]),
    "prepare": np.array([0.0, 0.28, 0.31]),
    "ready": np.array([0.0, 0.0, 0.31]),
}
"""At `prepare` the hand hangs to the left of both eyes' views; at `ready` it is high above the
middle of the board."""

ROBOT = Robot(
    name="gantry",
    model_file=Path(__file__).with_name("model.xml"),
    joint_names=JOINT_NAMES,
    finger_positions=FINGER_POSITIONS,
    poses=POSES,
    board_origin=(-GRID * BLOCK_SIZE / 2, -GRID * BLOCK_SIZE / 2, 0.565),
    table_top=TableTop(height=0.565, x=(-0.3, 0.4), y=(-0.32, 0.32)),
    pinch_clearance=0.012,
    kinematics_source="made up for teaching",
)
"""The robot called `gantry`."""
