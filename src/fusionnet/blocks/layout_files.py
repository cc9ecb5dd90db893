"""Layouts as JSON: of our own form, read with suspicion, written whole or not at all.

    {"gripper": {"cell": [6, 5, 4], "closed": false},
     "blocks": [{"color": "red", "shape": "cube", "cell": [3, 4, 0]}, ...]}

The gripper may be left out; "pyramid" may be said for "prism" and "grey" for "gray".
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fusionnet.blocks.grid import GRID, Block, Cell, Color, Gripper, Layout, Shape
from fusionnet.blocks.validation import validate
from fusionnet.catalogue import did_you_mean
from fusionnet.errors import InputError
from fusionnet.files import write_whole

LARGEST_FILE = 1_000_000
"""Bytes that a layout's file may have; 512 blocks take about 40,000."""

_COLORS = {**{str(color): color for color in Color}, "grey": Color.GRAY}
_SHAPES = {**{str(shape): shape for shape in Shape}, "pyramid": Shape.PRISM}


def layout_to_json(layout: Layout) -> dict[str, Any]:
    """The layout as plain lists, numbers and strings for `json.dumps`."""
    gripper = {"cell": list(layout.gripper.cell), "closed": layout.gripper.closed}
    blocks = [
        {"color": str(b.color), "shape": str(b.shape), "cell": list(b.cell)} for b in layout.blocks
    ]
    numbered = {} if layout.id is None else {"id": layout.id}
    return numbered | {"gripper": gripper, "blocks": blocks}


def layout_from_json(value: Any) -> Layout:
    """The layout that a decoded JSON value describes; the inverse of `layout_to_json`.

    Raises:
        InputError: If it is not of the form above, or could not stand on a table.
    """
    fields = _object(value, "a layout", required=["blocks"], optional=["gripper", "id"])
    blocks = fields["blocks"]
    if not isinstance(blocks, list):
        raise InputError(f"'blocks' is a list of blocks, not {_shown(blocks)}.")
    if len(blocks) > GRID**3:
        raise InputError(f"There are {len(blocks)} blocks; the grid has {GRID**3} cells.")
    number = fields.get("id")
    if number is not None and not _is_whole(number):
        raise InputError(f"A layout's 'id' is a whole number, not {_shown(number)}.")
    gripper = _gripper(fields["gripper"]) if "gripper" in fields else None
    read = tuple(_block(block, index) for index, block in enumerate(blocks))
    layout = Layout(read, id=number) if gripper is None else Layout(read, gripper, number)
    validate(layout)
    return layout


def read_layout(path: Path | str) -> Layout:
    """The layout in a JSON file.

    Raises:
        InputError: If there is no such file, it is too large, not JSON, or not a
            layout that could stand on a table.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise InputError(f"There is no file {path}.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    if len(content) > LARGEST_FILE:
        raise InputError(f"{path} has more than {LARGEST_FILE} bytes: it is not a layout.")
    try:
        value = json.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError(f"{path} is not JSON: it is not UTF-8 text.") from None
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path} is not JSON: {error.msg} in line {error.lineno}, column {error.colno}."
        ) from None
    except (RecursionError, ValueError):  # nested without end; numbers of thousands of digits
        raise InputError(f"{path} is no layout: its JSON is beyond all measure.") from None
    try:
        return layout_from_json(value)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_layout(layout: Layout, path: Path | str) -> None:
    """Write a layout as JSON, whole or not at all; its folder is made if it is missing.

    Raises:
        OutputError: If it cannot be written.
    """
    path = Path(path)
    lines = ",\n  ".join(json.dumps(block) for block in layout_to_json(layout)["blocks"])
    head = json.dumps({k: v for k, v in layout_to_json(layout).items() if k != "blocks"})
    text = f'{head[:-1]},\n "blocks": [\n  {lines}]}}\n'
    write_whole(path, text)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _object(value: Any, what: str, required: list[str], optional: list[str]) -> Mapping[str, Any]:
    """A JSON object with all the required fields and no unknown ones."""
    if not isinstance(value, dict):
        raise InputError(f"Expected {what} as a JSON object, found {_shown(value)}.")
    known = required + optional
    for name in value:
        if name not in known:
            raise InputError(
                f"{what.capitalize()} has no field {_shown(name)}; it has {', '.join(known)}."
                + did_you_mean(name, known)
            )
    for name in required:
        if name not in value:
            raise InputError(f"{what.capitalize()} needs the field {name!r}.")
    return value


def _cell(value: Any, what: str) -> Cell:
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_whole, value)):
        raise InputError(
            f"The cell of {what} is three whole numbers [x, y, z] from 0 to {GRID - 1}, "
            f"not {_shown(value)}."
        )
    return Cell(*value)


def _gripper(value: Any) -> Gripper:
    fields = _object(value, "the gripper", required=["cell"], optional=["closed"])
    closed = fields.get("closed", False)
    if not isinstance(closed, bool):
        raise InputError(f"The gripper's 'closed' is true or false, not {_shown(closed)}.")
    return Gripper(_cell(fields["cell"], "the gripper"), closed)


def _block(value: Any, index: int) -> Block:
    what = f"block {index + 1}"
    fields = _object(value, what, required=["color", "shape", "cell"], optional=[])
    color, shape = fields["color"], fields["shape"]
    if not isinstance(color, str) or color not in _COLORS:
        raise InputError(
            f"The color of {what} is {_shown(color)}; known: {', '.join(_COLORS)}."
            + (did_you_mean(color, list(_COLORS)) if isinstance(color, str) else "")
        )
    if not isinstance(shape, str) or shape not in _SHAPES:
        raise InputError(
            f"The shape of {what} is {_shown(shape)}; known: {', '.join(_SHAPES)}."
            + (did_you_mean(shape, list(_SHAPES)) if isinstance(shape, str) else "")
        )
    return Block(_COLORS[color], _SHAPES[shape], _cell(fields["cell"], what))
