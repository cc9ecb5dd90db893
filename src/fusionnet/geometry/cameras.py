"""Camera models.

Image coordinates are OpenCV's: x to the right and y down, in pixels, with whole
numbers at the centres of pixels, so the picture's left edge is at -0.5. A bounding
box speaks of edges instead: the box of the top-left pixel alone is (0, 0, 1, 1).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fusionnet.errors import InputError
from fusionnet.geometry.transforms import apply, invert


class PointBehindCameraError(InputError):
    """A point to be projected does not lie in front of the camera."""


@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """A camera without lens distortion.

    Attributes:
        width: Of the picture, in pixels.
        height: Of the picture, in pixels.
        matrix: Intrinsic matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], in pixels.
        camera_from_robot: Pose; the camera looks along its z axis (x right, y down).

    References:
        Hartley and Zisserman (2004), section 6.1.
    """

    width: int
    height: int
    matrix: Float[np.ndarray, "3 3"]
    camera_from_robot: Float[np.ndarray, "4 4"]

    @classmethod
    def from_vertical_view(
        cls,
        size: tuple[int, int],
        vertical_view: float,
        camera_from_robot: Float[np.ndarray, "4 4"],
    ) -> "PinholeCamera":
        """A camera with square pixels and its centre in the middle of the picture.

        Args:
            size: Width and height in pixels.
            vertical_view: Angle between the top and the bottom edge, in radians.
            camera_from_robot: Pose of the camera.
        """
        width, height = size
        focal = 0.5 * height / np.tan(0.5 * vertical_view)
        matrix = np.array(
            [[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]]
        )
        return cls(width, height, matrix, camera_from_robot)

    @property
    def position(self) -> Float[np.ndarray, "3"]:
        """Where the camera is, in the robot frame, in metres."""
        return invert(self.camera_from_robot)[:3, 3]

    def project(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Where points of the robot frame (metres) appear in the picture, in pixels.

        Raises:
            PointBehindCameraError: If any depth is not positive.
        """
        in_camera = apply(self.camera_from_robot, np.asarray(points, dtype=float).reshape(-1, 3))
        behind = np.flatnonzero(in_camera[:, 2] <= 0.0)
        if behind.size:
            raise PointBehindCameraError(
                f"Point {behind[0]} lies {-in_camera[behind[0], 2]:.3f} m behind the camera; "
                "only points in front of it have an image."
            )
        homogeneous = in_camera @ self.matrix.T
        return homogeneous[:, :2] / homogeneous[:, 2:]

    def unproject(
        self, pixels: Float[np.ndarray, "n 2"], depths: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 3"]:
        """The points of the robot frame seen at `pixels` at `depths` along the z axis (metres)."""
        pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
        rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(self.matrix).T
        return apply(invert(self.camera_from_robot), rays * np.asarray(depths)[:, None])
