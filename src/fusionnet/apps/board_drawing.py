"""A layout drawn as small solid blocks on the board (SVG), seen over the robot's shoulder.

x runs away from the robot and y to its left, so the nearest, right-most cell (0, 0, 0)
is at the bottom right, as in the picture that the robot sees.
"""

from collections.abc import Sequence
from html import escape

import numpy as np
from jaxtyping import Float

from fusionnet.apps.drawing import PAINT, hexadecimal
from fusionnet.blocks.grid import GRID, Block, Cell, Layout, Move, Shape

_SIDE = 34.0
_AWAY = (11.0, -19.0)
"""Pixels: one cell to the right (also one level up), and one cell away from the robot."""

Point = tuple[float, float]
Number = int | float


def board_svg(
    layout: Layout, *, move: Move | None = None, levels: int | None = None, title: str
) -> str:
    """The layout as an SVG element that takes its text colour from the page around it.

    Args:
        layout: Blocks and gripper.
        move: Draws an arrow from its source to its target.
        levels: Room above the board, so that several pictures have one size; by default
            what the highest block needs.
        title: What the picture shows, for people who cannot see it.
    """
    levels = levels or highest_level(layout, move) + 1
    width = GRID * (_SIDE + _AWAY[0]) + 2 * _SIDE
    height = -GRID * _AWAY[1] + (levels + 2.2) * _SIDE
    parts = [_tile(x, y) for x in range(GRID) for y in range(GRID)]
    held = layout.held
    for block in sorted(layout.blocks, key=lambda b: (-b.cell.x, -b.cell.y, b.cell.z)):
        parts += _cube(block) if block.shape is Shape.CUBE else _pyramid(block)
    if held is not None:
        x, y = _middle(held.cell, 1.0)
        parts.append(
            f'<path d="M{x - 9:.1f} {y + 8:.1f}V{y - 6:.1f}H{x + 9:.1f}V{y + 8:.1f}M{x:.1f} '
            f'{y - 6:.1f}V{y - 26:.1f}" fill="none" stroke="currentColor" stroke-width="3"/>'
        )
    if move is not None:
        parts += _arrow(move)
    view = f"{-_SIDE:.0f} {-height + _SIDE:.0f} {width:.0f} {height:.0f}"
    return (
        f'<svg class="board" viewBox="{view}" role="img"><title>{escape(title)}</title>'
        f"{''.join(parts)}</svg>"
    )


def boards_svg(before: Layout, after: Layout, move: Move | None) -> str:
    """The layouts before and after a move, side by side, as an SVG file that stands alone."""
    levels = max(highest_level(before, move), highest_level(after, move)) + 1
    drawn = [
        board_svg(before, move=move, levels=levels, title="before"),
        board_svg(after, levels=levels, title="after"),
    ]
    width, height = 460, 150 + 36 * levels
    placed = [
        svg.replace("<svg ", f'<svg x="{i * width}" width="{width}" height="{height}" ', 1)
        for i, svg in enumerate(drawn)
    ]
    style = (
        ".tile0{fill:#e9ebf0}.tile1{fill:#d5d9e1}.ghost{stroke:#c2571a;stroke-width:1.6;"
        "stroke-dasharray:4 3}.arrow{fill:none;stroke:#c2571a;stroke-width:3}"
        ".arrowhead{fill:#c2571a;stroke:#ffffff}"
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * width} {height}" '
        f'color="#1d2430"><style>{style}</style>{"".join(placed)}</svg>\n'
    )


def highest_level(layout: Layout, move: Move | None = None) -> int:
    """The highest level that a block, or the end of a move, is on."""
    ends = [] if move is None else [move.source.z, move.target.z]
    return max([block.cell.z for block in layout.blocks] + ends, default=0)


def heat_svg(probabilities: Float[np.ndarray, "512"], *, title: str) -> str:
    """How much of a distribution over cells stands on each square of the board (SVG)."""
    columns = np.asarray(probabilities).reshape(GRID, GRID, GRID).sum(axis=2)
    parts = []
    for x in range(GRID):
        for y in range(GRID):
            parts.append(_tile(x, y))
            if columns[x, y] >= 0.005:
                strength = f'class="heat" fill-opacity="{min(float(columns[x, y]), 1.0):.2f}"'
                parts.append(_tile(x, y, strength))
    width, height = GRID * (_SIDE + _AWAY[0]), -GRID * _AWAY[1]
    view = f"-6 {-height - 6:.0f} {width + 12:.0f} {height + 12:.0f}"
    return (
        f'<svg class="heatmap" viewBox="{view}" role="img"><title>{escape(title)}</title>'
        f"{''.join(parts)}</svg>"
    )


