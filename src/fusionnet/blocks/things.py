"""Things that an entity of a tree may stand for: blocks, stacks of cubes, places."""

import math
from collections.abc import Iterable, Mapping

from fusionnet.blocks.grid import GRID, Cell
from fusionnet.rcl import Entity, Indicator, Relation, Type

Column = tuple[int, int]
"""The (x, y) of a column of cells."""

STEPS: Mapping[Relation, Column] = {
    Relation.LEFT: (0, 1),
    Relation.RIGHT: (0, -1),
    Relation.FORWARD: (1, 0),
    Relation.FRONT: (1, 0),
    Relation.BACKWARD: (-1, 0),
}
"""One square in a direction."""

_FAR = GRID - 1


class Thing:
    """One thing that an entity may stand for.

    Attributes:
        cells: Its cells; of a stack from the bottom to the top. A place has the
            cells at z = -1 below its squares.
        blocks: How many blocks it consists of; 0 for a place.
    """

    __slots__ = ("blocks", "cells")

    def __init__(self, cells: tuple[Cell, ...], blocks: int) -> None:
        self.cells = cells
        self.blocks = blocks


def squares(columns: Iterable[Column]) -> Thing:
    """A place: some squares of the board."""
    return Thing(tuple(Cell(x, y, -1) for x, y in columns), 0)


CENTER = squares([(x, y) for x in (3, 4) for y in (3, 4)])
BOARD = squares([(x, y) for x in range(GRID) for y in range(GRID)])
_ROBOT = squares([(-1, y) for y in range(GRID)])
_CORNERS = {(x, y): squares([(x, y)]) for x in (0, _FAR) for y in (0, _FAR)}
_EDGES = {
    Indicator.FRONT: squares([(_FAR, y) for y in range(GRID)]),
    Indicator.BACK: squares([(0, y) for y in range(GRID)]),
    Indicator.LEFT: squares([(x, _FAR) for x in range(GRID)]),
    Indicator.RIGHT: squares([(x, 0) for x in range(GRID)]),
}


def places(entity: Entity) -> list[Thing]:
    """The places that a corner, edge, region, board or robot may stand for."""
    kind = entity.type.value
    said = [leaf.value for leaf in entity.indicators]
    if kind is Type.BOARD:
        return [BOARD]
    if kind is Type.ROBOT:
        return [_ROBOT]
    if kind is Type.REGION and Indicator.CENTER in said:
        return [CENTER]
    sides = [side for side in said if side in _EDGES]
    if kind is Type.EDGE or (kind is Type.REGION and len(sides) == 1):
        return [_EDGES[side] for side in sides] or list(_EDGES.values())
    if kind is Type.REGION and not sides:
        return [BOARD]
    return [
        place
        for column, place in _CORNERS.items()
        if all(Cell(*column, -1) in _EDGES[side].cells for side in sides)
    ]


def distance(one: Thing, other: Thing) -> float:
    """Between the nearest squares of two things, in squares, on the board."""
    if len(one.cells) == 1 and len(other.cells) == 1:
        (ax, ay, _), (bx, by, _) = one.cells[0], other.cells[0]
        return math.hypot(ax - bx, ay - by)
    return min(math.hypot(a.x - b.x, a.y - b.y) for a in one.cells for b in other.cells)
