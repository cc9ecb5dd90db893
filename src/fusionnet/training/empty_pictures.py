"""Pictures without blocks: checkerboards of any kind and size, from any side, among clutter.

A detector that has only seen our board takes the pale squares of another for blocks. These are
drawn while it trains, and there is nothing to be found in them.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks import EMPTY
from fusionnet.dataset.pictures import Labels

_SQUARE = 24
"""Pixels a square as drawn, before the board is seen from somewhere."""


def empty_picture(
    rng: np.random.Generator, size: tuple[int, int]
) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
    """A picture without blocks, and labels that say so.

    Args:
        rng: Source of all randomness.
        size: Width and height in pixels.
    """
    picture = _surface(rng, size)
    for _ in range(rng.integers(0, 6)):
        _clutter(rng, picture)
    if rng.random() < 0.9:
        picture = _with_board(rng, picture)
        for _ in range(rng.integers(0, 3)):
            _clutter(rng, picture)
    if rng.random() < 0.5:
        picture = np.repeat(picture.mean(axis=2, keepdims=True), 3, axis=2)
    across, down = np.meshgrid(np.linspace(-1, 1, size[0]), np.linspace(-1, 1, size[1]))
    slope = rng.uniform(-0.3, 0.3, 2)
    picture = picture * (1.0 + slope[0] * across + slope[1] * down)[..., None]
    picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 1.3))
    picture = picture + rng.normal(0.0, rng.uniform(0.0, 0.03), picture.shape)
    return (255 * np.clip(picture, 0, 1)).astype(np.uint8), _nothing()


def _surface(rng: np.random.Generator, size: tuple[int, int]) -> Float[np.ndarray, "h w 3"]:
    """A colour with noise of several scales, as of wood, cloth or a wall out of focus."""
    picture = np.ones((size[1], size[0], 3)) * rng.uniform(0.05, 1.0) * rng.uniform(0.75, 1.0, 3)
    for cells in (3, 8, 24, 64):
        shape = (cells, max(2, int(cells * rng.choice([0.15, 1.0]))))
        noise = rng.normal(0.0, 1.0, shape).astype(np.float32)
        grown = cv2.resize(noise, size, interpolation=cv2.INTER_CUBIC)
        picture *= 1.0 + rng.uniform(0.0, 0.15) * grown[..., None]
    return np.clip(picture, 0.0, 1.0)


def _clutter(rng: np.random.Generator, picture: Float[np.ndarray, "h w 3"]) -> None:
    """An ellipse, a convex outline or a bar somewhere, of any colour or of skin's."""
    height, width = picture.shape[:2]
    x, y = int(rng.integers(width)), int(rng.integers(height))
    color = tuple(float(v) for v in rng.uniform(0.02, 1.0, 3))
    if rng.random() < 0.4:
        color = tuple(float(v) for v in rng.uniform(0.3, 1.0) * np.array([0.9, 0.7, 0.6]))
    reach = float(rng.uniform(4, 90))
    kind = rng.integers(3)
    if kind == 0:
        axes = (int(reach) + 1, int(reach * rng.uniform(0.2, 1.0)) + 1)
        cv2.ellipse(picture, (x, y), axes, rng.uniform(0, 180), 0, 360, color, -1, cv2.LINE_AA)
    elif kind == 1:
        angles = np.sort(rng.uniform(0, 2 * np.pi, 7))
        corners = np.stack([np.cos(angles), np.sin(angles)], axis=1) * reach + [x, y]
        cv2.fillConvexPoly(picture, np.rint(corners).astype(np.int32), color, cv2.LINE_AA)
    else:
        end = np.rint([x, y] + rng.normal(0, 2 * reach, 2)).astype(int)
        thick = int(rng.integers(1, 25))
        cv2.line(picture, (x, y), (int(end[0]), int(end[1])), color, thick, cv2.LINE_AA)


def _with_board(
    rng: np.random.Generator, picture: Float[np.ndarray, "h w 3"]
) -> Float[np.ndarray, "h w 3"]:
    """A checkerboard with a pale margin, turned in space at random, before a picture."""
    height, width = picture.shape[:2]
    columns, rows = int(rng.integers(5, 12)), int(rng.integers(4, 10))
    pale = rng.uniform(0.55, 1.0) * rng.uniform(0.93, 1.0, 3)
    dark = rng.uniform(0.0, 0.35) * rng.uniform(0.85, 1.0, 3)
    squares = (np.indices((rows, columns)).sum(axis=0) % 2)[..., None]
    board = np.where(squares, pale, dark).repeat(_SQUARE, axis=0).repeat(_SQUARE, axis=1)
    margin = int(rng.integers(0, _SQUARE + 1))
    board = np.pad(board, ((margin, margin), (margin, margin), (0, 0)), constant_values=pale.mean())
    tall, wide = board.shape[:2]
    corners = np.array([[0, 0], [wide, 0], [wide, tall], [0, tall]], np.float32)
    flat = np.concatenate([corners - [wide / 2, tall / 2], np.zeros((4, 1))], axis=1)
    turn, _ = cv2.Rodrigues(rng.uniform(-1.0, 1.0, 3) * np.array([0.95, 0.95, 3.2]))
    seen = flat @ turn.T
    depth = 1.0 + seen[:, 2:] / (rng.uniform(1.2, 3.0) * max(tall, wide))
    scale = rng.uniform(10, 48) / _SQUARE
    place = np.array([width, height]) * rng.uniform(0.25, 0.75, 2)
    target = (seen[:, :2] / depth * scale + place).astype(np.float32)
    warp = cv2.getPerspectiveTransform(corners, target)
    cover = cv2.warpPerspective(np.ones((tall, wide)), warp, (width, height))[..., None]
    drawn = cv2.warpPerspective(board, warp, (width, height), flags=cv2.INTER_AREA)
    return picture * (1.0 - cover) + drawn * (cover > 0)


def _nothing() -> Labels:
    return Labels(
        boxes=np.zeros((0, 4)),
        classes=np.zeros(0, dtype=int),
        hidden=np.zeros(0, dtype=bool),
        cells=np.full(512, EMPTY),
        visible=np.zeros(512, dtype=int),
        holding=False,
        matrix=np.eye(3),
        camera_from_board=np.eye(4),
        by_eye=False,
    )
