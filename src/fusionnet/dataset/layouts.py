"""Layouts to learn from: variations of real ones, arranged ones, and random ones.

A corpus has a few hundred layouts, far too few to learn to see. Colours permuted,
the table mirrored or turned, two tables merged, blocks removed, swapped or picked up:
each variation is a layout that could have been in the corpus.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fusionnet.blocks import GRID, Block, Cell, Color, Gripper, Layout, Shape, random_layout
from fusionnet.dataset.arrangements import Columns, arranged_columns

ARRANGED = 0.75
"""Share of `arrangements` among the invented layouts; the rest is `random_layout`'s."""


def varied_layout(rng: np.random.Generator, real: Sequence[Layout], *, invented: float) -> Layout:
    """A layout to learn from.

    Args:
        rng: Source of all randomness.
        real: Layouts of the training groups; may be empty.
        invented: Share of layouts that our own generators make up; all if there are no real ones.
    """
    if not real or rng.random() < invented:
        if rng.random() >= ARRANGED:
            return random_layout(rng)
        return _finish(rng, arranged_columns(rng), held=0.12)
    layout = real[int(rng.integers(len(real)))]
    if rng.random() < 0.1:
        return layout
    columns = _columns(layout)
    if rng.random() < 0.35:
        columns = _merge(rng, columns, _columns(real[int(rng.integers(len(real)))]))
    columns = _turn(rng, columns)
    columns = _recolor(rng, columns)
    return _finish(rng, columns, 0.6 if layout.gripper.closed else 0.1)


def _finish(rng: np.random.Generator, columns: Columns, held: float) -> Layout:
    """The layout of these columns with some last edits; with the chance `held` one is picked up."""
    _edit(rng, columns)
    blocks = [
        replace(block, cell=Cell(x, y, z))
        for (x, y), column in columns.items()
        for z, block in enumerate(column)
    ]
    if blocks and rng.random() < held:
        return _pick_up(rng, blocks)
    return Layout(tuple(blocks), Gripper(Cell(GRID - 1, GRID - 1, GRID - 1)))


def _columns(layout: Layout) -> Columns:
    """Blocks by column from the table up; a held block is left out."""
    columns: Columns = {}
    for block in sorted(layout.blocks, key=lambda b: b.cell.z):
        if block is not layout.held:
            columns.setdefault((block.cell.x, block.cell.y), []).append(block)
    return columns


def _merge(rng: np.random.Generator, one: Columns, other: Columns) -> Columns:
    """One side of a random line from one table, the other side from the other."""
    axis, border = int(rng.integers(2)), int(rng.integers(1, GRID))
    first = {place: column for place, column in one.items() if place[axis] < border}
    return first | {place: column for place, column in other.items() if place[axis] >= border}


def _turn(rng: np.random.Generator, columns: Columns) -> Columns:
    """Mirror and transpose at random: the eight symmetries of the board."""
    flip_x, flip_y, swap = rng.random(3) < 0.5
    turned: Columns = {}
    for (x, y), column in columns.items():
        x, y = (GRID - 1 - x if flip_x else x), (GRID - 1 - y if flip_y else y)
        turned[(y, x) if swap else (x, y)] = column
    return turned


def _recolor(rng: np.random.Generator, columns: Columns) -> Columns:
    """Permute the colours of the whole table, and sometimes recolour single blocks."""
    colors = list(Color)
    order = rng.permutation(len(colors)) if rng.random() < 0.85 else np.arange(len(colors))
    renamed = {color: colors[i] for color, i in zip(colors, order, strict=True)}
    single = rng.choice([0.0, 0.05, 0.4], p=[0.5, 0.35, 0.15])

    def paint(block: Block) -> Block:
        chosen = colors[rng.integers(len(colors))] if rng.random() < single else None
        return replace(block, color=chosen or renamed[block.color])

    return {place: [paint(b) for b in column] for place, column in columns.items()}


def _edit(rng: np.random.Generator, columns: Columns) -> None:
    """Remove, add and reshape blocks on the tops of columns, in place."""
    for place in list(columns):
        column = columns[place]
        chance = rng.random()
        if chance < 0.06:
            column.pop()
        elif chance < 0.12 and len(column) < GRID - 1 and column[-1].shape is Shape.CUBE:
            column.append(_random_block(rng))
        elif chance < 0.20:
            shape = Shape.PRISM if column[-1].shape is Shape.CUBE else Shape.CUBE
            column[-1] = replace(column[-1], shape=shape)
        if not column:
            del columns[place]
    for _ in range(rng.choice([0, 1, 2, 4], p=[0.4, 0.3, 0.2, 0.1])):
        place = (int(rng.integers(GRID)), int(rng.integers(GRID)))
        column = columns.setdefault(place, [])
        if len(column) < GRID - 1 and (not column or column[-1].shape is Shape.CUBE):
            column.append(_random_block(rng))


def _random_block(rng: np.random.Generator) -> Block:
    color = list(Color)[rng.integers(len(Color))]
    return Block(color, Shape.PRISM if rng.random() < 0.3 else Shape.CUBE, Cell(0, 0, 0))


def _pick_up(rng: np.random.Generator, blocks: list[Block]) -> Layout:
    """Some column's top block in the gripper, at least two cells above what stands below."""
    heights = np.zeros((GRID, GRID), int)
    for block in blocks:
        heights[block.cell.x, block.cell.y] = max(
            heights[block.cell.x, block.cell.y], block.cell.z + 1
        )
    tops = [b for b in blocks if b.cell.z + 1 == heights[b.cell.x, b.cell.y]]
    taken = tops[rng.integers(len(tops))]
    heights[taken.cell.x, taken.cell.y] -= 1
    x, y = (int(v) for v in rng.integers(GRID, size=2))
    low = min(int(heights[x, y]) + 1, GRID - 1)
    if heights[x, y] >= GRID - 1:
        return Layout(tuple(blocks), Gripper(Cell(GRID - 1, GRID - 1, GRID - 1)))
    cell = Cell(x, y, int(rng.integers(low, GRID)))
    rest = tuple(b for b in blocks if b is not taken)
    return Layout((*rest, replace(taken, cell=cell)), Gripper(cell, closed=True))
