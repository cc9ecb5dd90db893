"""Blocks on the grid: layouts, scenes, moves, and the planner that executes trees in them."""

from fusionnet.blocks.grid import (
    BLOCK_SIZE,
    CLASS_NAMES,
    GRID,
    Block,
    Cell,
    Color,
    Gripper,
    Layout,
    Move,
    Scene,
    Shape,
)

__all__ = [
    "BLOCK_SIZE",
    "CLASS_NAMES",
    "GRID",
    "Block",
    "Cell",
    "Color",
    "Gripper",
    "Layout",
    "Move",
    "Scene",
    "Shape",
]
