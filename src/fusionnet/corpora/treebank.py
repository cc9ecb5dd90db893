"""The Robot Commands Treebank as it was released for SemEval-2014, task 6.

A folder with three tab-separated files: `commands.txt` (id, scene, sentence),
`annotation.txt` (id, "rcl", tree) and `configuration.txt` (layouts as blocks
of lines). The corpus is not part of this package: it is free for research.

Eight scenes join the five layouts of a group: for scene s, r = (s - 1) mod 8
and k = r // 2 + 2, an even r leads from layout 1 to layout k and an odd r from
layout k to layout 1. The proof is that with this order every tree of the corpus
executes to the recorded layout.

References:
    Dukes (2014), SemEval-2014 task 6: Supervised semantic parsing of robotic
    spatial commands.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from fusionnet.blocks.grid import Block, Cell, Color, Gripper, Layout, Scene, Shape
from fusionnet.corpora._command import Command, Corpus
from fusionnet.corpora._faults import WITHOUT_LAYOUTS, WITHOUT_TREE, Faults
from fusionnet.errors import DataError, TreeError
from fusionnet.rcl import Tree, parse

LAYOUTS_PER_GROUP = 5
SCENES_PER_GROUP = 8
LARGEST_FILE = 100_000_000
"""Bytes that one file may have; the treebank's largest has under one million."""

COLOR_LETTERS = {
    "B": Color.BLUE,
    "C": Color.CYAN,
    "R": Color.RED,
    "Y": Color.YELLOW,
    "G": Color.GREEN,
    "M": Color.MAGENTA,
    "X": Color.GRAY,
    "W": Color.WHITE,
}
SHAPE_DIGITS = {"1": Shape.CUBE, "2": Shape.PRISM}

_CELL = r"([0-7])[ \t]+([0-7])[ \t]+([0-7])"
_BLOCK = re.compile(_CELL + r"[ \t]+([BCRYGMXW])[ \t]+([12])")
_GRIPPER = re.compile(_CELL + r"[ \t]+([OC])")


def read(data: Path | None, *, skip_bad: bool = False) -> Corpus:
    """Read the treebank from its folder, or from a folder that holds it as `treebank/`.

    Args:
        data: The folder.
        skip_bad: Leave unreadable records out, with a warning in the log,
            instead of refusing the whole.

    Raises:
        DataError: If a file is missing or a line is not as it should be; the
            message names the file and the line.
    """
    if data is None:
        raise DataError(
            "The treebank is not part of this package; give the folder that holds "
            "commands.txt, annotation.txt and configuration.txt (--data DIR, or FUSIONNET_DATA)."
        )
    folder = data / "treebank" if (data / "treebank").is_dir() else data
    faults = Faults(skip_bad)
    layouts = _layouts(folder / "configuration.txt", faults)
    scenes = _scenes(layouts)
    trees = _trees(folder / "annotation.txt", faults)
    commands = tuple(_commands(folder / "commands.txt", trees, scenes, faults))
    return Corpus("treebank", commands, scenes, layouts, dict(faults.left_out))


CORPUS = read
TERMS = (
    "the [Robot Commands Treebank](https://aclanthology.org/S14-2006/) (Train Robots) as released "
    "for SemEval-2014 task 6, free for research"
)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines without their ends; the treebank's files mix CR, LF and CRLF."""
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise DataError(f"{path} has more than {LARGEST_FILE} bytes: it is not the treebank's.")
        text = path.read_text("utf-8-sig")
    except FileNotFoundError:
        raise DataError(
            f"There is no {path.name} in {path.parent}; the treebank's folder holds "
            "commands.txt, annotation.txt and configuration.txt."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path} cannot be read: {error}") from None
    for number, line in enumerate(text.split("\n"), 1):
        yield number, line.strip("\r\t ")


def _layouts(path: Path, faults: Faults) -> dict[int, Layout]:
    """Numbered layouts: layout n of group g has the number 5 (g - 1) + n."""
    layouts: dict[int, Layout] = {}
    record: list[tuple[int, str]] = []
    for number, line in [*_lines(path), (-1, "")]:
        if line:
            record.append((number, line))
        elif record:
            try:
                layout_id, layout = _layout(record)
                if layout_id in layouts:
                    raise DataError(record[0][0], f"layout {record[0][1]!r} is there already")
                layouts[layout_id] = layout
            except DataError as error:
                faults.found(path.name, *error.args)
            record = []
    return layouts


