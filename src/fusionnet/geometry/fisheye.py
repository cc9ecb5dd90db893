"""The fisheye lens: Kannala and Brandt's model, as OpenCV's `cv2.fisheye` writes it."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8


@dataclass(frozen=True, eq=False)
class FisheyeLens:
    """How a camera with a fisheye lens maps directions to pixels.

    A ray at the angle t to the axis meets the picture at the radius
    f (t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9).

    Attributes:
        width: Of the picture, in pixels.
        height: Of the picture, in pixels.
        matrix: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], in pixels, with whole numbers at the
            centres of pixels.
        coefficients: k1 to k4.

    References:
        Kannala and Brandt (2006), A generic camera model and calibration method.
    """

    width: int
    height: int
    matrix: Float[np.ndarray, "3 3"]
    coefficients: Float[np.ndarray, "4"]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height

    def project(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Where points of the camera frame (metres, in front of it) appear, in pixels."""
        points = np.asarray(points, dtype=float).reshape(-1, 1, 3)
        zero = np.zeros(3)
        pixels, _ = cv2.fisheye.projectPoints(points, zero, zero, self.matrix, self.coefficients)
        return pixels.reshape(-1, 2)

    def slopes(self, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """The rays that meet the pixels, as x / z and y / z in the camera frame."""
        pixels = np.asarray(pixels, dtype=float).reshape(-1, 1, 2)
        slopes: np.ndarray = cv2.fisheye.undistortPoints(pixels, self.matrix, self.coefficients)
        return slopes.reshape(-1, 2)

    def undistortion_maps(
        self, matrix: Float[np.ndarray, "3 3"]
    ) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
        """For each pixel of a pinhole picture with `matrix`, where to look in the lens's."""
        first, second = cv2.fisheye.initUndistortRectifyMap(
            self.matrix, self.coefficients, np.eye(3), matrix, self.size, cv2.CV_32FC1
        )
        return first, second

    def undistort(
        self, image: UInt8[np.ndarray, "h w c"], matrix: Float[np.ndarray, "3 3"]
    ) -> UInt8[np.ndarray, "h w c"]:
        """The picture that a pinhole camera with `matrix` would have taken, of the same size."""
        undistorted: np.ndarray = cv2.remap(
            image, *self.undistortion_maps(matrix), interpolation=cv2.INTER_LINEAR
        )
        return undistorted
