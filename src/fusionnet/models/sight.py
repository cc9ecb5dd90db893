"""What a detector is given to learn from, and what it sees."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from fusionnet.geometry import PinholeCamera
from fusionnet.models.heads.boxes import Boxes


@dataclass  # not frozen: Fabric moves its tensors between devices
class BoxBatch:
    """Pictures and their boxes: what a detector of boxes learns from.

    Attributes:
        images: Network inputs, 0 to 255.
        boxes: Ground truth of each picture, in pixels of the input.
    """

    images: UInt8[Tensor, "b h w 3"]
    boxes: list[Boxes]


@dataclass
class Batch(BoxBatch):
    """Pictures and everything that the heads of layouts learn from as well.

    Pictures of which boxes alone are learnt come last: the rows of the other tensors are
    those of the first pictures.

    Attributes:
        cells: Class of each of the 512 cells (16 is empty).
        visible: Pixels of the eye's picture in which the block of each cell is seen.
        offsets: How far each block stands beside its cell's middle, along x and y of the board
            (metres), and how far it is turned about the vertical (radians).
        holding: 1 where the gripper holds a block.
        matrix: Intrinsics for the input.
        camera_from_board: Pose of the camera.
        disturbance: Added to the true deviation when cells are projected while training.
    """

    cells: Int[Tensor, "n 512"]
    visible: Int[Tensor, "n 512"]
    offsets: Float[Tensor, "n 512 3"]
    holding: Float[Tensor, " n"]
    matrix: Float[Tensor, "n 3 3"]
    camera_from_board: Float[Tensor, "n 4 4"]
    disturbance: Float[Tensor, "n 7"]


@dataclass(frozen=True)
class Sight:
    """What the network sees in one picture.

    Attributes:
        boxes: Blocks that the cells explain and what else the box head detected, in pixels of
            the eye's picture; to be believed where a board is seen.
        detected: What the box head alone detected.
        cells: Probabilities of the 17 classes for each cell of the grid.
        holding: Probability that the gripper holds a block.
        corners: Where the corners of the checkerboard appear, in pixels of the eye's picture.
        camera: The eye as it was estimated; the board's frame stands for the robot's.
    """

    boxes: Boxes
    detected: Boxes
    cells: Float[np.ndarray, "8 8 8 17"]
    holding: float
    corners: Float[np.ndarray, "81 2"]
    camera: PinholeCamera


BOARD_SEEN = 0.5
"""Least `board_evidence` at which a board is taken to be seen: about as large a share of boards is
then overlooked as of other pictures is taken for one (`benchmarks/board_seen.py`)."""


def board_evidence(image: UInt8[np.ndarray, "h w 3"], corners: Float[np.ndarray, "81 2"]) -> float:
    """How clearly a checkerboard lies where its corners are said to be: 1 wholly, 0 by chance.

    Around every inner corner the four squares of a board are bright and dark by turns. What
    of the contrast there has that pattern counts; blocks hide some corners, and a picture
    without a board, or with one elsewhere, has it about as often reversed.

    Args:
        image: The picture, in whose pixels the corners are.
        corners: As `Sight.corners`.
    """
    grey = image.astype(np.float32).mean(axis=2)
    grid = corners.reshape(9, 9, 2)
    centers = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    places = np.rint(centers - 0.5).astype(int)
    inside = ((places >= 0) & (places < [image.shape[1], image.shape[0]])).all(axis=2)
    places = np.clip(places, 0, [image.shape[1] - 1, image.shape[0] - 1])
    squares = cv2.blur(grey, (3, 3))[places[..., 1], places[..., 0]]
    parity = np.indices((8, 8)).sum(axis=0) % 2 * 2.0 - 1.0
    signed = (squares - cv2.blur(squares, (3, 3), borderType=cv2.BORDER_REFLECT)) * parity
    contrast = np.abs(signed)
    if inside.mean() < 0.5 or contrast[inside].sum() < 1.0:
        return 0.0
    return float(abs(signed[inside].sum()) / contrast[inside].sum())


def padded_to_aspect(
    image: UInt8[np.ndarray, "h w 3"], size: tuple[int, int]
) -> UInt8[np.ndarray, "h2 w2 3"]:
    """The picture with a grey border at the right or the bottom, in the aspect of `size`.

    A picture whose sides are within 2 % of that aspect is left as it is.
    """
    height, width = image.shape[:2]
    right, bottom = border((width, height), size)
    if not right and not bottom:
        return image
    grey = (127, 127, 127)
    return cv2.copyMakeBorder(image, 0, bottom, 0, right, cv2.BORDER_CONSTANT, value=grey)


def border(picture: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
    """Pixels that a picture's width and height lack for the aspect of `size`."""
    width, height = picture
    wanted = size[0] / size[1]
    if abs(width / height / wanted - 1) <= 0.02:
        return 0, 0
    return max(round(height * wanted) - width, 0), max(round(width / wanted) - height, 0)
