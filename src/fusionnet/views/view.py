"""An environmental view: one undistorted photograph whose camera is known (thesis 3.2)."""

from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks.grid import BLOCK_SIZE, GRID
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera, PointBehindCameraError

Part = Literal["train", "val"]

MOST_VIEWS = 10_000
"""In one folder."""

REGION_CORNERS = np.array(list(product((0.0, GRID * BLOCK_SIZE), repeat=3)))
"""The eight corners of the grasping region, all 8x8x8 cells, in the board frame (metres)."""


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
        light_directions: Of the rays of the lamps that the photographs of its environment tell of,
            strongest first, in the board frame; none where they do not tell.
    """

    name: str
    environment: str
    part: Part
    image: UInt8[np.ndarray, "h w 3"]
    matrix: Float[np.ndarray, "3 3"]
    camera_from_board: Float[np.ndarray, "4 4"]
    light_directions: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def camera(self) -> PinholeCamera:
        """The camera that took it; the board's frame stands for the robot's."""
        height, width = self.image.shape[:2]
        return PinholeCamera(width, height, self.matrix, self.camera_from_board)


def check_view(view: EnvironmentalView) -> None:
    """Refuse a view into which no layout could be drawn.

    Raises:
        InputError: If its intrinsics or its pose are none, the camera looks from below the
            table, light does not come from above it, or a corner of the grasping region is outside
            the picture; the message names the view.
    """
    matrix, pose = view.matrix, view.camera_from_board
    if not (np.isfinite(matrix).all() and np.isfinite(pose).all()):
        raise InputError(f"The view {view.name!r} has numbers that are not finite.")
    fixed = [matrix[0, 1], matrix[1, 0], *matrix[2]]
    if min(matrix[0, 0], matrix[1, 1]) <= 0.0 or fixed != [0.0, 0.0, 0.0, 0.0, 1.0]:
        raise InputError(
            f"The intrinsics of the view {view.name!r} are {matrix.tolist()}; expected "
            "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive focal lengths, in pixels."
        )
    rotation = pose[:3, :3]
    turns = np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6 and np.linalg.det(rotation) > 0
    if not turns or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"The pose camera_from_board of the view {view.name!r} is no rigid transform."
        )
    rays = view.light_directions
    if len(rays) and not (np.abs(np.linalg.norm(rays, axis=1) - 1) < 0.01).all():
        raise InputError(
            f"The light directions of the view {view.name!r} are {rays.tolist()}; expected vectors "
            "of length 1."
        )
    if (rays[:, 2] >= 0.0).any():
        raise InputError(
            f"The light directions of the view {view.name!r} are {rays.tolist()}; expected rays "
            "that come from above the table (the grid's z axis points up)."
        )
    height_above = float((-rotation.T @ pose[:3, 3])[2])
    if height_above <= 0.0:
        raise InputError(
            f"The camera of the view {view.name!r} is {-height_above:.3f} m below the table; "
            "expected it above (the grid's z axis points up)."
        )
    height, width = view.image.shape[:2]
    try:
        pixels = view.camera.project(REGION_CORNERS)
    except PointBehindCameraError:
        raise InputError(f"The grid of the view {view.name!r} lies behind its camera.") from None
    outside = np.any((pixels < -0.5) | (pixels > np.array([width, height]) - 0.5), axis=1)
    if outside.any():
        corner, pixel = REGION_CORNERS[outside][0], pixels[outside][0]
        raise InputError(
            f"The grid of the view {view.name!r} leaves the picture: its corner at "
            f"({', '.join(f'{c:.3f}' for c in corner)}) m falls on pixel ({pixel[0]:.0f}, "
            f"{pixel[1]:.0f}) of {width} x {height}; choose a view that shows all of it."
        )
