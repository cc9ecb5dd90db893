"""NICO's joints, poses and workplace, each with its source.

Kinematics: the URDF of NICO (Knowledge Technology, University of Hamburg; Kerzel et al.,
"NICO: Neuro-Inspired COmpanion", RO-MAN 2017), rewritten as `model.xml`. The left arm
reaches, as in thesis section 3.3.2. Where the board lies, the pinch point and the eyes are
not in any source: they were chosen so that the left hand reaches all 512 cells within 30
degrees of vertical and both eyes see the whole grid.
"""

from pathlib import Path

import numpy as np

from fusionnet.robots import Robot, TableTop

JOINT_NAMES = (
    "l_shoulder_z",
    "l_shoulder_y",
    "l_arm_x",
    "l_elbow_y",
    "l_wrist_z",
    "l_wrist_x",
)
"""The left arm from the shoulder to the wrist: URDF."""

FINGER_POSITIONS = {
    "l_thumb_x": (-0.1, -0.57),
    "l_thumb_1st_x": (0.0, 0.0),
    "l_thumb_2nd_x": (0.0, 0.0),
    "l_indexfingers_x": (-0.26, -0.51),
    "l_indexfinger_1st_x": (0.0, 0.0),
    "l_indexfinger_2nd_x": (0.0, 0.0),
    "l_ringfingers_x": (-0.26, -0.52),
    "l_ringfinger_1st_x": (0.0, 0.0),
    "l_ringfinger_2nd_x": (0.0, 0.0),
}
"""Open and closed [rad], on the hand's assumed shape: closed, the fingertips touch a block whose
top is 12 mm below the pinch; open, they stay clear of the table at every cell."""

HEAD_ANGLES = {"head_z": np.radians(10.0), "head_y": np.radians(38.0)}
"""The head looks left and down, so that both eyes see all eight levels of the grid."""

RESTING_ANGLES = {
    "r_shoulder_z": 0.0,
    "r_shoulder_y": 0.0,
    "r_arm_x": 0.0,
    "r_elbow_y": 0.0,
    "r_wrist_z": 0.0,
    "r_wrist_x": 0.0,
    "r_thumb_x": -0.3,
    "r_thumb_1st_x": -0.3,
    "r_thumb_2nd_x": -0.3,
    "r_indexfingers_x": -0.3,
    "r_indexfinger_1st_x": -0.3,
    "r_indexfinger_2nd_x": -0.3,
    "r_ringfingers_x": -0.3,
    "r_ringfinger_1st_x": -0.3,
    "r_ringfinger_2nd_x": -0.3,
}
"""The right arm hangs at the side: chosen by eye."""

POSES = {
    "seed": np.radians([-40.0, 51.0, 132.0, 67.0, 60.0, -37.0]),
    "prepare": np.radians([16.0, 41.0, 124.0, 63.0, 52.0, -46.0]),
    "ready": np.radians([-35.4, 28.4, 146.4, 63.5, 64.3, -44.7]),
}
"""Searches start at `seed`; at `prepare` the hand is outside both eyes' views; at `ready` it is
above the middle of the board and clear of all eight levels (thesis figure 3.7)."""

ROBOT = Robot(
    name="nico",
    model_file=Path(__file__).with_name("model.xml"),
    joint_names=JOINT_NAMES,
    finger_positions=FINGER_POSITIONS,
    head_angles=HEAD_ANGLES,
    resting_angles=RESTING_ANGLES,
    poses=POSES,
    board_origin=(0.27685, -0.02515, 0.565),
    table_top=TableTop(height=0.565, x=(0.13, 0.69), y=(-0.32, 0.48)),
    pinch_clearance=0.012,
    kinematics_source="NICO URDF, Knowledge Technology, University of Hamburg",
)
"""The robot called `nico`."""
