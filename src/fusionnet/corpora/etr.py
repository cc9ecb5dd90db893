"""The Extended Train Robots corpus: five XML files, loose in a folder or in one zip.

`layouts.xml`, `scenes.xml`, `commands.xml` and `losr.xml` are needed; `comments.xml`
marks commands as bad. The corpus is published by the University of Leeds
(archive.researchdata.leeds.ac.uk/37) and is not part of this package.

References:
    Thesis, section 3.1.
"""

import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from fusionnet.blocks import Block, Cell, Color, Gripper, Layout, Scene, Shape
from fusionnet.corpora._command import Command, Corpus
from fusionnet.corpora._faults import WITHOUT_LAYOUTS, WITHOUT_TREE, Faults
from fusionnet.corpora._xml_files import Element, elements, read_named_files
from fusionnet.errors import DataError, TreeError
from fusionnet.rcl import Tree, parse

NEEDED = ("layouts.xml", "scenes.xml", "commands.xml", "losr.xml")
COMMENTS = "comments.xml"
SCENES_PER_GROUP = 8

_CELL = re.compile(r"\s*([0-7])[\s,]+([0-7])[\s,]+([0-7])\s*")
_COLORS = {str(color): color for color in Color} | {"grey": Color.GRAY}
_SHAPES = {"cube": Shape.CUBE, "prism": Shape.PRISM, "pyramid": Shape.PRISM}
_TRUTHS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


def read(data: Path | None, *, skip_bad: bool = False) -> Corpus:
    """Read the corpus from its folder or zip, or from a folder that holds it as `etr/`.

    Commands that a comment marks as bad, and those without a tree, are left out
    and counted in `Corpus.left_out`.

    Args:
        data: The folder or zip.
        skip_bad: Leave unreadable records out, with a warning in the log,
            instead of refusing the whole.

    Raises:
        DataError: If a file is missing or an element is not as it should be; the
            message names the file, the line and what was expected.
    """
    if data is None:
        raise DataError(
            "The Extended Train Robots corpus is not part of this package; give the folder or "
            f"zip that holds {', '.join(NEEDED)} (--data PATH, or FUSIONNET_DATA)."
        )
    source = data / "etr" if (data / "etr").is_dir() else data
    files = read_named_files(source, (*NEEDED, COMMENTS))
    missing = [name for name in NEEDED if name not in files]
    if missing:
        raise DataError(f"There is no {' and no '.join(missing)} in {source}.")
    faults = Faults(skip_bad)
    layouts = _layouts(elements("layouts.xml", files["layouts.xml"]), faults)
    scenes = _scenes(elements("scenes.xml", files["scenes.xml"]), layouts, faults)
    trees = _trees(elements("losr.xml", files["losr.xml"]), faults)
    marked = _marked(elements(COMMENTS, files.get(COMMENTS, b"<comments/>")))
    return _corpus(elements("commands.xml", files["commands.xml"]), scenes, layouts, trees, marked,
                   faults)  # fmt: skip


CORPUS = read
TERMS = (
    "the [Extended Train Robots](https://archive.researchdata.leeds.ac.uk/37) release of the "
    "University of Leeds, under the terms that are stated there"
)


class _Bad(Exception):
    """Why an element cannot be used."""


def _attribute(element: Element, *names: str) -> str:
    """The first of the attributes that there is."""
    for name in names:
        if name in element.attributes:
            return element.attributes[name]
    raise _Bad(f"<{element.name}> needs the attribute {names[0]!r}")


def _number(element: Element, *names: str) -> int:
    text = _attribute(element, *names).strip()
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise _Bad(f"{names[0]!r} of <{element.name}> is a whole number, not {text[:40]!r}")
    return int(text)


def _cell(element: Element) -> Cell:
    text = _attribute(element, "position")
    match = _CELL.fullmatch(text)
    if match is None:
        raise _Bad(f"'position' of <{element.name}> is 'x y z' from 0 to 7, not {text[:40]!r}")
    return Cell(*map(int, match.groups()))


@lru_cache(maxsize=10_000)
def _block(name: str, color: str | None, position: str | None) -> Block | None:
    """The block that an element describes; most are there many times."""
    cell = _CELL.fullmatch(position or "")
    known = _COLORS.get((color or "").strip().lower())
    if cell is None or known is None:
        return None
    return Block(known, _SHAPES[name], Cell(*map(int, cell.groups())))


