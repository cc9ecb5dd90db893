"""Layouts as a reader sees them: sure of what shows, unsure of what hides.

Simulates the errors of a trained reader without a picture, so that a network that
acts on its probabilities can be trained on unlimited layouts: blocks behind or below
others keep only a vague colour, some cells hold phantoms, blue and cyan as well as
gray and white are confused. How bad a reading is varies from none to severe.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from fusionnet.blocks import EMPTY, GRID, Color, Layout
from fusionnet.blocks.plausibility import CLASSES, COLORS, NOTHING_HELD

_CONFUSED = {
    Color.BLUE: Color.CYAN,
    Color.CYAN: Color.BLUE,
    Color.RED: Color.MAGENTA,
    Color.YELLOW: Color.GREEN,
    Color.GREEN: Color.YELLOW,
    Color.MAGENTA: Color.RED,
    Color.GRAY: Color.WHITE,
    Color.WHITE: Color.GRAY,
}
_LOOKS_LIKE = np.array([list(Color).index(_CONFUSED[c]) for c in Color])
_OFTEN = np.array([c in (Color.BLUE, Color.CYAN, Color.GRAY, Color.WHITE) for c in Color])


def cells_of(layouts: Sequence[Layout]) -> tuple[Int[np.ndarray, "b 8 8 8"], Int[np.ndarray, " b"]]:
    """The class of each cell (16: empty), and the held block's cell index (-1: none)."""
    held = [NOTHING_HELD if each.held is None else each.held.cell.index for each in layouts]
    cells = np.array([each.cell_classes for each in layouts], dtype=int)
    return cells.reshape(-1, GRID, GRID, GRID), np.array(held, dtype=int)


def exact_readings(
    cells: Int[np.ndarray, "b 8 8 8"], held: Int[np.ndarray, " b"]
) -> tuple[Float[np.ndarray, "b 8 8 8 17"], Float[np.ndarray, " b"]]:
    """What a reader without error would say."""
    occupancy = np.eye(CLASSES + 1, dtype=np.float32)[cells]
    return occupancy, (held != NOTHING_HELD).astype(np.float32)


def simulated_readings(
    cells: Int[np.ndarray, "b 8 8 8"],
    held: Int[np.ndarray, " b"],
    rng: np.random.Generator,
    severity: Float[np.ndarray, " b"] | None = None,
) -> tuple[Float[np.ndarray, "b 8 8 8 17"], Float[np.ndarray, " b"]]:
    """Occupancy probabilities and the probability of a held block, with a reader's errors.

    Args:
        cells: Class of each cell, 16 for empty.
        held: Index of the held block's cell, or -1.
        rng: Source of the errors.
        severity: How bad each reading is, 0 (exact) to 1; random where not given.
    """
    batch = len(cells)
    if severity is None:
        severity = rng.uniform(0, 1, batch)
    bad = severity[:, None, None, None]
    filled = cells != EMPTY
    shows = _visibility(filled)
    present = _presence(filled, shows, bad, rng)
    classes = _class_doubts(cells, filled, shows, bad, rng)
    occupancy = np.concatenate([classes * present[..., None], 1 - present[..., None]], axis=-1)
    sure = 1 - severity * rng.beta(1, 12, batch)
    holding = np.where(held != NOTHING_HELD, sure, 1 - sure)
    return occupancy.astype(np.float32), holding.astype(np.float32)


def _visibility(filled: np.ndarray) -> Float[np.ndarray, "b 8 8 8"]:
    """How much of each cell the robot's eyes see, looking down along x at about 45 degrees."""
    clear = ~filled
    padded = np.pad(clear, ((0, 0), (GRID, 0), (0, 0), (0, GRID + 1)), constant_values=True)

    def open_way(behind: int, higher: int) -> np.ndarray:
        """Whether the cells on the way to the eye, beginning at an offset, are empty."""
        way = np.ones_like(filled)
        for step in range(GRID - max(behind, higher)):
            x, z = GRID - behind - step, higher + step
            way &= padded[:, x : x + GRID, :, z : z + GRID]
        return way

    front = 0.5 * open_way(1, 0) + 0.5 * open_way(1, 1)
    top = 0.5 * open_way(0, 1) + 0.5 * open_way(1, 1)
    front *= padded[:, GRID - 1 : 2 * GRID - 1, :, :GRID]
    top *= padded[:, GRID:, :, 1 : GRID + 1]
    return np.maximum(front, top)


