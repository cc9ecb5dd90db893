"""The one record that every corpus gives, whatever it was read from."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Literal, get_args

from fusionnet.blocks.grid import Layout, Scene
from fusionnet.errors import UnknownNameError
from fusionnet.rcl import Tree

GROUPS = 125
"""Groups of scenes in the treebank; other corpora number theirs alike."""

Part = Literal["train", "val", "test"]
"""The parts of a corpus: by group of scenes, so that no layout is in two of them."""


@dataclass(frozen=True, slots=True)
class Command:
    """A sentence, the tree that it means, and the scene that it was said in.

    Attributes:
        id: Number in its corpus.
        sentence: As it was written.
        tree: Its meaning, with the words that each leaf was read from.
        scene: The layouts before and after.
        corpus: Name of its corpus.
    """

    id: int
    sentence: str
    tree: Tree
    scene: Scene
    corpus: str


@dataclass(frozen=True)
class Corpus:
    """Commands, and the scenes and layouts that they speak of.

    Attributes:
        name: Name in the catalogue.
        commands: All commands, in the order of the source.
        scenes: All scenes by their number, also those without a command.
        layouts: All layouts by their number.
        left_out: How many commands of the source were left out, by the reason.
    """

    name: str
    commands: tuple[Command, ...]
    scenes: Mapping[int, Scene]
    layouts: Mapping[int, Layout]
    left_out: Mapping[str, int] = field(default_factory=dict)

    def split(self, part: str) -> list[Command]:
        """The commands of one part; scenes without a group belong to "test".

        Raises:
            UnknownNameError: If there is no such part.
        """
        if part not in get_args(Part):
            known = ", ".join(get_args(Part))
            raise UnknownNameError(f"No part called {part!r}; available: {known}.")
        return [c for c in self.commands if part_of(c.scene.group) == part]


def part_of(group: int | None) -> Part:
    """The part that a group of scenes belongs to: of the treebank's 125 groups,
    100 train, 12 validate and 13 test, as written down in `split.json`.

    A scene without a group was never meant for training: "test".
    """
    if group is None:
        return "test"
    held_out = _held_out_groups()
    return held_out.get(group, "train")


@cache
def _held_out_groups() -> dict[int, Part]:
    text = resources.files("fusionnet.corpora").joinpath("split.json").read_text("utf-8")
    written = json.loads(text)
    parts: dict[int, Part] = {group: "val" for group in written["val"]}
    return parts | {group: "test" for group in written["test"]}