def _layouts(found: Iterable[Element], faults: Faults) -> dict[int, Layout]:
    layouts: dict[int, Layout] = {}
    number: int | None = None
    bad = False
    blocks: list[Block] = []
    gripper: Gripper | None = None

    def close(line: int) -> None:
        if number is None or bad:
            return
        if gripper is None:
            faults.found("layouts.xml", line, f"layout {number} has no <gripper>")
        else:
            layouts[number] = Layout(tuple(blocks), gripper, number)

    begun = 0
    for element in found:
        try:
            if element.name == "layout":
                close(begun)
                number, blocks, gripper, bad, begun = None, [], None, False, element.line
                number = _number(element, "id")
            elif element.name == "gripper":
                said = element.attributes.get("open", "true").strip().lower()
                if said not in _TRUTHS:
                    raise _Bad(f"'open' of <gripper> is true or false, not {said[:40]!r}")
                gripper = Gripper(_cell(element), closed=not _TRUTHS[said])
            elif element.name in _SHAPES:
                attributes = element.attributes
                block = _block(element.name, attributes.get("color"), attributes.get("position"))
                if block is None:
                    raise _Bad(
                        f"<{element.name}> needs a 'color' ({', '.join(_COLORS)}) and a 'position' "
                        f"('x y z' from 0 to 7), not {str(attributes)[:60]}"
                    )
                blocks.append(block)
        except _Bad as reason:
            bad = True
            faults.found("layouts.xml", element.line, str(reason))
    close(begun)
    return layouts


def _scenes(
    found: Iterable[Element], layouts: dict[int, Layout], faults: Faults
) -> dict[int, Scene]:
    scenes: dict[int, Scene] = {}
    number, line = 0, 0
    ends: dict[str, Layout] = {}

    def close() -> None:
        if number and len(ends) == 2:
            group = (number - 1) // SCENES_PER_GROUP + 1
            scenes[number] = Scene(ends["before"], ends["after"], number, group)
        elif number:
            faults.found("scenes.xml", line, f"scene {number} needs <before> and <after>")

    for element in found:
        try:
            if element.name == "scene":
                close()
                number, line, ends = 0, element.line, {}
                number = _number(element, "id")
            elif element.name in ("before", "after"):
                layout = _number(element, "layoutId", "layout", "id")
                if layout not in layouts:
                    raise _Bad(f"there is no layout {layout}")
                ends[element.name] = layouts[layout]
        except _Bad as reason:
            number = 0
            faults.found("scenes.xml", element.line, str(reason))
    close()
    return scenes


def _trees(found: Iterable[Element], faults: Faults) -> dict[int, Tree]:
    trees = {}
    for element in found:
        if element.name != "command":
            continue
        try:
            number = _number(element, "id", "commandId")
            text = _attribute(element, "losr", "rcl")
            if text.strip():
                trees[number] = parse(text)
        except (_Bad, TreeError) as reason:
            faults.found("losr.xml", element.line, str(reason))
    return trees


def _marked(found: Iterable[Element]) -> set[str]:
    """The ids of the commands that a comment marks as bad."""
    return {
        element.attributes.get("id", "").strip()
        for element in found
        if element.name == "command" and element.attributes.get("comment", "").strip()
    }


def _corpus(
    found: Iterable[Element],
    scenes: dict[int, Scene],
    layouts: dict[int, Layout],
    trees: dict[int, Tree],
    marked: set[str],
    faults: Faults,
) -> Corpus:
    commands: list[Command] = []
    left_out = {"marked as bad by a comment": 0, WITHOUT_TREE: 0}
    for element in found:
        if element.name != "command":
            continue
        try:
            number = _number(element, "id")
            scene = _number(element, "sceneId", "scene")
            sentence = _attribute(element, "text")
            if str(number) in marked:
                left_out["marked as bad by a comment"] += 1
            elif number not in trees:
                left_out[WITHOUT_TREE] += 1
            elif scene not in scenes:
                reason = f"there is no scene {scene}"
                faults.found("commands.xml", element.line, reason, WITHOUT_LAYOUTS)
            else:
                commands.append(Command(number, sentence, trees[number], scenes[scene], "etr"))
        except _Bad as reason:
            faults.found("commands.xml", element.line, str(reason))
    kept = {reason: count for reason, count in left_out.items() if count} | faults.left_out
    return Corpus("etr", tuple(commands), scenes, layouts, kept)
