"""Whether a layout could stand on a table: `validate`."""

from collections import Counter

from fusionnet.blocks.grid import GRID, Block, Cell, Layout, Shape
from fusionnet.errors import InputError


def name_block(block: Block) -> str:
    """For messages: "red pyramid at (3, 4, 0)"."""
    noun = "cube" if block.shape is Shape.CUBE else "pyramid"
    return f"{block.color} {noun} at {tuple(block.cell)}"


def validate(layout: Layout) -> None:
    """Accept a layout that could stand on a table, and nothing else.

    Blocks lie on the grid, no two in one cell; every block but the held one
    stands on the table or on a cube that is not held. (A closed gripper without
    a block is odd, but the treebank has one, and it harms nothing.)

    Raises:
        InputError: If it could not; the message names the block.
    """
    if not layout.gripper.cell.on_grid:
        raise InputError(
            f"The gripper at {tuple(layout.gripper.cell)} is off the grid; "
            f"x, y and z are 0 to {GRID - 1}."
        )
    for block in layout.blocks:
        if not block.cell.on_grid:
            raise InputError(
                f"The {name_block(block)} is off the grid; x, y and z are 0 to {GRID - 1}."
            )
    taken = Counter(block.cell for block in layout.blocks)
    for cell, count in taken.items():
        if count > 1:
            raise InputError(
                f"{count} blocks overlap in the cell {tuple(cell)}; it has room for one."
            )
    at = {block.cell: block for block in layout.blocks}
    held = layout.held
    for block in layout.blocks:
        x, y, z = block.cell
        if block is held or z == 0:
            continue
        below = at.get(Cell(x, y, z - 1))
        if below is None:
            raise InputError(
                f"The {name_block(block)} floats: nothing is below it, "
                "and the closed gripper is not there."
            )
        if below is held:
            raise InputError(f"The {name_block(block)} rests on the block that the gripper holds.")
        if below.shape is Shape.PRISM:
            raise InputError(f"The {name_block(block)} stands on the tip of a pyramid.")
