"""Boxes that the layout explains: every block drawn where the camera must see it.

The occupancy of the cells and the camera's pose say more about a block's box than the box
head can say alone: which part of it the others hide. The blocks are painted from the farthest
to the nearest into a picture of numbers; what is left of each is its box. What the box head
found and no cell explains is kept, with less weight.
"""

from collections.abc import Callable

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int
from scipy import ndimage
from torchvision.ops import box_iou

from fusionnet.blocks import BLOCK_SIZE, EMPTY, GRID, Block, Cell, Color, Shape
from fusionnet.models.heads.boxes import SCORE, Boxes
from fusionnet.simulation.tabletop import drawn_corners, ideal_poses

COLORS = len(Color)

LEAST_PIXELS = 12
"""Of the eye's picture: blocks of which less can be seen get no box, as in the data sets."""

UNEXPLAINED = 0.4
"""Factor on the score of a detection that no cell explains."""

SAME = 0.4
"""Overlap from which on a detection is the block of that class that a cell explains."""

_SHAPES = tuple(Shape)

FRACTION = 4
"""Bits of a pixel's fraction where OpenCV draws."""

IN_THE_MIDDLE = np.zeros((GRID**3, 3))
"""Offsets of blocks none of which stands beside the middle of its cell, nor is turned."""

Project = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 2"]]


def projected_boxes(
    cells: Float[np.ndarray, "512 17"],
    project: Project,
    viewpoint: Float[np.ndarray, "3"],
    size: tuple[int, int],
    offsets: Float[np.ndarray, "512 3"] = IN_THE_MIDDLE,
) -> Boxes:
    """Boxes of all blocks that the occupancy holds for possible, scored by its probabilities.

    Blocks that are more likely there than not hide one another. One that is less likely, or of
    the less likely shape, is drawn among them as if it were there, but hides none. A cell may
    give boxes of several classes.

    Args:
        cells: Probabilities of the classes of every cell; the last is empty.
        project: From points of the board frame (metres) to pixels of the picture.
        viewpoint: Where the camera stands, in the board frame (metres).
        size: Width and height of the picture, in pixels.
        offsets: How far from the middle of each cell its block appears, in pixels of the
            picture, and how far it is turned about the vertical, in radians; by default not.
    """
    possible = np.flatnonzero(cells[:, :EMPTY].max(axis=1) >= SCORE)
    if not len(possible):
        return Boxes(torch.zeros(0, 4).double(), torch.zeros(0).long(), torch.zeros(0))
    possible = possible[far_to_near(possible, viewpoint)]
    there = cells[possible, EMPTY] < 0.5
    by_shape = cells[possible, :EMPTY].reshape(-1, len(_SHAPES), COLORS)
    shapes = by_shape.sum(axis=2).argmax(axis=1)
    drawings = [outlines(possible, shape, project, offsets) for shape in _SHAPES]
    picture = np.zeros((size[1], size[0]), np.int32)
    for number in np.flatnonzero(there):
        outline = drawings[shapes[number]][number]
        cv2.fillConvexPoly(picture, outline, int(number) + 1, shift=FRACTION)
    drawn, pixels = _boxes_of(picture, len(possible))
    boxes, classes, scores = [], [], []
    for number, shape, color in np.argwhere(by_shape >= SCORE):
        box, seen = drawn[number], pixels[number]
        if not there[number] or shape != shapes[number]:
            box, seen = _seen_part(picture, drawings[shape][number], int(number))
        if seen >= LEAST_PIXELS:
            boxes.append(box)
            classes.append(int(shape * COLORS + color))
            scores.append(by_shape[number, shape, color])
    return Boxes(
        torch.from_numpy(np.array(boxes, dtype=float).reshape(-1, 4)),
        torch.tensor(classes, dtype=torch.long),
        torch.tensor(scores, dtype=torch.float32),
    )


def with_leftovers(explained: Boxes, found: Boxes) -> Boxes:
    """Those explained, and what else the box head found; all in pixels of one picture."""
    ours, others = explained.xyxy, found.xyxy
    same = box_iou(others, ours) * (found.classes[:, None] == explained.classes)
    scores = UNEXPLAINED * found.scores
    left = scores >= SCORE
    if len(ours):
        left &= same.amax(dim=1) < SAME
    return Boxes(
        torch.cat([ours, others[left]]),
        torch.cat([explained.classes, found.classes[left]]),
        torch.cat([explained.scores, scores[left]]),
    )


def far_to_near(
    cells: Int[np.ndarray, " n"], viewpoint: Float[np.ndarray, "3"]
) -> Int[np.ndarray, " n"]:
    """An order in which no cell is hidden by an earlier one: axis by axis towards the camera."""
    place = np.stack(np.unravel_index(cells, (GRID, GRID, GRID)), axis=1)
    away = np.abs((place + 0.5) * BLOCK_SIZE - viewpoint)
    return np.lexsort(-away.T)


def outlines(
    cells: Int[np.ndarray, " n"],
    shape: Shape,
    project: Project,
    offsets: Float[np.ndarray, "512 3"] = IN_THE_MIDDLE,
) -> list[Int[np.ndarray, "k 2"]]:
    """The convex outlines of blocks of a shape beside their cells, as `drawable` points."""
    blocks = tuple(Block(Color.RED, shape, Cell.from_index(int(cell))) for cell in cells)
    poses = ideal_poses(blocks, np.eye(4), turns=offsets[cells, 2])
    corners = drawn_corners(blocks, poses)
    pixels = project(corners.reshape(-1, 3)).reshape(len(blocks), -1, 2)
    pixels += offsets[cells, None, :2]
    return [cv2.convexHull(points)[:, 0] for points in drawable(pixels)]


def drawable(pixels: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n 2"]:
    """Points as OpenCV draws them: whole numbers at pixels' centres, times 2**FRACTION."""
    points: np.ndarray = np.rint((pixels - 0.5) * 2**FRACTION).clip(-(2**24), 2**24)
    return points.astype(np.int32)


def _boxes_of(
    picture: Int[np.ndarray, "h w"], count: int
) -> tuple[Float[np.ndarray, "n 4"], Int[np.ndarray, " n"]]:
    boxes = np.zeros((count, 4))
    for number, found in enumerate(ndimage.find_objects(picture, max_label=count)):
        if found is not None:
            rows, columns = found
            boxes[number] = columns.start, rows.start, columns.stop, rows.stop
    return boxes, np.bincount(picture.ravel(), minlength=count + 1)[1:]


def _seen_part(
    picture: Int[np.ndarray, "h w"], outline: Int[np.ndarray, "k 2"], number: int
) -> tuple[Float[np.ndarray, "4"], int]:
    """Box and pixels of what would be seen of a block between those before and behind it."""
    height, width = picture.shape
    low = np.clip(outline.min(axis=0) >> FRACTION, 0, [width, height])
    high = np.clip((outline.max(axis=0) >> FRACTION) + 2, 0, [width, height])
    if (high <= low).any():
        return np.zeros(4), 0
    mask = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    cv2.fillConvexPoly(mask, outline - (low << FRACTION), 1, shift=FRACTION)
    before = picture[low[1] : high[1], low[0] : high[0]] > number + 1
    rows, columns = np.nonzero((mask > 0) & ~before)
    if not len(rows):
        return np.zeros(4), 0
    start = np.array([columns.min(), rows.min()]) + low
    end = np.array([columns.max(), rows.max()]) + low + 1
    return np.concatenate([start, end]).astype(float), len(rows)