def _corner(right: Number, away: Number, up: Number) -> Point:
    """Where a point of the board is drawn; units are cells, from the near left corner."""
    return (right * _SIDE + away * _AWAY[0], away * _AWAY[1] - up * _SIDE)


def _origin(cell: Cell) -> tuple[int, int, int]:
    """The near, left, lower corner of a cell, in the units of `_corner`."""
    return (GRID - 1 - cell.y, cell.x, cell.z)


def _middle(cell: Cell, up: Number) -> Point:
    right, away, z = _origin(cell)
    return _corner(right + 0.5, away + 0.5, z + up)


def _face(points: Sequence[Point], fill: str, extra: str) -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polygon points="{path}" fill="{fill}" {extra}/>'


def _tile(x: int, y: int, extra: str = "") -> str:
    right, away, _ = _origin(Cell(x, y, 0))
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    points = [_corner(right + i, away + j, 0) for i, j in square]
    return _face(points, "none", extra or f'class="tile{(x + y) % 2}"')


def _shade(color: str, by: Number) -> str:
    """A colour made darker (below 1) or lighter (above 1)."""
    paint = PAINT[color]
    if by <= 1:
        return hexadecimal(tuple(round(c * by) for c in paint))  # type: ignore[arg-type]
    return hexadecimal(tuple(round(255 - (255 - c) * (2 - by)) for c in paint))  # type: ignore[arg-type]


_EDGE = 'stroke="#00000059" stroke-width="0.8" stroke-linejoin="round"'


def _cube(block: Block) -> list[str]:
    r, a, z = _origin(block.cell)
    color = block.color.value
    front = [_corner(r + i, a, z + k) for i, k in ((0, 0), (1, 0), (1, 1), (0, 1))]
    side = [_corner(r + 1, a + j, z + k) for j, k in ((0, 0), (1, 0), (1, 1), (0, 1))]
    top = [_corner(r + i, a + j, z + 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return [
        _face(side, _shade(color, 0.66), _EDGE),
        _face(front, _shade(color, 0.88), _EDGE),
        _face(top, _shade(color, 1.18), _EDGE),
    ]


def _pyramid(block: Block) -> list[str]:
    r, a, z = _origin(block.cell)
    color = block.color.value
    apex = _corner(r + 0.5, a + 0.5, z + 1)
    near_left, near_right, far_right, far_left = (
        _corner(r + i, a + j, z) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    return [
        _face([far_left, far_right, apex], _shade(color, 1.1), _EDGE),
        _face([near_left, far_left, apex], _shade(color, 1.22), _EDGE),
        _face([near_right, far_right, apex], _shade(color, 0.66), _EDGE),
        _face([near_left, near_right, apex], _shade(color, 0.92), _EDGE),
    ]


def _arrow(move: Move) -> list[str]:
    """From above the source to the target's cell, which is outlined."""
    r, a, z = _origin(move.target)
    ghost = [_corner(r + i, a, z + k) for i, k in ((0, 0), (1, 0), (1, 1), (0, 1))]
    ghost_top = [_corner(r + i, a + j, z + 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    (x0, y0), (x1, y1) = _middle(move.source, 0.75), _middle(move.target, 0.6)
    peak = min(y0, y1) - 1.5 * _SIDE
    dashed = 'class="ghost"'
    return [
        _face(ghost, "none", dashed),
        _face(ghost_top, "none", dashed),
        f'<path class="arrow" d="M{x0:.1f} {y0:.1f}C{x0:.1f} {peak:.1f} {x1:.1f} {peak:.1f} '
        f'{x1:.1f} {y1 - 9:.1f}"/>',
        f'<circle class="arrowhead" cx="{x0:.1f}" cy="{y0:.1f}" r="4"/>',
        f'<path class="arrowhead" d="M{x1:.1f} {y1:.1f}l-7 -13h14z"/>',
    ]
