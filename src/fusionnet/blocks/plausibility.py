"""What must be physically true of a layout that was read with doubt, and layouts drawn from it.

A reader gives each cell its own probabilities; real columns stand on the table without
gaps, a prism carries nothing, and at most one block hangs in the air, the held one.
Bayes' rule over the possible heights of a column turns cells into columns that obey
this: with filling probabilities f, height h has the weight
prod_{z<h} f_z prod_{z>=h} (1 - f_z), and a held block at z >= h turns 1 - f_z into f_z.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, Integer

from fusionnet.blocks.grid import (
    CLASS_NAMES,
    EMPTY,
    GRID,
    Block,
    Cell,
    Color,
    Gripper,
    Layout,
    Shape,
)
from fusionnet.errors import InputError

COLUMNS = GRID**2
CELLS = GRID**3
CLASSES = len(CLASS_NAMES)
COLORS = len(Color)
NOTHING_HELD = -1
FLOOR = 1e-4
ROUNDING = 1e-4
"""Probabilities may be this far outside 0 to 1: they come from arithmetic in single precision."""

NEGLIGIBLE = 3e-3
"""Doubts below this are not drawn: there are hundreds of cells."""

_BLOCKS = [
    [Block(color, shape, Cell.from_index(cell)) for shape in Shape for color in Color]
    for cell in range(CELLS)
]


def layout_from_classes(classes: Integer[np.ndarray, "512"], held: int = NOTHING_HELD) -> Layout:
    """A layout from the class of each cell (16: empty) and the held block's cell index."""
    filled = np.flatnonzero(classes != EMPTY)
    kinds = classes[filled].tolist()
    blocks = tuple(_BLOCKS[c][kind] for c, kind in zip(filled.tolist(), kinds, strict=True))
    if held == NOTHING_HELD:
        return Layout(blocks)
    return Layout(blocks, Gripper(Cell.from_index(int(held)), closed=True))


class PlausibleLayouts:
    """The layouts that may lie behind a reader's probabilities.

    Args:
        occupancy: Probabilities of the 16 classes of `CLASS_NAMES` and of emptiness.
        holding: Probability that the gripper holds a block.

    Raises:
        InputError: If an array has the wrong shape or a value is not a probability.
    """

    def __init__(self, occupancy: Float[np.ndarray, "8 8 8 17"], holding: float) -> None:
        cells = np.asarray(occupancy, dtype=float)
        if cells.shape != (GRID, GRID, GRID, CLASSES + 1):
            raise InputError(f"The occupancy must have shape (8, 8, 8, 17), not {cells.shape}.")
        within = (cells >= -ROUNDING) & (cells <= 1 + ROUNDING)  # false where not a number
        if not (within.all() and 0 <= holding <= 1):
            raise InputError("The occupancy and holding must be probabilities, from 0 to 1.")
        self.holding = float(holding)
        self.masses = cells.reshape(CELLS, CLASSES + 1)[:, :CLASSES]
        filled = 1 - cells.reshape(COLUMNS, GRID, CLASSES + 1)[..., CLASSES]
        self.filled = filled.clip(FLOOR, 1 - FLOOR)

    @cached_property
    def _weights(self) -> Float[np.ndarray, "64 9"]:
        """Log weights of the heights 0 to 8 of each column."""
        log_filled, log_empty = np.log(self.filled), np.log1p(-self.filled)
        below = np.pad(log_filled.cumsum(1), ((0, 0), (1, 0)))
        above = np.pad(log_empty[:, ::-1].cumsum(1)[:, ::-1], ((0, 0), (0, 1)))
        return below + above

    @cached_property
    def heights(self) -> Float[np.ndarray, "64 9"]:
        """Probabilities of the heights of each column, were no block held above it."""
        weights = np.exp(self._weights - self._weights.max(1, keepdims=True))
        return weights / weights.sum(1, keepdims=True)

    @cached_property
    def hanging(self) -> Float[np.ndarray, "64 9 8"]:
        """If a block is held: probability of column, height below it and its level."""
        odds = np.log(self.filled) - np.log1p(-self.filled)
        log = np.log(self.heights + 1e-300)[:, :, None] + odds[:, None, :]
        log[:, np.arange(GRID)[None, :] < np.arange(GRID + 1)[:, None]] = -np.inf
        weights = np.exp(log - log.max())
        return weights / weights.sum()

    @cached_property
    def classes(self) -> Float[np.ndarray, "2 512 16"]:
        """Probabilities of the classes of a filled cell: uncovered, and covered (no prism)."""
        masses = self.masses + FLOOR / CLASSES
        covered = np.zeros_like(masses)
        covered[:, :COLORS] = masses[:, :COLORS] + masses[:, COLORS:]
        both = np.stack([masses, covered])
        return both / both.sum(2, keepdims=True)

    def likeliest(self) -> Layout:
        """The most likely layout: each column at its most likely height, and so on."""
        heights, held = self.heights.argmax(1), NOTHING_HELD
        if self.holding > 0.5:
            column, height, level = np.unravel_index(self.hanging.argmax(), self.hanging.shape)
            heights[column], held = height, int(column * GRID + level)
        best = self.classes.argmax(2)
        return layout_from_classes(
            _filled_in(heights[None], np.array([held]), best[:, None])[0], held
        )

    def draw(self, rng: np.random.Generator, samples: int) -> "DrawnLayouts":
        """Some layouts at random, as classes of cells."""
        heights = _drawn(_pruned(self.heights), rng, samples)
        held = np.full(samples, NOTHING_HELD)
        holds = np.flatnonzero(rng.random(samples) < _pruned_one(self.holding))
        if len(holds):
            flat = _drawn(_pruned(self.hanging.reshape(1, -1)), rng, len(holds))[:, 0]
            column, height, level = np.unravel_index(flat, self.hanging.shape)
            heights[holds, column] = height
            held[holds] = column * GRID + level
        doubtful = np.flatnonzero(1 - self.masses.sum(1) < 1 - NEGLIGIBLE)
        kinds = np.zeros((2, samples, CELLS), dtype=np.int64)
        for covered in range(2):
            chances = _pruned(self.classes[covered, doubtful])
            kinds[covered][:, doubtful] = _drawn(chances, rng, samples)
        return DrawnLayouts(_filled_in(heights, held, kinds), held)


