"""Pictures without blocks: boards of any kind and size, from any side, among clutter; leaves; or
photographs.

A detector that has only seen our board takes the pale squares of another for blocks, and one
that has only seen flat clutter a sleeve or the corner of a wall. These are drawn while it trains,
and there is nothing to be found in them.

References:
    Lee, Mumford and Huang (2001), Occlusion models for natural images: a statistical study of a
    scale-invariant dead leaves model; Baradad et al. (2021), Learning to see by looking at noise.
"""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from fusionnet.blocks import EMPTY
from fusionnet.dataset.pictures import Labels
from fusionnet.views import Backdrops, drawn_view

PHOTOGRAPHS = 0.5
"""Share of the pictures that are photographs, if there are any."""

LEAVES = 0.5
"""Share of the others that show leaves, one upon another, instead of boards."""

GRAY = 0.5
"""Share of leaves and photographs that are without colour."""

RADII = (6.0, 260.0)
"""Of leaves, in pixels; there are as many of one size as cover the same area of another."""


def empty_picture(
    rng: np.random.Generator, size: tuple[int, int], backdrops: Backdrops | None = None
) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
    """A picture without blocks, and labels that say so.

    Args:
        rng: Source of all randomness.
        size: Width and height in pixels.
        backdrops: Photographs without blocks; all is drawn by default.
    """
    if backdrops is not None and rng.random() < PHOTOGRAPHS:
        photograph = backdrops.crop(rng, size)
        if rng.random() < GRAY:
            photograph = np.repeat(cv2.cvtColor(photograph, cv2.COLOR_RGB2GRAY)[..., None], 3, 2)
        return photograph, _nothing()
    if rng.random() < LEAVES:
        return shaded_leaves(rng, size), _nothing()
    return drawn_view(rng, size, backdrops=backdrops).image, _nothing()


def shaded_leaves(rng: np.random.Generator, size: tuple[int, int]) -> UInt8[np.ndarray, "h w 3"]:
    """Ellipses and polygons of all sizes, one upon another, each shaded as if it were bent.

    Args:
        rng: Source of all randomness.
        size: Width and height in pixels.
    """
    width, height = size
    picture = np.full((height, width, 3), rng.uniform(0.1, 0.9), np.float32)
    smallest, largest = RADII
    count = int(rng.integers(60, 220))
    radii = 1.0 / rng.uniform(1.0 / largest, 1.0 / smallest, count)
    radii[: count // 6] = rng.uniform(60.0, largest, count // 6)  # walls, clothes, tables
    for radius in radii:
        _add_leaf(picture, rng, float(radius))
    if rng.random() < GRAY:
        picture[:] = picture.mean(axis=2, keepdims=True)
    cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.6), dst=picture)
    picture += rng.normal(0.0, rng.uniform(0.002, 0.02), picture.shape).astype(np.float32)
    return (255 * picture.clip(0, 1)).astype(np.uint8)


def _add_leaf(
    picture: Float32[np.ndarray, "h w 3"], rng: np.random.Generator, radius: float
) -> None:
    """Paint one leaf: its light changes along a direction, first by slope and then by bend."""
    height, width = picture.shape[:2]
    middle, turn = rng.uniform(0, [width, height]), rng.uniform(0, 2 * np.pi)
    angles = np.linspace(0, 2 * np.pi, int(rng.choice([3, 4, 4, 5, 24, 24])), endpoint=False)
    stretched = np.stack([np.cos(angles), rng.uniform(0.25, 1.0) * np.sin(angles)], axis=1)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    corners = middle + radius * stretched @ rotation.T
    low = np.clip(np.floor(corners.min(axis=0)), 0, [width, height]).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)) + 1, 0, [width, height]).astype(int)
    if (high <= low).any():
        return
    mask = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    cv2.fillConvexPoly(mask, np.rint(corners - low).astype(np.int32), 1)
    x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    towards = rng.uniform(0, 2 * np.pi)
    along = ((x - middle[0]) * np.cos(towards) + (y - middle[1]) * np.sin(towards)) / radius
    light = 1.0 + rng.uniform(-0.5, 0.5) * along - rng.uniform(0.0, 0.6) * along**2
    color = rng.uniform(0.03, 1.0, 3) if rng.random() < 0.5 else np.full(3, rng.uniform(0.03, 1.0))
    if rng.random() < 0.15:  # stripes
        light *= 1.0 - 0.5 * (np.sin(along * radius / rng.uniform(1.0, 6.0)) > rng.uniform(0, 0.9))
    inside = mask > 0
    part = picture[low[1] : high[1], low[0] : high[0]]
    part[inside] = (light[..., None] * color).astype(np.float32)[inside]


def _nothing() -> Labels:
    return Labels(
        boxes=np.zeros((0, 4)),
        classes=np.zeros(0, dtype=int),
        hidden=np.zeros(0, dtype=bool),
        cells=np.full(512, EMPTY),
        visible=np.zeros(512, dtype=int),
        offsets=np.zeros((512, 3)),
        holding=False,
        matrix=np.eye(3),
        camera_from_board=np.eye(4),
        by_eye=False,
    )