def _presence(
    filled: np.ndarray, shows: np.ndarray, bad: np.ndarray, rng: np.random.Generator
) -> Float[np.ndarray, "b 8 8 8"]:
    """Probability that something is in each cell."""
    shape = filled.shape
    supported = np.zeros_like(filled)
    supported[..., :-1] = filled[..., 1:]
    sure = 1 - bad * rng.beta(0.3, 15, shape)
    vague = 1 - bad * rng.beta(1.5, 2.5, shape)
    covered = 1 - bad * rng.beta(0.6, 6, shape)
    of_block = np.where(shows > 0.3, sure, np.where(supported, covered, vague))
    # A block on the table that shows little may be missed; empty space behind others is unsure.
    missed = (shows < 0.6) & ~supported & (rng.random(shape) < 0.05 * bad)
    of_block = np.where(missed, rng.uniform(0.2, 0.8, shape), of_block)
    unseen = bad * rng.beta(0.4, 6, shape)
    clean = bad * rng.beta(0.15, 40, shape)
    of_space = np.where(shows > 0.3, clean, unseen)
    near = np.zeros_like(filled)
    near[..., 1:] |= filled[..., :-1]
    near[:, 1:, :, 0] |= filled[:, :-1, :, 0]
    near[:, :, 1:, 0] |= filled[:, :, :-1, 0]
    rate = np.where(near, 0.02, 0.0005) * bad
    phantom = ~filled & (rng.random(shape) < rate)
    of_space = np.where(phantom, rng.uniform(0.02, 0.55, shape), of_space)
    return np.clip(np.where(filled, of_block, of_space), 0, 1)


def _class_doubts(
    cells: np.ndarray,
    filled: np.ndarray,
    shows: np.ndarray,
    bad: np.ndarray,
    rng: np.random.Generator,
) -> Float[np.ndarray, "b 8 8 8 16"]:
    """Probabilities of the 16 classes, if something is in the cell."""
    shape = filled.shape
    guess = rng.integers(0, CLASSES, shape)
    # Where nothing shows, the guess follows what stands above, or in front.
    above = np.concatenate([cells[..., 1:], np.full((*shape[:3], 1), EMPTY)], axis=-1)
    guess = np.where((above != EMPTY) & (rng.random(shape) < 0.6), above % COLORS, guess)
    truth = np.where(filled, cells, guess)
    color, prism = truth % COLORS, truth // COLORS
    often = np.where(_OFTEN[color], 0.04, 0.008)
    confused = rng.random(shape) < often * bad * (1 + 2 * (shows < 0.6))
    other_color = np.where(confused, rng.uniform(0.1, 0.85, shape), bad * rng.beta(0.3, 20, shape))
    misshaped = rng.random(shape) < 0.01 * bad * (1 + 4 * (shows < 0.6))
    other_shape = np.where(misshaped, rng.uniform(0.1, 0.7, shape), bad * rng.beta(0.3, 30, shape))
    one = np.eye(COLORS)
    colors = one[color] * (1 - other_color)[..., None]
    colors += one[_LOOKS_LIKE[color]] * other_color[..., None]
    hidden = np.where(shows > 0.3, 0.0, np.where(shows > 0, 0.3, 1.0)) * bad
    hidden = (hidden * rng.beta(3, 1.5, shape))[..., None]
    spread = rng.exponential(1.0, (*shape, COLORS)) + 2.0 * one[guess % COLORS]
    colors = (1 - hidden) * colors + hidden * spread / spread.sum(-1, keepdims=True)
    prisms = np.where(prism == 1, 1 - other_shape, other_shape)
    prisms = (1 - hidden[..., 0]) * prisms + hidden[..., 0] * rng.beta(1, 6, shape)
    return np.concatenate([colors * (1 - prisms)[..., None], colors * prisms[..., None]], axis=-1)
