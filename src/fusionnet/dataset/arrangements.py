"""Tables that people build with intent: walls, rows, stairs, rings, layers, matching towers.

What is hard to see is regular: rows seen end-on, walls with a colour a level, columns
that all carry a pyramid, blocks hidden behind others. Few tables of a corpus are like
that, so that a detector meets too few of them unless they are made.
"""

from collections.abc import Callable

import numpy as np

from fusionnet.blocks import GRID, Block, Cell, Color, Shape

Columns = dict[tuple[int, int], list[Block]]
"""Blocks by column from the table up; their cells do not matter yet."""

MOST_BLOCKS = 120
"""The most blocks on one table, as in the treebank."""

_COLORS = tuple(Color)


def arranged_columns(rng: np.random.Generator) -> Columns:
    """One to five arrangements, later ones beside or upon earlier ones."""
    palette = [_COLORS[i] for i in rng.permutation(len(_COLORS))[: rng.choice([2, 3, 4, 6, 8])]]
    table: Columns = {}
    for _ in range(rng.choice([1, 2, 3, 4, 5], p=[0.15, 0.25, 0.25, 0.2, 0.15])):
        kind = _ARRANGEMENTS[rng.choice(len(_ARRANGEMENTS), p=_SHARES)]
        paint, heights = _painter(rng, palette), kind(rng)
        crown = _crown(rng, palette)
        for (x, y), height in heights.items():
            column = table.setdefault((x, y), [])
            if column and (column[-1].shape is Shape.PRISM or rng.random() < 0.3):
                continue
            for z in range(len(column), min(GRID - 1, len(column) + height)):
                column.append(Block(paint(x, y, z), Shape.CUBE, Cell(x, y, z)))
            on_top = crown(x, y)
            if on_top is not None and len(column) < GRID - 1:
                column.append(Block(on_top, Shape.PRISM, Cell(x, y, len(column))))
    return _at_most(rng, {place: column for place, column in table.items() if column}, MOST_BLOCKS)


def _at_most(rng: np.random.Generator, table: Columns, most: int) -> Columns:
    """Fewer columns if there are too many blocks."""
    kept, count = {}, 0
    for i in rng.permutation(len(table)):
        place, column = list(table.items())[i]
        if count + len(column) <= most:
            kept[place], count = column, count + len(column)
    return kept


Heights = dict[tuple[int, int], int]


def _rectangle(rng: np.random.Generator, widths: list[int], depths: list[int]) -> list[Cell]:
    """The squares of a rectangle somewhere on the board, as cells of the table, turned or not."""
    wide, deep = int(rng.choice(widths)), int(rng.choice(depths))
    if rng.random() < 0.5:
        wide, deep = deep, wide
    x, y = int(rng.integers(GRID - wide + 1)), int(rng.integers(GRID - deep + 1))
    return [Cell(x + i, y + j, 0) for i in range(wide) for j in range(deep)]


def _wall(rng: np.random.Generator) -> Heights:
    height = int(rng.choice([1, 2, 3, 4, 5], p=[0.25, 0.25, 0.25, 0.15, 0.1]))
    squares = _rectangle(rng, [1, 1, 1, 2], [2, 3, 4, 5, 6, 8, 8])
    return {cell[:2]: height for cell in squares}


def _box(rng: np.random.Generator) -> Heights:
    height = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2]))
    squares = _rectangle(rng, [2, 2, 3, 4], [2, 3, 4, 5])
    ring = rng.random() < 0.3
    low, high = squares[0], squares[-1]
    inner = {c for c in squares if low.x < c.x < high.x and low.y < c.y < high.y}
    return {c[:2]: height for c in squares if not (ring and c in inner)}


def _pyramids(rng: np.random.Generator) -> Heights:
    """No cubes at all: what stands there is the crown."""
    return {cell[:2]: 0 for cell in _rectangle(rng, [1, 2, 3], [2, 3, 4, 6, 8])}


def _stairs(rng: np.random.Generator) -> Heights:
    squares = _rectangle(rng, [1, 1, 2, 3], [3, 4, 5, 6])
    low, high = squares[0], squares[-1]
    along = 0 if high.x - low.x > high.y - low.y else 1
    down = rng.random() < 0.5
    return {c[:2]: (high[along] - c[along] if down else c[along] - low[along]) + 1 for c in squares}


def _towers(rng: np.random.Generator) -> Heights:
    """Equal towers in a regular pattern, or towers of any height anywhere."""
    step = int(rng.choice([2, 3, 7]))
    height = int(rng.choice([1, 2, 3, 4, 6]))
    if rng.random() < 0.5:
        count = int(rng.integers(2, 7))
        places = rng.integers(GRID, size=(count, 2))
        return {(int(x), int(y)): int(rng.integers(1, 6)) for x, y in places}
    x, y = int(rng.integers(step)), int(rng.integers(step))
    rows = range(y, GRID, step) if rng.random() < 0.5 else [y]
    return {(i, j): height for i in range(x, GRID, step) for j in rows}


def _singles(rng: np.random.Generator) -> Heights:
    places = rng.integers(GRID, size=(int(rng.integers(3, 16)), 2))
    return {(int(x), int(y)): int(rng.random() < 0.6) for x, y in places}


_ARRANGEMENTS: tuple[Callable[[np.random.Generator], Heights], ...] = (
    _wall,
    _box,
    _pyramids,
    _stairs,
    _towers,
    _singles,
)
_SHARES = (0.32, 0.15, 0.08, 0.1, 0.2, 0.15)

Painter = Callable[[int, int, int], Color]


def _painter(rng: np.random.Generator, palette: list[Color]) -> Painter:
    """A pattern of colours: one, or by level, row, square, height and row together, or any."""
    order = [palette[i] for i in rng.permutation(len(palette))[: max(2, rng.integers(1, 5))]]
    pattern = rng.choice(6, p=[0.25, 0.25, 0.15, 0.12, 0.08, 0.15])
    axis = int(rng.integers(2))

    def paint(x: int, y: int, z: int) -> Color:
        if pattern == 5:
            return palette[int(rng.integers(len(palette)))]
        place = (x, y)[axis]
        number = (0, z, place, x + y, z + place)[pattern]
        return order[number % len(order)]

    return paint


def _crown(rng: np.random.Generator, palette: list[Color]) -> Callable[[int, int], Color | None]:
    """Which columns carry a pyramid: none, all in one colour, all in any, or some."""
    share = float(rng.choice([0.0, 1.0, 0.5, 0.15], p=[0.45, 0.3, 0.1, 0.15]))
    color = palette[int(rng.integers(len(palette)))]
    mixed = rng.random() < 0.3

    def crown(x: int, y: int) -> Color | None:
        if rng.random() >= share:
            return None
        return palette[int(rng.integers(len(palette)))] if mixed else color

    return crown
