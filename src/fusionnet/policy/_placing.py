"""Where a block is, from its box and the estimated camera."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import BLOCK_SIZE, Block, Cell, Color, Shape
from fusionnet.geometry import PinholeCamera, PointBehindCameraError
from fusionnet.models.sight import Sight
from fusionnet.policy._answer import LEAST_SCORE
from fusionnet.simulation.tabletop import BlockPoses, drawn_corners

FARTHEST_SHIFT = 0.022
"""A block seen farther from its place is another block, in metres."""

LEAST_FOLLOWED = 0.3
"""Score of a detection that is believed where a block is known to be about."""

WIDTHS = (0.85, 1.18)
"""Widths of the box, as shares of the expected: outside, something hides a part of the block."""

STANDS_BESIDE = np.diag([0.006, 0.006, 0.0]) ** 2
"""Covariance of the displacement of a block that stands beside its place, in square metres."""

MARK_ERROR = 3.0
"""Standard deviation of a box's marks where a hand is near, in pixels of the picture."""

LARGEST_SURPRISE = 3.5
"""A block that is seen more standard deviations from its place is another block."""

LEAST_WIDTH = 0.6
"""A block of which a smaller share of its width is seen is not followed."""

CANDIDATES = 8
"""So many columns, the nearest in the picture, are tried for a box."""

_COLORS = tuple(Color)
_SHAPES = tuple(Shape)


def with_boxed_blocks(sight: Sight) -> Sight:
    """The sight, with each block of a confident box that no cell explains in the nearest cell.

    The reader of the grid learned blocks that stand within a few millimetres of the middle of
    their cells, and may leave out one that stands a centimetre beside it; the box of such a
    block is as good as any. Only cells on the table or on a block are thought of, and only if
    the block is within half a cell of the middle.
    """
    detected = sight.detected
    confident = (detected.scores >= LEAST_SCORE).nonzero()[:, 0].tolist()
    if sight.holding > 0.5 or not confident:
        return sight
    cells = sight.cells.copy()
    for number in confident:
        kind, score = int(detected.classes[number]), float(detected.scores[number])
        box = detected.xyxy[number : number + 1].double().numpy()
        if any(
            _beside(sight.camera, kind, box, Cell(*map(int, cell)), FARTHEST_SHIFT, (0.0, np.inf))
            is not None
            for cell in np.argwhere(cells[..., kind] > LEAST_FOLLOWED)
        ):
            continue
        tried = [
            (apart, cell)
            for cell in _tops_near(sight.camera, cells, box[0])
            if (apart := _beside(sight.camera, kind, box, cell, BLOCK_SIZE / 2)) is not None
        ]
        if tried:
            cell = min(tried)[1]
            cells[tuple(cell)] *= 1.0 - score
            cells[(*cell, kind)] += score
    return replace(sight, cells=cells)


def _tops_near(
    camera: PinholeCamera, cells: Float[np.ndarray, "8 8 8 17"], box: Float[np.ndarray, "4"]
) -> list[Cell]:
    """The lowest free cell of each column, of those nearest to a box in the picture."""
    taken = cells[..., -1] < 0.5
    tops = np.array([(x, y, *np.argmin(taken[x, y], keepdims=True)) for x, y in np.ndindex(8, 8)])
    try:
        pixels = camera.project((tops + 0.5) * BLOCK_SIZE)
    except PointBehindCameraError:
        return []
    middle = (box[:2] + box[2:]) / 2
    order = np.linalg.norm(pixels - middle, axis=1).argsort()[:CANDIDATES]
    return [Cell(*map(int, tops[i])) for i in order if not taken[tuple(tops[i])]]


def _beside(
    camera: PinholeCamera,
    kind: int,
    box: Float[np.ndarray, "1 4"],
    cell: Cell,
    farthest: float,
    allowed: tuple[float, float] = WIDTHS,
) -> float | None:
    """How far the block of a box is from a cell's middle (metres); None if farther than asked."""
    measured = box_shifts(camera, kind, box, (np.array(cell) + 0.5) * BLOCK_SIZE)
    if measured is None:
        return None
    shifts, widths = measured
    near = np.abs(shifts[0]).max() <= farthest and allowed[0] <= widths[0] <= allowed[1]
    return float(np.linalg.norm(shifts[0])) if near else None


