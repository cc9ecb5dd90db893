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
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8, UInt16

from fusionnet.geometry import PinholeCamera, apply
from fusionnet.simulation import Appearance
from fusionnet.simulation.tabletop import BOARD_SIZE

FINE, COARSE = 0.00125, 0.005
"""Edge of a pixel of the plan of the table for sharp shadows and for soft ones, in metres."""

SOFTNESS = 0.009
"""Standard deviation of the blur that joins the few rays of a wide light, in metres."""

LAMP_RADIUS = np.deg2rad(3.0)
"""Angular radius of the main light: a lamp 20 cm across at two metres."""

FILL_RADIUS = np.deg2rad(15.0)
"""Angular radius of the fill light: a window or a bright wall."""

REACHES = (0.35, 0.12, 0.03)
"""How far beyond the grid shadows are followed, in metres; the first that the camera can see."""

_SUBPIXEL_BITS = 4
_WHOLE = 65000
_LEAST_DESCENT = 0.1
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
    nothing = (None, np.eye(3))
    if not len(corners) or reach is None:
        return nothing
    lamp, surroundings = light_directions(light)
    outlines = [_outlines(corners, rays) for rays in (lamp.rays, surroundings.rays)]
    every = np.concatenate([o.reshape(-1, 2) for o in outlines])
    low = np.maximum(every.min(axis=0), -reach) - 2 * COARSE
    high = np.minimum(every.max(axis=0), BOARD_SIZE + reach) + 2 * COARSE
    if np.any(high - low <= 4 * COARSE):
        return nothing
    coarse_size = np.ceil((high - low) / COARSE).astype(int)
    fine_size = coarse_size * round(COARSE / FINE)
    sharp = cv2.blur(_missing(outlines[0], lamp.shares, low, FINE, fine_size), (3, 3))
    soft = _missing(outlines[1], surroundings.shares, low, COARSE, coarse_size)
    soft = cv2.GaussianBlur(soft, (0, 0), SOFTNESS / COARSE)
    soft = np.rint(soft * _fading(low, coarse_size, reach)).astype(np.uint16)
    missing = cv2.add(sharp, cv2.resize(soft, fine_size.tolist(), interpolation=cv2.INTER_LINEAR))
    plan = cv2.bitwise_not(cv2.convertScaleAbs(missing, alpha=255.0 / _WHOLE))
    # Whole pixels are at centres; `low` is the first one's edge.
    board_from_plan = np.diag([FINE, FINE, 1.0])
    board_from_plan[:2, 2] = low + 0.5 * FINE
    return plan, board_from_plan


def _fading(
    low: Float[np.ndarray, "2"], size: Int[np.ndarray, "2"], reach: float
) -> Float[np.ndarray, "h w"]:
    """Factors that let long faint shadows end gently where the plan must end."""
    across, down = (
        low[axis] + (np.arange(size[axis]) + 0.5) * COARSE - 0.5 * BOARD_SIZE for axis in (0, 1)
    )
    left = [reach + 0.5 * BOARD_SIZE - np.abs(offset) for offset in (across, down)]
    across_factor, down_factor = (np.clip(3.0 * beyond / reach, 0.0, 1.0) for beyond in left)
    factors: np.ndarray = np.outer(down_factor, across_factor)
    return factors


def _missing(
    outlines: Float[np.ndarray, "k n 6 2"],
    shares: Float[np.ndarray, " k"],
    low: Float[np.ndarray, "2"],
    resolution: float,
    size: Int[np.ndarray, "2"],
) -> UInt16[np.ndarray, "h w"]:
    """The light that does not reach each pixel of a plan; `_WHOLE` is all light."""
    pixels = np.rint(((outlines - low) / resolution - 0.5) * 2**_SUBPIXEL_BITS).astype(np.int32)
    missing = np.zeros((size[1], size[0]), np.uint16)
    one = np.empty_like(missing)
    for polygons, step in zip(pixels, np.rint(shares * _WHOLE).astype(int).tolist(), strict=True):
        one[:] = 0
        for polygon in polygons:
            cv2.fillConvexPoly(one, polygon, step, cv2.LINE_8, _SUBPIXEL_BITS)
        cv2.add(missing, one, missing)
    return missing


def _outlines(
    corners: Float[np.ndarray, "n 8 3"], rays: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "k n 6 2"]:
    """Corners, in order, of the shadow of every block on the table along every ray.

    Along a ray, a box shows the six corners that are neither its nearest nor its farthest.
    A pyramid's outline has fewer corners; its last one is repeated.
    """
    along = rays[:, :2] / rays[:, 2:]
    heights = np.maximum(corners[None, ..., 2:], 0.0)  # of what has sunk in, only the foot counts
    shadows: np.ndarray = corners[None, ..., :2] - heights * along[:, None, None]
    edges = corners[:, [1, 2, 4]] - corners[:, :1]
    farthest = (np.einsum("kc,nec->kne", rays, edges) > 0.0) @ np.array([1, 2, 4])
    order = farthest[..., None] ^ np.array([1, 3, 2, 6, 4, 5])
    outlines = np.take_along_axis(shadows, order[..., None], axis=2)
    for index in np.flatnonzero(np.all(corners[:, 4] == corners[:, 7], axis=1)):
        for shadow, outline in zip(shadows[:, index], outlines[:, index], strict=True):
            hull = cv2.convexHull(shadow[:5].astype(np.float32))[:, 0]
            outline[:] = hull[np.minimum(np.arange(6), len(hull) - 1)]
    return outlines


class LightRays(NamedTuple):
    """Directions of rays (board frame), and the share of all light on the table along each."""

    rays: Float[np.ndarray, "k 3"]
    shares: Float[np.ndarray, " k"]


def light_directions(light: Appearance) -> tuple[LightRays, LightRays]:
    """The rays of the lamp, which throws sharp shadows, and those of its surroundings."""
    directions = (
        _around(light.light_direction, LAMP_RADIUS, 8),
        _around(light.fill_direction, FILL_RADIUS, 6),
        _sky(24),
    )
    weights = [
        light.light.mean() * np.maximum(-directions[0][:, 2], 0.0) / len(directions[0]),
        light.fill.mean() * np.maximum(-directions[1][:, 2], 0.0) / len(directions[1]),
        np.full(len(directions[2]), light.ambient.mean() / len(directions[2])),
    ]
    total = sum(w.sum() for w in weights)
    steep = [rays[:, 2] < -_LEAST_DESCENT for rays in directions]
    lamp, fill, sky = (
        LightRays(rays[kept], weight[kept] / total)
        for rays, weight, kept in zip(directions, weights, steep, strict=True)
    )
    surroundings = LightRays(
        np.concatenate([fill.rays, sky.rays]), np.concatenate([fill.shares, sky.shares])
    )
    return lamp, surroundings


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
        low, high = -reach - 4 * COARSE, BOARD_SIZE + reach + 4 * COARSE
        square = np.array([[x, y, 0.0] for x in (low, high) for y in (low, high)])
        if apply(camera.camera_from_robot, square)[:, 2].min() > _LEAST_DEPTH:
            return reach
    return None
