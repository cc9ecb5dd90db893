"""Corpora as text: the treebank's three files, and JSON lines.

What `treebank_files` writes, the treebank's reader reads back: of a corpus whose
scenes are numbered as the treebank's it is the same corpus, numbers and all. The
form says which layouts a scene joins by its number alone, so scenes that are not
numbered so (synthetic ones, the examples) get a group of their own each.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from fusionnet.blocks import Layout, Scene, layout_to_json
from fusionnet.corpora._command import Command, Corpus, part_of
from fusionnet.corpora.treebank import (
    COLOR_LETTERS,
    LAYOUTS_PER_GROUP,
    SCENES_PER_GROUP,
    SHAPE_DIGITS,
    scene_layouts,
)
from fusionnet.rcl import describe, format

_LETTERS = {color: letter for letter, color in COLOR_LETTERS.items()}
_DIGITS = {shape: digit for digit, shape in SHAPE_DIGITS.items()}


def command_as_json(command: Command) -> dict[str, Any]:
    """A command with all that it speaks of, for `json.dumps`.

    The layouts are as `layout_from_json` reads them, the tree as `rcl.parse` does.
    """
    scene = command.scene
    return {
        "id": command.id,
        "corpus": command.corpus,
        "part": part_of(scene.group),
        "sentence": command.sentence,
        "rcl": format(command.tree),
        "meaning": describe(command.tree),
        "scene": {
            "id": scene.id,
            "group": scene.group,
            "before": layout_to_json(scene.before),
            "after": layout_to_json(scene.after),
        },
    }


def json_lines(corpus: Corpus) -> str:
    """One JSON object a command, one a line."""
    return "".join(json.dumps(command_as_json(command)) + "\n" for command in corpus.commands)


def treebank_files(corpus: Corpus) -> dict[str, str]:
    """The texts of `commands.txt`, `annotation.txt` and `configuration.txt`.

    Tabs and ends of lines inside a sentence become spaces, for the form has none.
    """
    layouts, numbers = _numbered_as_the_treebank(corpus)
    commands, trees = [], []
    for command in corpus.commands:
        sentence = re.sub(r"[\t\r\n]", " ", command.sentence).strip(" ")
        sentence = sentence.encode("utf-8", "replace").decode("utf-8")
        commands.append(f"{command.id}\t{numbers[_key(command.scene)]}\t{sentence}\n")
        trees.append(f"{command.id}\trcl\t{format(command.tree)}\n")
    records = [_layout_record(number, layout) for number, layout in sorted(layouts.items())]
    return {
        "commands.txt": "".join(commands),
        "annotation.txt": "".join(trees),
        "configuration.txt": "".join(records),
    }


def _key(scene: Scene) -> int:
    """What tells one scene from another, for a scene may have no number."""
    return id(scene) if scene.id is None else scene.id


def _numbered_as_the_treebank(corpus: Corpus) -> tuple[Mapping[int, Layout], dict[int, int]]:
    """All layouts by their number in the treebank's form, and the numbers of the scenes."""
    scenes = {_key(command.scene): command.scene for command in corpus.commands}
    scenes |= corpus.scenes
    if all(_is_the_treebank_s(scene) for scene in scenes.values()):
        return corpus.layouts, {key: key for key in scenes}
    layouts: dict[int, Layout] = {}
    numbers = {}
    for group, (key, scene) in enumerate(scenes.items()):
        numbers[key] = SCENES_PER_GROUP * group + 1
        first = LAYOUTS_PER_GROUP * group + 1
        layouts |= {first: scene.before, first + 1: scene.after}
    return layouts, numbers


def _is_the_treebank_s(scene: Scene) -> bool:
    """Whether a scene's number says which layouts it joins."""
    if scene.id is None:
        return False
    return (scene.group, scene.before.id, scene.after.id) == scene_layouts(scene.id)


def _layout_record(number: int, layout: Layout) -> str:
    group, place = divmod(number - 1, LAYOUTS_PER_GROUP)
    x, y, z = layout.gripper.cell
    lines = [f"{group + 1}\t{place + 1}", f"{x}\t{y}\t{z}\t{'C' if layout.gripper.closed else 'O'}"]
    for block in layout.blocks:
        x, y, z = block.cell
        lines.append(f"{x}\t{y}\t{z}\t{_LETTERS[block.color]}\t{_DIGITS[block.shape]}")
    return "\n".join(lines) + "\n\n"
