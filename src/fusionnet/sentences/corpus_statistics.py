"""What is in a corpus, in numbers: sentences, words, trees and the values in them."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from fusionnet.corpora import Command
from fusionnet.rcl import LEAF_VALUES, Leaf, Tree, events
from fusionnet.sentences.tokens import words_of

VALUE_KINDS = tuple(LEAF_VALUES)
"""The kinds of leaves whose values are counted: actions, types, colours, ..."""


def statistics(commands: Sequence[Command]) -> dict[str, Any]:
    """Counts over some commands.

    Returns:
        commands, scenes, groups: How many there are; the scenes and groups are those
            that the commands speak of.
        holding: Commands said while the gripper holds a block.
        words: Different words; `words_a_sentence` and `nodes_a_tree` have the mean,
            the 95th percentile and the maximum.
        actions: Commands by what they ask for: move, take, drop, or a sequence of these.
        values: For each kind of leaf, how often each value is in the trees.
        unaligned: For each kind of leaf, how many leaves no word says.
    """
    sentences = [words_of(command.sentence).texts for command in commands]
    nodes = [sum(1 for _ in parts(command.tree)) for command in commands]
    values: dict[str, Counter[str]] = {kind: Counter() for kind in VALUE_KINDS}
    unaligned: Counter[str] = Counter()
    for command in commands:
        for name, leaf in leaves(command.tree):
            unaligned[name] += not leaf.tokens
            if name in values:
                values[name][str(leaf.value)] += 1
    return {
        "commands": len(commands),
        "scenes": len({id(command.scene) for command in commands}),
        "groups": len({command.scene.group for command in commands} - {None}),
        "holding": sum(command.scene.before.held is not None for command in commands),
        "words": len({word for words in sentences for word in words}),
        "words_a_sentence": _spread([len(words) for words in sentences]),
        "nodes_a_tree": _spread(nodes),
        "actions": dict(Counter(_asked(command.tree) for command in commands).most_common()),
        "values": {kind: dict(counts.most_common()) for kind, counts in values.items()},
        "unaligned": {name: count for name, count in unaligned.most_common() if count},
    }


def parts(node: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Every node and leaf of a tree, with the name that its text form gives it."""
    if isinstance(node, tuple):
        for part in node:
            yield from parts(part, name)
    elif isinstance(node, Leaf):
        yield name, node
    elif is_dataclass(node):
        yield name, node
        for field in fields(node):
            yield from parts(getattr(node, field.name), _LEAF_NAMES.get(field.name, field.name))


def leaves(tree: Tree) -> Iterator[tuple[str, Leaf[Any]]]:
    """Every leaf of a tree, with its name: "color", "reference-id", ..."""
    return ((name, part) for name, part in parts(tree) if isinstance(part, Leaf))


_LEAF_NAMES = {"colors": "color", "indicators": "indicator", "reference_id": "reference-id"}


def _asked(tree: Tree) -> str:
    """What a tree asks for: "move", or "take and drop"."""
    return " and ".join(str(event.action.value) for event in events(tree))


def _spread(numbers: Sequence[int]) -> dict[str, float]:
    """Mean, 95th percentile and maximum."""
    if not numbers:
        return {"mean": 0.0, "p95": 0.0, "most": 0.0}
    return {
        "mean": round(float(np.mean(numbers)), 2),
        "p95": float(np.percentile(numbers, 95)),
        "most": float(max(numbers)),
    }
