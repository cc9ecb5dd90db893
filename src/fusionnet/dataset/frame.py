"""From a camera's picture to the network's input: crop to the grasping region, resize.

The thesis crops too, since blocks are small in the whole picture (6.1). The crop is
fixed in the frame of the robot's eye; a picture of another size is first brought to
the eye's size.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8


def decoded(
    jpeg: bytes | memoryview | np.ndarray | None, flags: int
) -> UInt8[np.ndarray, "h w 3"] | None:
    """A stored picture; None if it is empty or damaged.

    Args:
        jpeg: Its bytes.
        flags: Of `cv2.imdecode`: the order of colours, and the scale.
    """
    if jpeg is None or len(jpeg) == 0:
        return None
    try:
        return cv2.imdecode(np.frombuffer(jpeg, np.uint8), flags)
    except cv2.error:
        return None


@dataclass(frozen=True)
class PictureFrame:
    """Which part of the eye's picture the network sees, and at which size.

    Attributes:
        eye_size: Width and height of the eye's picture, in pixels.
        crop: Left, top, right, bottom of the part that is kept, in pixels of the eye.
        input_size: Width and height of the network's input, in pixels.
    """

    eye_size: tuple[int, int]
    crop: tuple[int, int, int, int]
    input_size: tuple[int, int]

    @property
    def scale(self) -> Float[np.ndarray, "2"]:
        """Pixels of the input a pixel of the eye, across and down."""
        left, top, right, bottom = self.crop
        return np.array([self.input_size[0] / (right - left), self.input_size[1] / (bottom - top)])

    def prepare(self, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h2 w2 3"]:
        """The network's input from a picture of any size."""
        if (image.shape[1], image.shape[0]) != tuple(self.eye_size):
            image = cv2.resize(image, self.eye_size, interpolation=cv2.INTER_AREA)
        left, top, right, bottom = self.crop
        part = np.ascontiguousarray(image[top:bottom, left:right])
        return cv2.resize(part, self.input_size, interpolation=cv2.INTER_AREA)

    def matrix(self, eye_matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        """Intrinsics of the network's input from the eye's.

        The eye's (as `geometry.PinholeCamera`) has whole numbers at the centres of
        pixels; the result has them at the edges, as boxes do.
        """
        left, top = self.crop[:2]
        shift = np.array([[1, 0, 0.5 - left], [0, 1, 0.5 - top], [0, 0, 1.0]])
        return np.diag([*self.scale, 1.0]) @ shift @ eye_matrix

    def eye_matrix(self, matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        """The inverse of `matrix`."""
        return np.linalg.inv(self.matrix(np.eye(3))) @ matrix

    def to_input(self, boxes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
        """Boxes of the eye's picture in pixels of the input."""
        return (boxes - np.tile(self.crop[:2], 2)) * np.tile(self.scale, 2)

    def to_eye(self, boxes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
        """Boxes of the input in pixels of the eye's picture."""
        return boxes / np.tile(self.scale, 2) + np.tile(self.crop[:2], 2)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "PictureFrame":
        """The inverse of `dataclasses.asdict`, also of what JSON makes of it."""
        whole: dict[str, Any] = {key: tuple(int(v) for v in value) for key, value in values.items()}
        return cls(**whole)
