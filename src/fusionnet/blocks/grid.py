"""Cells, blocks, layouts, scenes and moves: the words in which everything else speaks.

A *cell* (x, y, z) addresses the 8x8x8 grid: x 0 is nearest the robot, y 0 is
right-most in its view, z 0 stands on the table (thesis, section 3.1).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from fusionnet.rcl.values import Color as Color

GRID = 8
"""Cells along each side of the grid."""

BLOCK_SIZE = 0.0263
"""Edge of a block and of a square of the checkerboard, in metres (thesis 3.3.2)."""


class Shape(StrEnum):
    """The two shapes; a prism is drawn as a pyramid, as in the thesis (3.2.4)."""

    CUBE = "cube"
    PRISM = "prism"


class Cell(NamedTuple):
    """One cell of the grid; see the module's docstring for its axes."""

    x: int
    y: int
    z: int

    @property
    def index(self) -> int:  # type: ignore[override]
        """Position in a flattened (x, y, z) array of 512 cells."""
        return (self.x * GRID + self.y) * GRID + self.z

    @property
    def on_grid(self) -> bool:
        """Whether all three coordinates are 0 to 7."""
        return all(0 <= c < GRID for c in self)

    @classmethod
    def from_index(cls, index: int) -> "Cell":
        """The inverse of `index`."""
        return cls(index // GRID**2, index // GRID % GRID, index % GRID)


CLASS_NAMES = tuple(f"{shape}_{color}" for shape in Shape for color in Color)
"""The 16 classes, named as in thesis table 6.2; `Block.class_index` points into it."""

EMPTY = len(CLASS_NAMES)
"""The class of a cell without a block, after those of `CLASS_NAMES`."""

_CLASS_INDEX = {
    (shape, color): number * len(Color) + index
    for number, shape in enumerate(Shape)
    for index, color in enumerate(Color)
}


@dataclass(frozen=True)
class Block:
    """One coloured block in one cell."""

    color: Color
    shape: Shape
    cell: Cell

    @property
    def class_index(self) -> int:
        """Index into `CLASS_NAMES`: 0 to 7 cubes, 8 to 15 prisms."""
        return _CLASS_INDEX[self.shape, self.color]


@dataclass(frozen=True)
class Gripper:
    """Where the gripper is, and whether it is closed (which means: holds the block there)."""

    cell: Cell
    closed: bool = False


@dataclass(frozen=True)
class Layout:
    """Blocks and gripper at one moment; a held block stands at the gripper's cell."""

    blocks: tuple[Block, ...]
    gripper: Gripper = field(default_factory=lambda: Gripper(Cell(6, 5, 4)))
    id: int | None = None

    @cached_property
    def held(self) -> Block | None:
        """The block in the closed gripper, if there is one."""
        if not self.gripper.closed:
            return None
        return next((b for b in self.blocks if b.cell == self.gripper.cell), None)

    @cached_property
    def columns(self) -> Mapping[tuple[int, int], tuple[Block, ...]]:
        """The resting blocks of every column (x, y) that has any, from the bottom up."""
        columns: dict[tuple[int, int], list[Block]] = {}
        for block in self.blocks:
            if block is not self.held:
                columns.setdefault(block.cell[:2], []).append(block)
        return {
            place: tuple(sorted(column, key=lambda block: block.cell.z))
            for place, column in columns.items()
        }

    @property
    def cell_classes(self) -> Int[np.ndarray, "8 8 8"]:
        """The class of the block in each cell, `EMPTY` where there is none."""
        cells = np.full((GRID, GRID, GRID), EMPTY)
        for block in self.blocks:
            cells[block.cell] = block.class_index
        return cells

    def at(self, cell: Cell) -> Block | None:
        """The block in a cell, if there is one."""
        return next((b for b in self.blocks if b.cell == cell), None)

    @property
    def resting(self) -> frozenset[Block]:
        """All blocks but the held one."""
        held = self.held
        return frozenset(block for block in self.blocks if block is not held)

    def same_blocks(self, other: "Layout") -> bool:
        """Whether both hold the same blocks in the same cells, and hold alike.

        The level at which a block is held does not count: in the treebank it
        follows no rule.
        """
        mine, its = self.held, other.held
        if mine is None or its is None:
            return mine is its and set(self.blocks) == set(other.blocks)
        alike = (mine.color, mine.shape, mine.cell[:2]) == (its.color, its.shape, its.cell[:2])
        return alike and self.resting == other.resting


@dataclass(frozen=True)
class Scene:
    """The layout before and the layout after a command."""

    before: Layout
    after: Layout
    id: int | None = None
    group: int | None = None


@dataclass(frozen=True)
class Move:
    """What a command asks of the arm: one block goes from one cell to another.

    A *take* ends with the block held; a *drop* begins so.
    """

    source: Cell
    target: Cell
    begins_held: bool = False
    ends_held: bool = False
