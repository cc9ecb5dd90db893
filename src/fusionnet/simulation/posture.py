"""All joints of a robot in one vector: arm, fingers, and whatever stays where it is."""

import mujoco
import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import Layout
from fusionnet.robots import Robot


def robot_posture(model: mujoco.MjModel, robot: Robot, layout: Layout) -> Float[np.ndarray, " q"]:
    """The robot as it waits: hand away from the eyes' views, or around the block that it holds."""
    held = layout.held
    arm = robot.poses["prepare"] if held is None else robot.joint_angles(held.cell)
    return posture(model, robot, arm, closed=1.0 if held is not None else 0.0)


def posture(
    model: mujoco.MjModel, robot: Robot, joint_angles: Float[np.ndarray, " n"], closed: float
) -> Float[np.ndarray, " q"]:
    """All joint positions, the arm at `joint_angles` and the fingers `closed` (0 to 1)."""
    positions = model.qpos0.copy()
    for name, angle in zip(robot.joint_names, joint_angles, strict=True):
        positions[model.joint(name).qposadr[0]] = angle
    for name, (opened, shut) in robot.finger_positions.items():
        positions[model.joint(name).qposadr[0]] = opened + closed * (shut - opened)
    return positions
