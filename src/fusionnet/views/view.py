"""An environmental view: one undistorted photograph whose camera is known (thesis 3.2)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8


@dataclass(frozen=True, eq=False, kw_only=True)
class EnvironmentalView:
    """A photograph of a board on a table, and where its camera stands.

    Attributes:
        name: Of the view.
        environment: Name of the room set-up that it shows.
        part: Whether models are trained on it or validated.
        image: Undistorted; red, green and blue.
        matrix: Pinhole intrinsics, in pixels, with whole numbers at the centres of pixels.
        camera_from_board: Pose of the camera (OpenCV axes) to the frame of the 8x8x8 grid (z up),
            in metres.
    """

    name: str
    environment: str
    part: Literal["train", "val"]
    image: UInt8[np.ndarray, "h w 3"]
    matrix: Float[np.ndarray, "3 3"]
    camera_from_board: Float[np.ndarray, "4 4"]
