"""Where blocks would appear if nothing stood before them, and how large."""

import cv2
import numpy as np
from jaxtyping import Float, Int

from fusionnet.geometry import PinholeCamera, apply

_NEAREST = 0.01

Region = tuple[int, int, int, int]
"""Left, top, right and bottom edge of a part of a picture, in pixels."""


def region_of(camera: PinholeCamera, corners: Float[np.ndarray, "n k 3"]) -> Region | None:
    """The part of the picture where bodies may be, a pixel wider on each side; None for no part.

    Args:
        camera: Who looks.
        corners: Of every body, in the camera's `robot` frame, in metres.

    Raises:
        PointBehindCameraError: If a corner is not in front of the camera.
    """
    if not len(corners):
        return None
    size = (camera.width, camera.height)
    pixels = camera.project(corners.reshape(-1, 3)) + 0.5
    left, top = np.clip(np.floor(pixels.min(axis=0)) - 1, 0, size).astype(int).tolist()
    right, bottom = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, size).astype(int).tolist()
    return (left, top, right, bottom) if left < right and top < bottom else None


def silhouette_areas(
    camera: PinholeCamera, corners: Float[np.ndarray, "n k 3"]
) -> Float[np.ndarray, " n"]:
    """Pixels that each convex body covers in the picture, with nothing before it.

    The area of the convex hull of its projected corners, clipped to the picture; 0 for a body
    of which a part is less than a centimetre in front of the camera or behind it.

    Args:
        camera: Who looks.
        corners: Of every body, in the camera's `robot` frame, in metres.
    """
    areas = np.zeros(len(corners))
    in_camera = apply(camera.camera_from_robot, corners.reshape(-1, 3)).reshape(corners.shape)
    homogeneous = in_camera @ camera.matrix.T
    width, height = camera.width, camera.height
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    for index in np.flatnonzero(in_camera[..., 2].min(axis=1, initial=np.inf) > _NEAREST):
        pixels = homogeneous[index, :, :2] / homogeneous[index, :, 2:] + 0.5
        hull = cv2.convexHull(pixels.astype(np.float32))
        outside = pixels.min() < 0.0 or np.any(pixels.max(axis=0) > frame[2])
        if not outside:
            areas[index] = cv2.contourArea(hull)
        elif len(hull) >= 3:
            areas[index] = cv2.intersectConvexConvex(hull, frame)[0]
    return areas


def visible_shares(
    visible: Int[np.ndarray, " n"], areas: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Visible pixels as a share of the silhouette, 0 to 1; 0 for what is not in the picture."""
    shares: np.ndarray = np.clip(visible / np.maximum(areas, 1.0), 0.0, 1.0)
    return shares
