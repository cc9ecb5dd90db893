"""Which part of a picture the thesis's networks see: where blocks can be placed (thesis 6.1).

A picture is cropped to that region, in its own aspect, with the thesis's crop factors. The thesis
takes the region from the boxes; ours is where the grid appears, which needs no label and is the
same for training and inference.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks import BLOCK_SIZE, GRID
from fusionnet.dataset.frame import PictureFrame
from fusionnet.models.sight import border, padded_to_aspect
from fusionnet.views import crop_around

Crop = tuple[int, int, int, int]
"""Left, top, right and bottom, in pixels of a picture."""


class Placement(NamedTuple):
    """The part of a picture that a network sees, and how it becomes the network's input.

    Attributes:
        part: What is kept of the picture.
        frame: Size and aspect of the input; what lacks of the aspect becomes a grey border.
    """

    part: Crop
    frame: PictureFrame

    @property
    def scale(self) -> Float[np.ndarray, "2"]:
        """Pixels of the input a pixel of the picture, across and down."""
        left, top, right, bottom = self.part
        kept = (right - left, bottom - top)
        padded = np.array(kept) + border(kept, self.frame.eye_size)
        return np.array(self.frame.input_size) / padded

    def picture(self, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h2 w2 3"]:
        """The network's input."""
        left, top, right, bottom = self.part
        part = padded_to_aspect(image[top:bottom, left:right], self.frame.eye_size)
        how = cv2.INTER_AREA if self.scale[0] < 1 else cv2.INTER_LINEAR
        return cv2.resize(part, self.frame.input_size, interpolation=how)

    def to_input(self, boxes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
        """Boxes of the picture in pixels of the input."""
        return (boxes - np.tile(self.part[:2], 2)) * np.tile(self.scale, 2)

    def to_picture(self, boxes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
        """Boxes of the input in pixels of the picture."""
        return boxes / np.tile(self.scale, 2) + np.tile(self.part[:2], 2)


def placement_crop(
    matrix: Float[np.ndarray, "3 3"],
    camera_from_board: Float[np.ndarray, "4 4"],
    size: tuple[int, int],
) -> Crop:
    """The part of a picture in which the grid appears; all of it if the camera is too near.

    Args:
        matrix: Intrinsics of the picture, whole numbers at the centres of pixels.
        camera_from_board: Pose of its camera.
        size: Width and height of the picture, in pixels.
    """
    ends = (0.0, GRID * BLOCK_SIZE)
    corners = np.array([[x, y, z, 1.0] for x in ends for y in ends for z in ends])
    in_camera = (corners @ camera_from_board.T)[:, :3]
    if (in_camera[:, 2] <= 0).any():
        return 0, 0, *size
    projected = in_camera @ matrix.T
    pixels = projected[:, :2] / projected[:, 2:] + 0.5
    edges = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    return crop_around(np.clip(edges, 0, np.tile(size, 2))[None], size)
