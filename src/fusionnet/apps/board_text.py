"""A layout as text: the board from above, a letter a block, every column from the bottom up.

A capital is a cube and a small letter a pyramid, so `BYr` is a red pyramid on a yellow
cube on a blue one. x runs away from the robot (up the page), y to its left, as in the
picture that the robot sees.
"""

from rich.table import Table
from rich.text import Text

from fusionnet.apps.drawing import PAINT, hexadecimal
from fusionnet.blocks import GRID, Block, Color, Layout, Shape

LETTERS = {
    Color.BLUE: "B",
    Color.CYAN: "C",
    Color.RED: "R",
    Color.YELLOW: "Y",
    Color.GREEN: "G",
    Color.MAGENTA: "M",
    Color.GRAY: "X",
    Color.WHITE: "W",
}
"""The treebank's letters."""

LEGEND = (
    "from above, far side up; each column from the bottom up, a capital is a cube, a small "
    "letter a pyramid: " + ", ".join(f"{letter} {color}" for color, letter in LETTERS.items())
)


def board_text(layout: Layout, title: str, *, gripper: bool = True) -> Text:
    """The board as lines of text, with the gripper below it if it is known where it is."""
    columns = layout.columns
    width = max([1, *map(len, columns.values())])
    text = Text(f"{title}\n", style="bold")
    text.append("x\n", style="dim")
    for x in reversed(range(GRID)):
        text.append(f"{x} ", style="dim")
        for y in reversed(range(GRID)):
            column = columns.get((x, y), ())
            text.append(" ")
            for block in column:
                text.append_text(letter(block))
            text.append(" " * (width - len(column)) if column else "·" + " " * (width - 1))
        text.append("\n")
    numbers = "".join(f" {y:<{width}}" for y in reversed(range(GRID)))
    text.append(f"  {numbers} y\n", style="dim")
    if not gripper:
        return text
    at = tuple(layout.gripper.cell)
    held = layout.held
    if held is None:
        text.append(f"gripper at {at}, empty", style="dim")
    else:
        text.append(f"gripper at {at}, holds ").append_text(letter(held))
    return text


def boards(*drawn: Text) -> Table:
    """Boards side by side."""
    table = Table.grid(padding=(0, 4))
    table.add_row(*drawn)
    return table


def letter(block: Block) -> Text:
    """A block as one coloured letter."""
    name = LETTERS[block.color]
    shown = name if block.shape is Shape.CUBE else name.lower()
    return Text(shown, style=f"bold {hexadecimal(PAINT[block.color.value])}")