def _number(text: str) -> int | None:
    """A whole number from 1 to 999,999,999; None if the text is none."""
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        return None
    return int(text) or None


def _layout(record: list[tuple[int, str]]) -> tuple[int, Layout]:
    """One layout from its lines."""
    number, line = record[0]
    group, place = map(_number, line.partition("\t")[::2])
    if group is None or place is None or place > LAYOUTS_PER_GROUP:
        raise DataError(number, f"expected 'group layout' (layout 1 to 5), found {line!r}")
    layout_id = LAYOUTS_PER_GROUP * (group - 1) + place
    number, line = record[1] if len(record) > 1 else (number, "")
    match = _GRIPPER.fullmatch(line)
    if match is None:
        raise DataError(number, f"expected the gripper as 'x y z O' or 'x y z C', found {line!r}")
    x, y, z, state = match.groups()
    gripper = Gripper(Cell(int(x), int(y), int(z)), closed=state == "C")
    blocks = []
    for number, line in record[2:]:
        block = _block(line)
        if block is None:
            raise DataError(number, f"expected a block as 'x y z colour shape', found {line!r}")
        blocks.append(block)
    return layout_id, Layout(tuple(blocks), gripper, layout_id)


@lru_cache(maxsize=10_000)
def _block(line: str) -> Block | None:
    """The block that a line describes; most lines are there many times."""
    match = _BLOCK.fullmatch(line)
    if match is None:
        return None
    x, y, z, color, shape = match.groups()
    return Block(COLOR_LETTERS[color], SHAPE_DIGITS[shape], Cell(int(x), int(y), int(z)))


def scene_layouts(scene: int) -> tuple[int, int, int]:
    """The group of a scene, and the numbers of its layouts before and after."""
    group, place = divmod(scene - 1, SCENES_PER_GROUP)
    first = LAYOUTS_PER_GROUP * group + 1
    other = first + place // 2 + 1
    before, after = (first, other) if place % 2 == 0 else (other, first)
    return group + 1, before, after


def _scenes(layouts: dict[int, Layout]) -> dict[int, Scene]:
    """All scenes whose two layouts there are."""
    scenes = {}
    for group in sorted({(layout - 1) // LAYOUTS_PER_GROUP for layout in layouts}):
        for place in range(1, SCENES_PER_GROUP + 1):
            number = SCENES_PER_GROUP * group + place
            named, before, after = scene_layouts(number)
            if before in layouts and after in layouts:
                scenes[number] = Scene(layouts[before], layouts[after], number, named)
    return scenes


def _trees(path: Path, faults: Faults) -> dict[int, Tree]:
    trees: dict[int, Tree] = {}
    for line_number, line in _lines(path):
        if not line:
            continue
        number, kind, text = (*line.split("\t", 2), "", "")[:3]
        command = _number(number)
        if command is None or kind != "rcl":
            found = f"expected 'id', 'rcl' and the tree with tabs between, found {line[:60]!r}"
            faults.found(path.name, line_number, found)
        elif command in trees:
            faults.found(path.name, line_number, f"command {command} has a tree already")
        else:
            try:
                trees[command] = parse(text)
            except TreeError as error:
                faults.found(path.name, line_number, str(error))
    return trees


def _commands(
    path: Path, trees: dict[int, Tree], scenes: dict[int, Scene], faults: Faults
) -> Iterator[Command]:
    seen: set[int] = set()
    for line_number, line in _lines(path):
        if not line:
            continue
        number, place, sentence = (*line.split("\t", 2), "", "")[:3]
        command, scene = _number(number), _number(place)
        if command is None or scene is None:
            found = (
                f"expected 'id', 'scene' and the sentence with tabs between, found {line[:60]!r}"
            )
            faults.found(path.name, line_number, found)
        elif command in seen:
            faults.found(path.name, line_number, f"command {command} is there already")
        elif command not in trees:
            reason = f"command {command} has no tree in annotation.txt"
            faults.found(path.name, line_number, reason, WITHOUT_TREE)
        elif scene not in scenes:
            reason = f"scene {scene} has no layouts in configuration.txt"
            faults.found(path.name, line_number, reason, WITHOUT_LAYOUTS)
        else:
            seen.add(command)
            yield Command(command, sentence, trees[command], scenes[scene], "treebank")
