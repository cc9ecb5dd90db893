"""Unlimited exact examples: the planner labels varied trees on varied layouts.

A tree of the training groups keeps its form; its colours, sides and numbers change.
The layout is its own, with the same changes, or an edited, foreign or random one.
What the planner refuses is thrown away.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import (
    Color,
    Layout,
    Move,
    plan,
)
from fusionnet.corpora import Command
from fusionnet.errors import PlanningError
from fusionnet.models.tree_program import compile_tree
from fusionnet.randomness import generator
from fusionnet.rcl import Action, Indicator, Leaf, Relation, Tree, Type, events
from fusionnet.rcl import Color as ColorWord
from fusionnet.training.layout_columns import Columns, random_columns

_COLORS = tuple(Color)


@dataclass(frozen=True)
class Example:
    """A tree, a layout, and the move that the planner makes of them."""

    tree: Tree
    layout: Layout
    move: Move


class PlannedExamples:
    """Draws examples from commands that may be trained on.

    Half of what it draws are trees with something rare in them.

    Args:
        commands: Real commands; only their trees and layouts are used.
    """

    def __init__(self, commands: Sequence[Command]) -> None:
        by_tree: dict[Tree, list[Layout]] = {}
        for command in commands:
            by_tree.setdefault(command.tree, []).append(command.scene.before)
        self.trees = list(by_tree.items())
        often = np.array([len(layouts) for layouts in by_tree.values()], dtype=float)
        rare = _rarity(list(by_tree))
        self.weights = 0.5 * often / often.sum() + 0.5 * rare / rare.sum()
        layouts = {id(s): s for c in commands for s in (c.scene.before, c.scene.after)}
        self.layouts = [Columns.of(layout) for layout in layouts.values()]
        self._kept: dict[tuple[int, int], Example] = {}

    def numbered(self, seed: int, number: int) -> Example:
        """Example `number` of a fixed sequence; the last few thousand asked for are kept."""
        if (seed, number) not in self._kept:
            if len(self._kept) >= _KEPT:
                del self._kept[next(iter(self._kept))]
            example = self.draw(generator(seed, "planned example", number))
            self._kept[seed, number] = example
        return self._kept[seed, number]

    def draw(self, rng: np.random.Generator) -> Example:
        """One example that the planner can execute."""
        while True:
            tree, own = self.trees[rng.choice(len(self.trees), p=self.weights)]
            if rng.random() < 0.35:
                example = self._at_home(tree, own[rng.integers(len(own))], rng)
            else:
                example = self._elsewhere(tree, rng)
            if example is not None:
                return example

    def draw_on(self, layout: Layout, rng: np.random.Generator) -> Example | None:
        """A tree for a given layout: the first of some varied ones that makes sense there."""
        present = sorted({block.color for block in layout.blocks})
        for _ in range(_ATTEMPTS * 5):
            tree, _ = self.trees[rng.choice(len(self.trees), p=self.weights)]
            begins = events(tree)[0].action.value == Action.DROP
            if begins != (layout.held is not None) or not present:
                continue
            new = _variation(rng)
            said = {v for v in _values(tree) if isinstance(v, ColorWord)}
            new |= _exchange({v: ColorWord(present[rng.integers(len(present))]) for v in said})
            example = _planned(_rewrite(tree, new), layout)
            if example is not None:
                return example
        return None

    def _at_home(self, tree: Tree, own: Layout, rng: np.random.Generator) -> Example | None:
        """A tree on its own layout, both recoloured and perhaps mirrored."""
        order = rng.permutation(len(_COLORS)) if rng.random() < 0.8 else range(len(_COLORS))
        colors = {color: _COLORS[place] for color, place in zip(_COLORS, order, strict=True)}
        mirrored = rng.random() < 0.4
        words = {ColorWord(c): ColorWord(n) for c, n in colors.items()}
        tree = _rewrite(tree, _exchange(words) | (_MIRRORED if mirrored else {}))
        columns = Columns.of(own)
        if rng.random() < 0.4:
            columns.edit(rng, _COLORS)
        return _planned(tree, columns.layout(colors, mirrored))

    def _elsewhere(self, tree: Tree, rng: np.random.Generator) -> Example | None:
        """A varied tree on the first of some foreign layouts where it makes sense."""
        tree = _rewrite(tree, _variation(rng))
        said = [Color(v) for v in _values(tree) if isinstance(v, ColorWord)]
        action = events(tree)[0].action.value
        for _ in range(_ATTEMPTS * (3 if action == Action.DROP else 1)):
            hues = [*said, *said, *(_COLORS[i] for i in rng.integers(len(_COLORS), size=3))]
            columns = self._foreign(rng, hues)
            if action == Action.DROP or (action == Action.MOVE and rng.random() < 0.03):
                columns.hold_one(rng)
            else:
                columns.held = None
            colors = {color: color for color in _COLORS}
            if rng.random() < 0.5:
                colors = {color: hues[int(rng.integers(len(hues)))] for color in _COLORS}
            example = _planned(tree, columns.layout(colors, rng.random() < 0.5))
            if example is not None:
                return example
        return None

    def _foreign(self, rng: np.random.Generator, hues: Sequence[Color]) -> Columns:
        """A random layout, or one of another command, edited or not."""
        if rng.random() < 0.4:
            return random_columns(rng, hues)
        foreign = self.layouts[rng.integers(len(self.layouts))]
        standing = {column: list(blocks) for column, blocks in foreign.standing.items()}
        columns = Columns(standing, foreign.held)
        if rng.random() < 0.6:
            columns.edit(rng, hues)
        return columns


_ATTEMPTS = 6
_KEPT = 4000
Exchange = dict[tuple[type, Any], Any]
"""New values by type and value: members of two enumerations may be equal strings."""


def _exchange(new: Mapping[Any, Any]) -> Exchange:
    return {(type(old), old): value for old, value in new.items()}


_MIRRORED = _exchange(
    {Indicator.LEFT: Indicator.RIGHT, Indicator.RIGHT: Indicator.LEFT}
) | _exchange({Relation.LEFT: Relation.RIGHT, Relation.RIGHT: Relation.LEFT})
_MIRRORED |= _exchange(
    {Indicator.LEFTMOST: Indicator.RIGHTMOST, Indicator.RIGHTMOST: Indicator.LEFTMOST}
)
_LIKE = (
    (Type.CUBE, Type.PRISM),
    (Type.STACK, Type.CUBE_GROUP),
    (Type.EDGE, Type.REGION),
    (Indicator.LEFTMOST, Indicator.NEAREST),
    (Indicator.LEFTMOST, Indicator.RIGHTMOST),
    (Relation.ABOVE, Relation.WITHIN),
)
_SIDES = (Indicator.LEFT, Indicator.FRONT, Indicator.RIGHT, Indicator.BACK)
_WAYS = (Relation.LEFT, Relation.FORWARD, Relation.RIGHT, Relation.BACKWARD)


def _planned(tree: Tree, layout: Layout) -> Example | None:
    try:
        return Example(tree, layout, plan(tree, layout))
    except PlanningError:
        return None


def _variation(rng: np.random.Generator) -> Exchange:
    """New colours, and often new sides, directions and numbers, for a tree."""
    colors = tuple(ColorWord)
    order = rng.permutation(len(colors))
    new = _exchange({color: colors[i] for color, i in zip(colors, order, strict=True)})
    if rng.random() < 0.6:
        turn = int(rng.integers(4))
        for around in (_SIDES, _WAYS):
            new |= _exchange({one: around[(i + turn) % 4] for i, one in enumerate(around)})
    if rng.random() < 0.5:
        new |= _exchange({number: int(rng.integers(1, 7)) for number in range(2, 8)})
        new |= _exchange({1: 1 if rng.random() < 0.5 else int(rng.integers(1, 5))})
    for pair in _LIKE:
        if rng.random() < 0.15:
            new |= _exchange({pair[0]: pair[1], pair[1]: pair[0]})
    return new


def _rewrite(node: Any, new: Exchange) -> Any:
    """A tree with the values of its leaves exchanged, but for names."""
    if isinstance(node, Leaf):
        return replace(node, value=new.get((type(node.value), node.value), node.value))
    if isinstance(node, tuple):
        return tuple(_rewrite(part, new) for part in node)
    if not is_dataclass(node) or isinstance(node, type):
        return node
    parts = {
        f.name: getattr(node, f.name) if f.name in _NAMES else _rewrite(getattr(node, f.name), new)
        for f in fields(node)
    }
    return type(node)(**parts)


_NAMES = ("id", "reference_id")


def _values(node: Any) -> list[Any]:
    """The values of all leaves of a tree."""
    if isinstance(node, Leaf):
        return [node.value]
    if isinstance(node, tuple):
        return [value for part in node for value in _values(part)]
    if not is_dataclass(node):
        return []
    return [value for f in fields(node) for value in _values(getattr(node, f.name))]


def _rarity(trees: Sequence[Tree]) -> Float[np.ndarray, " t"]:
    """For each tree how rare its rarest trait is: an attribute or a relation."""
    traits = []
    for tree in trees:
        program = compile_tree(tree)
        said: set[tuple[Any, ...]] = {
            ("attribute", a) for step in program.steps for a in step.attributes
        }
        said |= {("relation", r.number, r.ranks) for s in program.steps for r in s.related}
        if program.destination is not None:
            said.add(("destination", program.destination.number))
        traits.append(said)
    counts = Counter(trait for said in traits for trait in said)
    return np.array([max(counts[trait] ** -0.7 for trait in said) for said in traits])
