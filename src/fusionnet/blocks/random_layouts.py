"""Layouts by chance, of the kinds that people built for the treebank.

A layout is put together from arrangements: single blocks, towers of one or more
colours, rows and walls, and blocks put on top of what stands there already. Few
colours a layout, so that descriptions need more than a colour to be clear.
"""

from random import Random

import numpy as np

from fusionnet.blocks.grid import GRID, Block, Cell, Color, Gripper, Layout, Shape

_COLORS = tuple(Color)


def random_layout(
    rng: np.random.Generator, *, blocks: int | None = None, held: bool | None = None
) -> Layout:
    """A layout that could stand on a table (`validate` accepts it).

    Args:
        rng: Where chance comes from; one draw is taken from it.
        blocks: How many blocks; by default mostly 4 to 20, at times up to 60.
        held: Whether the gripper holds one of them; by default in one of ten.

    Raises:
        ValueError: If `blocks` is not 1 to 256.
    """
    if blocks is not None and not 1 <= blocks <= GRID**3 // 2:
        raise ValueError(f"a random layout has 1 to {GRID**3 // 2} blocks, not {blocks}")
    chance = Random(int(rng.integers(1 << 62)))
    if blocks is None:
        blocks = min(60, 2 + int(chance.expovariate(1 / 9)) + chance.randrange(4))
    if held is None:
        held = chance.random() < 0.1
    built = _Table(chance, blocks)
    while built.left:
        built.add_arrangement()
    standing = [
        Block(color, shape, Cell(x, y, z))
        for (x, y), column in built.columns.items()
        for z, (color, shape) in enumerate(column)
    ]
    standing.sort(key=lambda block: block.cell)
    gripper = Gripper(Cell(chance.randrange(GRID), chance.randrange(GRID), GRID - 1))
    if held:
        return _with_one_held(standing, built, chance)
    return Layout(tuple(standing), gripper)


def _with_one_held(standing: list[Block], built: "_Table", chance: Random) -> Layout:
    """One block from the top of a column is lifted, over any column with room below it."""
    tops = [b for b in standing if len(built.columns[b.cell[:2]]) == b.cell.z + 1]
    lifted = chance.choice(tops)
    built.columns[lifted.cell[:2]].pop()
    free = [
        (x, y)
        for x in range(GRID)
        for y in range(GRID)
        if len(built.columns.get((x, y), ())) < GRID - 2
    ]
    x, y = lifted.cell[:2] if lifted.cell.z < GRID - 3 else chance.choice(free)
    lowest = len(built.columns.get((x, y), ())) + 1
    cell = Cell(x, y, chance.randint(max(2, lowest), GRID - 1))
    held = Block(lifted.color, lifted.shape, cell)
    return Layout(tuple(held if b is lifted else b for b in standing), Gripper(cell, closed=True))


class _Table:
    """Columns of (colour, shape), from the bottom up, and how many blocks are still to come."""

    def __init__(self, chance: Random, blocks: int) -> None:
        self.chance = chance
        self.left = blocks
        self.palette = chance.sample(_COLORS, chance.randint(2, 6))
        self.columns: dict[tuple[int, int], list[tuple[Color, Shape]]] = {}

    def add_arrangement(self) -> None:
        """Add one arrangement, or as much of it as there is room and blocks for."""
        kind = self.chance.random()
        if self.left > 12 and kind < 0.5:
            self._add_wall()
        elif kind < 0.3:
            self._add_tower()
        elif kind < 0.62:
            self._add_on_top()
        else:
            self._add_single()

    def _put(self, column: tuple[int, int], color: Color, shape: Shape) -> bool:
        """Put a block on a column, if there is one left and it can stand there."""
        below = self.columns.get(column)
        if not self.left or (below and (below[-1][1] is Shape.PRISM or len(below) == GRID)):
            return False
        self.columns.setdefault(column, []).append((color, shape))
        self.left -= 1
        return True

    def _any_color(self) -> Color:
        return self.chance.choice(self.palette)

    def _any_shape(self, prisms: float = 0.35) -> Shape:
        return Shape.PRISM if self.chance.random() < prisms else Shape.CUBE

    def _any_column(self) -> tuple[int, int]:
        """Any column; corners and edges more often than chance has them."""
        chance = self.chance
        place = chance.random()
        if place < 0.15:
            return chance.choice((0, GRID - 1)), chance.choice((0, GRID - 1))
        x, y = chance.randrange(GRID), chance.randrange(GRID)
        if place < 0.25:
            return (chance.choice((0, GRID - 1)), y) if place < 0.2 else (x, chance.choice((0, 7)))
        return x, y

    def _add_single(self) -> None:
        column = self._any_column()
        if column not in self.columns:
            self._put(column, self._any_color(), self._any_shape())
        elif len(self.columns) == GRID**2:
            self._fill()

    def _fill(self) -> None:
        """On a board without a free square: the lowest column that can still grow."""
        growing = [c for c, blocks in self.columns.items() if blocks[-1][1] is not Shape.PRISM]
        if growing:
            lowest = min(growing, key=lambda column: len(self.columns[column]))
            if self._put(lowest, self._any_color(), Shape.CUBE):
                return
        # Every column ends in a pyramid: one of them becomes a cube.
        column = self.chance.choice([c for c, b in self.columns.items() if len(b) < GRID])
        color, _ = self.columns[column][-1]
        self.columns[column][-1] = color, Shape.CUBE

    def _add_on_top(self) -> None:
        if self.columns:
            column = self.chance.choice(list(self.columns))
            if len(self.columns[column]) < 6:
                self._put(column, self._any_color(), self._any_shape(0.45))

    def _add_tower(self) -> None:
        chance = self.chance
        column = self._any_column()
        if column in self.columns:
            return
        colors = [self._any_color() for _ in range(chance.choice((1, 1, 1, 2, 2, 3)))]
        height = chance.choice((2, 2, 2, 3, 3, 4, 5))
        alternating = chance.random() < 0.5
        for level in range(height):
            which = level % len(colors) if alternating else level * len(colors) // height
            self._put(column, colors[which], Shape.CUBE)
        if chance.random() < 0.3:
            self._put(column, self._any_color(), Shape.PRISM)

    def _add_wall(self) -> None:
        """A filled rectangle of squares, in one colour or two, one to three levels high."""
        chance = self.chance
        wide, deep = chance.choice(((1, 3), (1, 5), (1, 8), (2, 2), (3, 3), (8, 1), (4, 1), (2, 4)))
        x0, y0 = chance.randrange(GRID - wide + 1), chance.randrange(GRID - deep + 1)
        first, second = self._any_color(), self._any_color()
        striped = chance.random() < 0.3
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            for x in range(x0, x0 + wide):
                for y in range(y0, y0 + deep):
                    color = second if striped and (x + y) % 2 else first
                    self._put((x, y), color, Shape.CUBE)
