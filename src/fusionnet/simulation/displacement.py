"""Blocks that stand beside the middle of their cells, as people put them down."""

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import BLOCK_SIZE, Layout
from fusionnet.simulation.tabletop import BLOCK_HALF

_TRIES = 20


def displacements(
    layout: Layout, farthest: float, rng: np.random.Generator
) -> Float[np.ndarray, "n 2"]:
    """Displaces the top block of each column, where it then touches no other block.

    Args:
        layout: Whose blocks are displaced; a held one is not.
        farthest: Greatest displacement, in metres; uniform over a disc of this radius.
        rng: Source of all randomness.

    Returns:
        Displacement of each block along x and y of the board, in metres.
    """
    centers = np.array([b.cell for b in layout.blocks], dtype=float).reshape(-1, 3) * BLOCK_SIZE
    shifts = np.zeros((len(centers), 2))
    if farthest <= 0.0:
        return shifts
    heights = {(b.cell.x, b.cell.y): 0 for b in layout.blocks}
    for block in layout.blocks:
        column = block.cell.x, block.cell.y
        heights[column] = max(heights[column], block.cell.z)
    for number, block in enumerate(layout.blocks):
        if block.cell.z != heights[block.cell.x, block.cell.y] or block is layout.held:
            continue
        level = np.abs(centers[:, 2] - centers[number, 2]) < 0.5 * BLOCK_SIZE
        level[number] = False
        for _ in range(_TRIES):
            angle, radius = rng.uniform(0.0, 2.0 * np.pi), farthest * np.sqrt(rng.uniform())
            shift = radius * np.array([np.cos(angle), np.sin(angle)])
            apart = np.abs(centers[number, :2] + shift - centers[level, :2] - shifts[level])
            if not (apart < 2 * BLOCK_HALF[0] + 0.0005).all(axis=1).any():
                shifts[number] = shift
                break
    return shifts
