"""Closing the loop: look again, and correct where the arm goes (thesis, chapter 8).

Twice a look tells how far a block is from where it is thought to be: before the grasp, where
the block stands, and above its place, where the hand carries it. Both times the detector's box
of the block is compared with the box that the estimated camera must see if the block were in
its place; what is between them is a displacement at the block's height, for two numbers of a
box (the middle of its sides, and its lower edge) are two of the block's.

What this cannot see: an error of the hand's height, and the hand itself before it holds a block.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import BLOCK_SIZE, Cell
from fusionnet.policy._answer import Answer
from fusionnet.policy._placing import block_shift
from fusionnet.policy._policy import Policy
from fusionnet.simulation import World

LEAST_SHIFT = 0.002
"""Smaller displacements are within the error of looking, in metres."""


class Servo:
    """Looks again for one answer; `World.execute(answer, look_again=Servo(policy, answer))`.

    Args:
        policy: Whose left eye looks.
        answer: What the arm is doing.
    """

    def __init__(self, policy: Policy, answer: Answer) -> None:
        self.policy = policy
        self.source = Cell.from_index(int(answer.source.argmax()))
        self.target = Cell.from_index(int(answer.target.argmax()))
        self.kind = int(answer.cells[tuple(self.source)][:-1].argmax())

    def __call__(
        self, phase: Literal["grasp", "place"], rise: float, world: World
    ) -> Float[np.ndarray, "3"]:
        """How far to move the pinch, in the robot frame; see `simulation.LookAgain`."""
        sight = self.policy.detector.see(world.image("left_eye"))
        cell = self.source if phase == "grasp" else self.target
        place = (np.array(cell) + 0.5) * BLOCK_SIZE + np.array([0.0, 0.0, rise])
        shift = block_shift(sight, self.kind, place)
        if shift is None or np.linalg.norm(shift) < LEAST_SHIFT:
            return np.zeros(3)
        along = np.append(shift if phase == "grasp" else -shift, 0.0)
        moved: np.ndarray = self.policy.robot.robot_from_board[:3, :3] @ along
        return moved
