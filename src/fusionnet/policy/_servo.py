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

from fusionnet.blocks import BLOCK_SIZE, Block, Cell, Color, Shape
from fusionnet.geometry import PinholeCamera, PointBehindCameraError
from fusionnet.models.retinanet import Sight
from fusionnet.policy._answer import Answer
from fusionnet.policy._policy import Policy
from fusionnet.simulation import World
from fusionnet.simulation.tabletop import BlockPoses, drawn_corners

FARTHEST_SHIFT = 0.022
"""A block seen farther from its place is another block, in metres."""

LEAST_SHIFT = 0.002
"""Smaller displacements are within the error of looking, in metres."""

LEAST_SCORE = 0.3
"""Of a detection that is believed."""

WIDTHS = (0.85, 1.18)
"""Widths of the box, as shares of the expected: outside, something hides a part of the block."""

_STEP = 1e-3
_COLORS = tuple(Color)
_SHAPES = tuple(Shape)


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


def block_shift(
    sight: Sight, kind: int, place: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "2"] | None:
    """How far a block is from where it should be, along x and y of the board (metres).

    Args:
        sight: Its detections are compared.
        kind: Class of the block.
        place: Middle of the block where it should be, in the board frame (metres).

    Returns:
        None if it is not seen near there, or only a part of it.
    """
    camera = sight.camera
    try:
        expected = _marks(camera, kind, place)
        slopes = [
            (_marks(camera, kind, place + step) - expected)[:2] / 1e-3
            for step in np.eye(3)[:2] * 1e-3
        ]
    except PointBehindCameraError:
        return None
    jacobian = np.array(slopes).T
    detected = sight.detected
    believed = (detected.classes == kind) & (detected.scores >= LEAST_SCORE)
    boxes = detected.xyxy[believed].double().numpy()
    if not len(boxes):
        return None
    marks = np.column_stack([boxes[:, [0, 2]].mean(axis=1), boxes[:, 3], boxes[:, 2] - boxes[:, 0]])
    shifts = np.linalg.solve(jacobian, (marks - expected)[:, :2].T).T
    distances = np.linalg.norm(shifts, axis=1)
    nearest = int(distances.argmin())
    width = marks[nearest, 2] / expected[2]
    if distances[nearest] > FARTHEST_SHIFT or not WIDTHS[0] <= width <= WIDTHS[1]:
        return None
    shift: np.ndarray = shifts[nearest]
    return shift


def _marks(
    camera: PinholeCamera, kind: int, place: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Middle of the sides, lower edge, and width of a block's box, in pixels of the picture."""
    shape = _SHAPES[kind // len(_COLORS)]
    block = Block(_COLORS[kind % len(_COLORS)], shape, Cell(0, 0, 0))
    corners = drawn_corners((block,), BlockPoses(place[None], np.eye(3)[None]))[0]
    pixels = camera.project(corners) + 0.5  # boxes speak of edges
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return np.array([(low[0] + high[0]) / 2, high[1], high[0] - low[0]])