@dataclass(frozen=True)
class DrawnLayouts:
    """Layouts as arrays.

    Attributes:
        classes: The class of each cell of each layout, 16 for empty.
        held: Index of the held block's cell, or -1.
    """

    classes: Int[np.ndarray, "s 512"]
    held: Int[np.ndarray, " s"]

    def layout(self, place: int) -> Layout:
        """One of them."""
        return layout_from_classes(self.classes[place], int(self.held[place]))


def _filled_in(
    heights: Int[np.ndarray, "s 64"],
    held: Int[np.ndarray, " s"],
    kinds: Int[np.ndarray, "2 s 512"],
) -> Int[np.ndarray, "s 512"]:
    """The class of each cell, from heights, held cells and the classes if filled."""
    level = np.arange(GRID)
    stands = (level < heights[:, :, None]).reshape(len(heights), CELLS)
    covered = (level < heights[:, :, None] - 1).reshape(len(heights), CELLS)
    classes = np.where(stands, np.where(covered, kinds[1], kinds[0]), EMPTY)
    holds = np.flatnonzero(held != NOTHING_HELD)
    classes[holds, held[holds]] = kinds[0][holds, held[holds]]
    return classes


def _pruned(chances: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Distributions without their negligible parts."""
    kept = np.where(chances < NEGLIGIBLE, 0.0, chances)
    kept = np.where(kept.sum(1, keepdims=True) > 0, kept, chances)
    return kept / kept.sum(1, keepdims=True)


def _pruned_one(chance: float) -> float:
    return 0.0 if chance < NEGLIGIBLE else 1.0 if chance > 1 - NEGLIGIBLE else chance


def _drawn(
    chances: Float[np.ndarray, "n k"], rng: np.random.Generator, samples: int
) -> Int[np.ndarray, "s n"]:
    """Draws from n distributions; those that are certain are not drawn."""
    result = np.broadcast_to(chances.argmax(1), (samples, len(chances))).copy()
    doubtful = np.flatnonzero(chances.max(1) < 1)
    if len(doubtful):
        upper = chances[doubtful].cumsum(1)
        point = rng.random((samples, len(doubtful), 1)) * upper[:, -1:]
        result[:, doubtful] = (point >= upper).sum(2).clip(0, chances.shape[1] - 1)
    return result
