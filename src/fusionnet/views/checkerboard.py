"""The checkerboard that a camera is calibrated with, and its corners in a picture."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks.grid import BLOCK_SIZE
from fusionnet.errors import InputError

WINDOW = 11
"""Half size of the window of sub-pixel refinement, in pixels, at most (thesis 3.2.2)."""

SEARCHED = 1600
"""Longer side of the picture that the board is looked for in, in pixels: a photograph of twelve
megapixels without a board would else cost seven seconds. Corners are refined in the whole one."""

_REFINED = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)


@dataclass(frozen=True)
class Checkerboard:
    """A printed checkerboard.

    Its frame (the *pattern*) has its origin at the first inner corner, x along the columns, y
    along the rows and z into the board (OpenCV's convention).

    Attributes:
        columns: Squares along its long side; the thesis's board has 10.
        rows: Squares along its short side; 7.
        square: Edge of a square, in metres.
    """

    columns: int = 10
    rows: int = 7
    square: float = BLOCK_SIZE

    def __post_init__(self) -> None:
        if not (4 <= self.columns <= 50 and 4 <= self.rows <= 50):
            raise InputError(
                f"A board of {self.columns} x {self.rows} squares cannot be used; expected 4 to "
                "50 squares on each side (squares, not inner corners)."
            )
        if not 0.001 <= self.square <= 1.0:
            raise InputError(
                f"A board's squares cannot measure {self.square} m; expected 0.001 to 1."
            )

    @property
    def inner(self) -> tuple[int, int]:
        """Inner corners along columns and rows."""
        return self.columns - 1, self.rows - 1

    @property
    def oriented(self) -> bool:
        """Whether a half turn changes it, so that a picture says which end is which."""
        return (self.columns + self.rows) % 2 == 1

    @property
    def points(self) -> Float[np.ndarray, "n 3"]:
        """The inner corners in the pattern's frame, in metres, row by row."""
        columns, rows = np.meshgrid(*(np.arange(count) for count in self.inner))
        flat = np.column_stack([columns.ravel(), rows.ravel(), np.zeros(columns.size)])
        return flat * self.square

    def find(self, image: UInt8[np.ndarray, "h w c"]) -> Float[np.ndarray, "n 2"] | None:
        """The inner corners in a picture to a fraction of a pixel, in the order of `points`.

        Returns:
            Pixels, or None if the board is not seen as a whole. On an oriented board the first
            corner touches a dark outer square, so that all pictures agree on the two ends.

        References:
            Thesis 3.2.2, OpenCV's findChessboardCorners and cornerSubPix.
        """
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
        factor = max(1.0, max(grey.shape) / SEARCHED)
        small = grey
        if factor > 1.0:
            size = tuple(round(side / factor) for side in grey.shape[::-1])
            small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        found, corners = cv2.findChessboardCorners(
            small, self.inner, flags=flags | cv2.CALIB_CB_FAST_CHECK
        )
        if not found:
            found, corners = cv2.findChessboardCorners(small, self.inner, flags=flags)
        if not found:
            return None
        scale = np.array(grey.shape[::-1]) / small.shape[::-1]
        corners = ((corners.reshape(-1, 2) + 0.5) * scale - 0.5).astype(np.float32)
        corners = self._from_dark_end(grey, _unmirrored(corners, self.inner))
        half = max(2, min(WINDOW, int(0.4 * _closest(corners, self.inner))))
        refined = cv2.cornerSubPix(
            grey, corners.copy().reshape(-1, 1, 2), (half, half), (-1, -1), _REFINED
        )
        return refined.reshape(-1, 2).astype(float)

    def _from_dark_end(self, grey: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Turn the order by half a turn if the first corner's outer square is light."""
        if not self.oriented:
            return corners
        grid = corners.reshape(self.inner[1], self.inner[0], 2)
        # The square between the first four corners has the colour of the first outer one.
        dark, light = (_mean(grey, grid[0:2, at : at + 2].reshape(4, 2)) for at in (0, 1))
        return corners if dark <= light else corners[::-1]


def _unmirrored(corners: np.ndarray, inner: tuple[int, int]) -> np.ndarray:
    """Reverse the rows if they run clockwise against the columns: boards are seen from above."""
    grid = corners.reshape(inner[1], inner[0], 2)
    along, across = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * across[1] - along[1] * across[0] < 0.0:
        grid = grid[:, ::-1]
    return grid.reshape(-1, 2)


def _mean(grey: np.ndarray, corners: np.ndarray) -> float:
    middle = corners.mean(axis=0)
    inside = 0.5 * (corners - middle) + middle
    mask = np.zeros(grey.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(inside[[0, 1, 3, 2]]).astype(np.int32), 1)
    return float(cv2.mean(grey, mask)[0])


def _closest(corners: np.ndarray, inner: tuple[int, int]) -> float:
    """The least distance between neighbouring corners, in pixels."""
    grid = corners.reshape(inner[1], inner[0], 2)
    sides = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
    return float(min(sides))
