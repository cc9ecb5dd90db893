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
from fusionnet.blocks.planner import HOLDING_HEIGHT, apply, plan

__all__ = [
    "BLOCK_SIZE",
    "CLASS_NAMES",
    "GRID",
    "HOLDING_HEIGHT",
    "Block",
    "Cell",
    "Color",
    "Gripper",
    "Layout",
    "Move",
    "Scene",
    "Shape",
    "apply",
    "plan",
]