def block_shift(
    sight: Sight,
    kind: int,
    place: Float[np.ndarray, "3"],
    spread: Float[np.ndarray, "3 3"] = STANDS_BESIDE,
) -> Float[np.ndarray, "3"] | None:
    """How far a block is from where it should be, in the board frame (metres).

    One eye cannot tell higher from farther. Of all displacements that explain what is seen,
    the answer is the likeliest before it was seen: with what is known of the displacement and of
    the error of looking, the mean of a Gaussian given two marks of the box.

    Args:
        sight: Its detections are compared.
        kind: Class of the block. If none is seen near there, one of the same shape is taken for
            it: colours are mistaken for each other sooner than places.
        place: Middle of the block where it should be, in the board frame (metres).
        spread: Covariance of displacements before one looks (square metres).

    Returns:
        None if it is not seen near there, or only a part of it.

    References:
        Thrun, Burgard and Fox (2005), Probabilistic robotics, section 3.2 (Kalman filter).
    """
    try:
        expected, slopes = _expected(sight.camera, kind, place)
    except PointBehindCameraError:
        return None
    detected = sight.detected
    boxes, scores = detected.xyxy.double().numpy(), detected.scores.numpy()
    seen = _marks_of(boxes) - expected[:2]
    widths = (boxes[:, 2] - boxes[:, 0]) / expected[2]
    # What hides a part of a block moves the middle of the rest.
    noise = MARK_ERROR**2 + (0.5 * (1.0 - widths) * expected[2]) ** 2
    errors = slopes @ spread @ slopes.T + noise[:, None, None] * np.eye(2)
    surprise = np.einsum("ni,ni->n", seen, np.linalg.solve(errors, seen[..., None])[..., 0])
    believed = (scores >= LEAST_FOLLOWED) & (surprise <= LARGEST_SURPRISE**2)
    believed &= (widths >= LEAST_WIDTH) & (widths <= 1.0 / LEAST_WIDTH)
    _, spreads = np.linalg.slogdet(errors)
    likelihoods = np.log(np.maximum(scores, LEAST_FOLLOWED)) - (surprise + spreads) / 2
    classes = detected.classes.numpy()
    like = classes // len(_COLORS) == kind // len(_COLORS)
    for some in (believed & (classes == kind), believed & like):
        if some.any():
            best = int(np.where(some, likelihoods, -np.inf).argmax())
            shift: np.ndarray = spread @ slopes.T @ np.linalg.solve(errors[best], seen[best])
            return shift
    return None


def box_shifts(
    camera: PinholeCamera, kind: int, boxes: Float[np.ndarray, "n 4"], place: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]] | None:
    """How far the blocks of boxes are from a place at its height, and their relative widths.

    Args:
        camera: Of the picture.
        kind: Class of the block.
        boxes: Corners, in pixels of the picture.
        place: Middle of a block of that class, in the board frame (metres).

    Returns:
        Displacements along x and y of the board (metres), and widths as shares of the width that
        a block in the place would have; None if the place is behind the camera.
    """
    try:
        expected, slopes = _expected(camera, kind, place)
    except PointBehindCameraError:
        return None
    shifts = np.linalg.solve(slopes[:, :2], (_marks_of(boxes) - expected[:2]).T).T
    return shifts, (boxes[:, 2] - boxes[:, 0]) / expected[2]


def _marks_of(boxes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 2"]:
    """Middle of the sides, and lower edge, in pixels of the picture."""
    marks: np.ndarray = np.column_stack([boxes[:, [0, 2]].mean(axis=1), boxes[:, 3]])
    return marks


def _expected(
    camera: PinholeCamera, kind: int, place: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "2 3"]]:
    """The marks of a block in a place, and how the first two move with it (pixels a metre)."""
    expected = _marks(camera, kind, place)
    slopes = [
        (_marks(camera, kind, place + step) - expected)[:2] / 1e-3 for step in np.eye(3) * 1e-3
    ]
    return expected, np.array(slopes).T


def _marks(
    camera: PinholeCamera, kind: int, place: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Middle of the sides, lower edge, and width of a block's box, in pixels of the picture."""
    shape = _SHAPES[kind // len(_COLORS)]
    block = Block(_COLORS[kind % len(_COLORS)], shape, Cell(0, 0, 0))
    corners = drawn_corners((block,), BlockPoses(place[None], np.eye(3)[None]))[0]
    pixels = camera.project(corners) + 0.5  # boxes speak of edges
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return np.array([(low[0] + high[0]) / 2, high[1], high[0] - low[0]])
