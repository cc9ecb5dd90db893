"""Closing the loop: look again, and correct where the arm goes (thesis, chapter 8).

Twice a look tells how far a block is from where it is thought to be: before the grasp, where
the block stands, and above its place, where the hand carries it. Both times the detector's box
of the block is compared with the box that the estimated camera must see if the block were in
its place. Two numbers of a box (the middle of its sides, and its lower edge) are compared, and
how joints that err displace a carried block says which displacement they speak of.

What this cannot see: the hand itself before it holds a block.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import BLOCK_SIZE
from fusionnet.errors import InputError
from fusionnet.policy._answer import Answer
from fusionnet.policy._placing import STANDS_BESIDE, block_shift
from fusionnet.policy._policy import Policy
from fusionnet.policy._thesis import ThesisAnswer, ThesisPolicy
from fusionnet.robots import ArmKinematics
from fusionnet.simulation import World

JOINT_ERROR = np.radians(0.75)
"""Standard deviation of every joint's error that is expected of an arm that carries a block."""

LEAST_SHIFT = 0.002
"""Smaller displacements are within the error of looking, in metres."""


class Servo:
    """Looks again for one answer; `World.execute(answer, look_again=Servo(policy, answer))`.

    Args:
        policy: Whose left eye looks.
        answer: What the arm is doing.

    Raises:
        InputError: If the policy is the thesis's FusionNet.
    """

    def __init__(self, policy: Policy | ThesisPolicy, answer: Answer | ThesisAnswer) -> None:
        if isinstance(policy, ThesisPolicy) or isinstance(answer, ThesisAnswer):
            raise InputError(
                "The thesis's FusionNet cannot look again: it estimates no camera to compare its "
                "boxes with. Leave the closed loop out, or choose another checkpoint."
            )
        self.policy = policy
        self.source, self.target = answer.source_cell, answer.target_cell
        self.kind = int(answer.cells[tuple(self.source)][:-1].argmax())
        self.board_from_robot = policy.robot.robot_from_board[:3, :3].T
        jacobian = ArmKinematics(policy.robot).jacobian(np.asarray(answer.place.joint_angles))[:3]
        carried = JOINT_ERROR * self.board_from_robot @ jacobian
        self.spreads = {"grasp": STANDS_BESIDE, "place": STANDS_BESIDE / 4 + carried @ carried.T}

    def __call__(
        self, phase: Literal["grasp", "place"], rise: float, world: World
    ) -> Float[np.ndarray, "3"]:
        """How far to move the pinch, in the robot frame; see `simulation.LookAgain`."""
        sight = self.policy.detector.see(world.image("left_eye"))
        cell = self.source if phase == "grasp" else self.target
        place = (np.array(cell) + 0.5) * BLOCK_SIZE + np.array([0.0, 0.0, rise])
        shift = block_shift(sight, self.kind, place, self.spreads[phase])
        if shift is None or np.linalg.norm(shift) < LEAST_SHIFT:
            return np.zeros(3)
        moved: np.ndarray = self.board_from_robot.T @ (shift if phase == "grasp" else -shift)
        return moved
