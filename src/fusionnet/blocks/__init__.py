"""Blocks on the grid: layouts, scenes, moves, and the planner that executes trees in them."""

from fusionnet.blocks.difference import move_between
from fusionnet.blocks.grid import (
    BLOCK_SIZE,
    CLASS_NAMES,
    EMPTY,
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
from fusionnet.blocks.layout_files import (
    layout_from_json,
    layout_to_json,
    read_layout,
    write_layout,
)
from fusionnet.blocks.planner import HOLDING_HEIGHT, apply, plan
from fusionnet.blocks.random_layouts import random_layout
from fusionnet.blocks.validation import validate

__all__ = [
    "BLOCK_SIZE",
    "CLASS_NAMES",
    "EMPTY",
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
    "layout_from_json",
    "layout_to_json",
    "move_between",
    "plan",
    "random_layout",
    "read_layout",
    "validate",
    "write_layout",
]
