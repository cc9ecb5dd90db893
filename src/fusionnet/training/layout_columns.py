"""Layouts as columns of blocks, which are easy to edit and cannot float."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fusionnet.blocks import GRID, Block, Cell, Color, Gripper, Layout, Shape

Column = tuple[int, int]
"""The (x, y) of a column of cells."""


@dataclass
class Columns:
    """A layout that is easy to edit: what stands in each column, and what is held where."""

    standing: dict[Column, list[tuple[Shape, Color]]]
    held: tuple[Shape, Color, Cell] | None = None

    @classmethod
    def of(cls, layout: Layout) -> "Columns":
        """The columns of a layout."""
        standing: dict[Column, list[tuple[Shape, Color]]] = {}
        held = layout.held
        for block in sorted(layout.blocks, key=lambda b: b.cell.z):
            if block is not held:
                x, y, _ = block.cell
                standing.setdefault((x, y), []).append((block.shape, block.color))
        hanging = None if held is None else (held.shape, held.color, held.cell)
        return cls(standing, hanging)

    def layout(self, colors: Mapping[Color, Color], mirrored: bool = False) -> Layout:
        """The layout, its colours exchanged and perhaps its left and right."""

        def block(shape: Shape, color: Color, x: int, y: int, z: int) -> Block:
            return Block(colors[color], shape, Cell(x, GRID - 1 - y if mirrored else y, z))

        blocks = [
            block(shape, color, x, y, z)
            for (x, y), column in self.standing.items()
            for z, (shape, color) in enumerate(column)
        ]
        if self.held is None:
            return Layout(tuple(blocks))
        shape, color, cell = self.held
        hanging = block(shape, color, *cell)
        return Layout((*blocks, hanging), Gripper(hanging.cell, closed=True))

    def hold_one(self, rng: np.random.Generator) -> None:
        """Take a block from the top of a column and hold it over another one, or the same."""
        if self.held is not None or not self.standing:
            return
        columns = list(self.standing)
        column = columns[rng.integers(len(columns))]
        shape, color = self.standing[column].pop()
        if not self.standing[column]:
            del self.standing[column]
        if rng.random() < 0.3:
            column = (int(rng.integers(GRID)), int(rng.integers(GRID)))
        lowest = min(GRID - 1, len(self.standing.get(column, ())) + 1)
        height = int(rng.integers(lowest, GRID))
        if height >= len(self.standing.get(column, ())):
            self.held = (shape, color, Cell(*column, height))

    def edit(self, rng: np.random.Generator, hues: Sequence[Color]) -> None:
        """Add, remove and repaint a few blocks."""
        for _ in range(rng.integers(1, 6)):
            column = (int(rng.integers(GRID)), int(rng.integers(GRID)))
            if self.standing and rng.random() < 0.6:
                columns = list(self.standing)
                column = columns[rng.integers(len(columns))]
            blocks = self.standing.setdefault(column, [])
            kind = rng.random()
            if kind < 0.55:
                self._stack(column, rng, hues)
            elif kind < 0.75 and blocks:
                place = int(rng.integers(len(blocks)))
                blocks[place] = (blocks[place][0], hues[int(rng.integers(len(hues)))])
            elif blocks:
                blocks.pop()
            if not blocks:
                del self.standing[column]

    def _stack(self, column: Column, rng: np.random.Generator, hues: Sequence[Color]) -> None:
        blocks = self.standing[column]
        below = self.held[2].z - 1 if self.held and self.held[2][:2] == column else GRID
        if len(blocks) >= below or (blocks and blocks[-1][0] is Shape.PRISM):
            return
        color = hues[int(rng.integers(len(hues)))]
        if blocks and rng.random() < 0.4:
            color = blocks[-1][1]
        blocks.append((Shape.PRISM if rng.random() < 0.3 else Shape.CUBE, color))


def random_columns(rng: np.random.Generator, hues: Sequence[Color]) -> Columns:
    """Some columns of some colours, anywhere."""
    columns = Columns({})
    for _ in range(int(rng.integers(2, 6 if rng.random() < 0.5 else 25))):
        column = (int(rng.integers(GRID)), int(rng.integers(GRID)))
        if rng.random() < 0.2:
            column = (int(rng.choice([0, GRID - 1])), int(rng.choice([0, GRID - 1])))
        if column in columns.standing:
            continue
        columns.standing[column] = []
        for _ in range(min(GRID - 1, int(rng.geometric(0.55)))):
            columns._stack(column, rng, hues)
    return columns
