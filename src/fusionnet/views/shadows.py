"""Shadows of blocks on the table of a photograph, by differential rendering.

A plain table is rendered with the blocks and without; the ratio of the two, at most one,
darkens the photograph, whatever pattern its table has (Debevec 1998). Both renderings
of a plane are exact and cheap: under one direction of light every block, being
convex, darkens the convex hull of its corners' images along the rays. A lamp, a
fill light and the sky are sets of directions, so near edges are sharp, far ones soft, and blocks
stand in a faint dark rim.

References:
    Debevec (1998), Rendering synthetic objects into real scenes; thesis 3.2.4.
"""

from functools import cache

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.geometry import PinholeCamera, apply
from fusionnet.simulation import Appearance
from fusionnet.simulation.tabletop import BOARD_SIZE

RESOLUTION = 0.00125
"""Edge of one pixel of the shaded plan of the table, in metres."""

REACHES = (0.35, 0.12, 0.03)
"""How far beyond the grid shadows are followed, in metres; the first that the camera can see."""

_SUBPIXEL_BITS = 4
_LEAST_DEPTH = 0.02


def cast_shadows(
    image: UInt8[np.ndarray, "h w 3"],
    corners: Float[np.ndarray, "n 8 3"],
    light: Appearance,
    camera: PinholeCamera,
) -> UInt8[np.ndarray, "h w 3"]:
    """The photograph with the table darkened where the blocks keep light away from it.

    Args:
        image: The photograph.
        corners: Of every block, in the board frame, in metres.
        light: Its main light, fill light and ambient light.
        camera: Of the photograph, with the board frame as its `robot` frame.
    """
    plan, board_from_plan = table_ratio(corners, light, _reach(camera))
    if plan is None:
        return image
    image_from_board = camera.matrix @ camera.camera_from_robot[:3, [0, 1, 3]]
    image_from_plan = image_from_board @ board_from_plan
    height, width = plan.shape
    outline = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) - [
        0.5,
        0.5,
        0,
    ]
    seen = outline @ image_from_plan.T
    seen = seen[:, :2] / seen[:, 2:]
    left, top = np.clip(np.floor(seen.min(axis=0)), 0, [camera.width, camera.height]).astype(int)
    right, bottom = np.clip(np.ceil(seen.max(axis=0)) + 1, 0, [camera.width, camera.height]).astype(
        int
    )
    if left >= right or top >= bottom:
        return image
    shift = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]])
    ratio = cv2.warpPerspective(
        plan, shift @ image_from_plan, (right - left, bottom - top), borderValue=255
    )
    shaded = image.copy()
    part = np.ascontiguousarray(image[top:bottom, left:right])
    shaded[top:bottom, left:right] = cv2.multiply(
        part, cv2.cvtColor(ratio, cv2.COLOR_GRAY2RGB), scale=1.0 / 255.0
    )
    return shaded


def table_ratio(
    corners: Float[np.ndarray, "n 8 3"], light: Appearance, reach: float | None
) -> tuple[UInt8[np.ndarray, "h w"] | None, Float[np.ndarray, "3 3"]]:
    """Light on a plan of the table with blocks over light without, 255 standing for one.

    Args:
        corners: Of every block, in the board frame, in metres.
        light: Says from where how much light comes.
        reach: How far beyond the grid the plan may extend, in metres; None for no plan at all.

    Returns:
        The plan, or None where no shadow falls, and the homography `board_from_plan` from its
        pixels to metres.
    """
    if not len(corners) or reach is None:
        return None, np.eye(3)
    rays, weights = light_directions(light)
    along = rays[:, :2] / rays[:, 2:]
    feet = corners[None, ..., :2] - corners[None, ..., 2:] * along[:, None, None]
    low = np.maximum(feet.min(axis=(0, 1, 2)), -reach)
    high = np.minimum(feet.max(axis=(0, 1, 2)), BOARD_SIZE + reach)
    width, height = np.ceil((high - low) / RESOLUTION).astype(int) + 4
    if width <= 4 or height <= 4:
        return None, np.eye(3)
    origin = low - 2.0 * RESOLUTION
    pixels = ((feet - origin) / RESOLUTION * 2**_SUBPIXEL_BITS).round().astype(np.int32)
    # Sixteen-bit sums of the light that is missing.
    steps = np.rint(weights * 65000).astype(int)
    missing = np.zeros((height, width), np.uint16)
    one = np.empty_like(missing)
    for polygons, step in zip(pixels, steps.tolist(), strict=True):
        one[:] = 0
        for polygon in polygons:
            cv2.fillConvexPoly(one, cv2.convexHull(polygon), step, cv2.LINE_8, _SUBPIXEL_BITS)
        cv2.add(missing, one, missing)
    missing = cv2.blur(missing, (3, 3))
    plan = cv2.convertScaleAbs(missing, alpha=255.0 / 65000.0)
    board_from_plan = np.array(
        [[RESOLUTION, 0.0, origin[0]], [0.0, RESOLUTION, origin[1]], [0.0, 0.0, 1.0]]
    )
    return cv2.bitwise_not(plan), board_from_plan


def light_directions(
    light: Appearance,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Directions of rays (board frame), and the share of the table's light along each."""
    rays, weights = [], []
    for direction, strength, radius, count in (
        (light.light_direction, light.light, LAMP_RADIUS, 8),
        (light.fill_direction, light.fill, FILL_RADIUS, 4),
    ):
        spread = _around(direction, radius, count)
        rays.append(spread)
        weights.append(np.maximum(-spread[:, 2], 0.0) * strength.mean() / count)
    sky = _sky(10)
    rays.append(sky)
    weights.append(np.full(len(sky), light.ambient.mean() / len(sky)))
    every, shares = np.concatenate(rays), np.concatenate(weights)
    kept = every[:, 2] < -0.1
    return every[kept], shares[kept] / shares.sum()


LAMP_RADIUS = np.deg2rad(3.0)
"""Angular radius of the main light: a ceiling lamp of 20 cm across at two metres."""

FILL_RADIUS = np.deg2rad(15.0)
"""Angular radius of the fill light: a window or a bright wall."""


def _around(
    direction: Float[np.ndarray, "3"], radius: float, count: int
) -> Float[np.ndarray, "n 3"]:
    """Unit vectors evenly spread over the disc of this angular radius."""
    axis = direction / np.linalg.norm(direction)
    side = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    disc = _spiral(count) * np.tan(radius)
    spread = axis + disc[:, :1] * side + disc[:, 1:] * np.cross(axis, side)
    return spread / np.linalg.norm(spread, axis=1, keepdims=True)


@cache
def _sky(count: int) -> Float[np.ndarray, "n 3"]:
    """Downward unit vectors, as dense as an even sky's light on a table."""
    disc = _spiral(count)
    return np.column_stack([disc, -np.sqrt(1.0 - (disc**2).sum(axis=1))])


@cache
def _spiral(count: int) -> Float[np.ndarray, "n 2"]:
    """Points evenly spread over the unit disc (Vogel's sunflower)."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt((np.arange(count) + 0.5) / count)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])


def _reach(camera: PinholeCamera) -> float | None:
    """How far around the grid the whole table lies in front of the camera, in metres."""
    for reach in REACHES:
        low, high = -reach - 4 * RESOLUTION, BOARD_SIZE + reach + 4 * RESOLUTION
        square = np.array([[x, y, 0.0] for x in (low, high) for y in (low, high)])
        if apply(camera.camera_from_robot, square)[:, 2].min() > _LEAST_DEPTH:
            return reach
    return None
