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
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from torchvision.ops import box_iou

from fusionnet.blocks import BLOCK_SIZE, EMPTY, GRID, Block, Cell, Color, Shape
from fusionnet.dataset.pictures import LEAST_PIXELS
from fusionnet.models.heads.boxes import SCORE, Boxes
from fusionnet.simulation.tabletop import drawn_corners, ideal_poses

COLORS = len(Color)

UNEXPLAINED = 0.4
"""Factor on the score of a detection that no cell explains."""

SAME = 0.4
"""Overlap from which on a detection is the block of that class that a cell explains."""

_SHAPES = tuple(Shape)

Window = tuple[slice, slice]
"""Rows and columns of a picture."""

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
        window, inside = covered(drawings[shapes[number]][number], size)
        picture[window][inside] = number + 1
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
) -> list[Float[np.ndarray, "k 2"]]:
    """The convex outlines of blocks of a shape beside their cells, in pixels."""
    blocks = tuple(Block(Color.RED, shape, Cell.from_index(int(cell))) for cell in cells)
    poses = ideal_poses(blocks, np.eye(4), turns=offsets[cells, 2])
    corners = drawn_corners(blocks, poses)
    pixels = project(corners.reshape(-1, 3)).reshape(len(blocks), -1, 2)
    pixels += offsets[cells, None, :2]
    return [convex_hull(points) for points in pixels]


def convex_hull(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """The corners of the convex hull, in turn."""
    hull: np.ndarray = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    return hull


def covered(
    outline: Float[np.ndarray, "k 2"], size: tuple[int, int]
) -> tuple[Window, Bool[np.ndarray, "h w"]]:
    """The pixels whose middles lie within a convex outline: a part of the picture, and which of it.

    OpenCV fills the pixels under the edges, too, and so hides the strip of a pixel that shows of
    a block beneath another.

    Args:
        outline: In pixels, whole numbers at their edges.
        size: Width and height of the picture.
    """
    low = np.clip(np.floor(outline.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(outline.max(axis=0)), low, size).astype(int)
    x, y = np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5
    start, end = outline, np.roll(outline, -1, axis=0)
    rise = end[:, 1] - start[:, 1]
    cut = (y[:, None] >= np.minimum(start, end)[:, 1]) & (y[:, None] < np.maximum(start, end)[:, 1])
    slope = (end - start)[:, 0] / np.where(rise == 0, 1.0, rise)
    meets = start[:, 0] + (y[:, None] - start[:, 1]) * slope
    left = np.where(cut, meets, np.inf).min(axis=1)
    right = np.where(cut, meets, -np.inf).max(axis=1)
    inside = (x >= left[:, None]) & (x < right[:, None])
    return (slice(low[1], high[1]), slice(low[0], high[0])), inside


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
    picture: Int[np.ndarray, "h w"], outline: Float[np.ndarray, "k 2"], number: int
) -> tuple[Float[np.ndarray, "4"], int]:
    """Box and pixels of what would be seen of a block between those before and behind it."""
    window, inside = covered(outline, picture.shape[::-1])
    rows, columns = np.nonzero(inside & ~(picture[window] > number + 1))
    if not len(rows):
        return np.zeros(4), 0
    low = np.array([window[1].start, window[0].start])
    start = np.array([columns.min(), rows.min()]) + low
    end = np.array([columns.max(), rows.max()]) + low + 1
    return np.concatenate([start, end]).astype(float), len(rows)
