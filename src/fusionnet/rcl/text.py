"""The text form of trees: `parse` and `format`, each the inverse of the other.

    tree      = event | (sequence: event event*)
    event     = (event: action entity [(destination: relation)])
    entity    = (entity: [id] indicator* [cardinal] color* type [reference-id] relation*)
    relation  = (spatial-relation: [(measure: entity)] (relation: ...) [entity])
    leaf      = (name: value [(token: first [last])])

`parse` takes the children of a node in any order and refuses everything else:
unknown names and values, missing or repeated children, brackets that do not
match. `format` writes them in the order above, which is the treebank's.

References:
    Thesis, figure 2.11.
"""

import re
from collections.abc import Iterator
from typing import Any

from fusionnet.catalogue import did_you_mean
from fusionnet.errors import TreeError
from fusionnet.rcl.grammar import BUILDERS, ENUMS, LEAF_VALUES, NUMBERS, Misfit, an
from fusionnet.rcl.tree import Entity, Event, Leaf, Sequence, SpatialRelation, Tree

LONGEST_TEXT = 20_000
"""Characters that a tree's text may have; the treebank's longest has under 700."""

DEEPEST = 40
"""Levels that a tree may have; the treebank's deepest has 13."""

LARGEST_NUMBER = 999
"""Largest cardinal, id or word position."""

_SCAN = re.compile(
    r"\(\s*(?:"
    r"(?P<leaf>[\w-]+)\s*:\s*(?P<value>[\w-]+)\s*"
    r"(?:\(\s*token\s*:\s*(?P<first>\d+)(?:\s+(?P<last>\d+))?\s*\)\s*)?\)"
    r"|(?P<node>[\w-]+)\s*:"
    r")\s*|(?P<close>\))\s*"
)


def parse(text: str) -> Tree:
    """The tree that a text writes.

    Raises:
        TreeError: If the text is malformed; the message names the position
            (1-based character) and what was expected there.
    """
    if len(text) > LONGEST_TEXT:
        raise TreeError(
            f"The tree's text has {len(text)} characters; at most {LONGEST_TEXT} are read."
        )
    position = len(text) - len(text.lstrip())
    # One open node a level: its name, where it began, and its children so far.
    open_nodes: list[tuple[str, int, list[tuple[str, Any]]]] = []
    children: list[tuple[str, Any]] = []
    scan = _SCAN.match
    while match := scan(text, position):
        name, value, first, last, node, close = match.groups()
        if name is not None:
            if not open_nodes:
                raise _malformed(position, f"a tree begins with an event or sequence, not {name!r}")
            key = (name, value, first, last)
            leaf = _LEAVES.get(key)
            if leaf is None:
                leaf = _leaf(name, value, first, last, position)
                if len(_LEAVES) < 50_000:
                    _LEAVES[key] = leaf
            children.append((name, leaf))
        elif node is not None:
            if node not in BUILDERS:
                known = [*BUILDERS, *LEAF_VALUES, *NUMBERS]
                said = "no value stands behind" if node in known else "there is no node called"
                raise _malformed(position, f"{said} {node!r}{did_you_mean(node, known)}")
            if len(open_nodes) == DEEPEST:
                raise _malformed(position, f"more than {DEEPEST} levels")
            children = []
            open_nodes.append((node, position, children))
        else:
            assert close
            if not open_nodes:
                raise _malformed(position, "')' closes nothing")
            built, began, inner = open_nodes.pop()
            try:
                result = BUILDERS[built](inner)
            except Misfit as misfit:
                raise _malformed(began, f"{an(built)} {misfit}") from None
            if open_nodes:
                children = open_nodes[-1][2]
                children.append((built, result))
            elif match.end() != len(text):
                raise _malformed(match.end(), "text after the end of the tree")
            elif isinstance(result, (Event, Sequence)):
                return result
            else:
                raise _malformed(began, f"a tree begins with an event or sequence, not {built!r}")
        position = match.end()
    if position < len(text):
        found = text[position : position + 12]
        raise _malformed(position, f"expected '(name: ...)' or ')', found {found!r}")
    if not open_nodes:
        raise _malformed(position, "there is no tree: the text is empty")
    name, began, _ = open_nodes[-1]
    raise _malformed(position, f"{name!r} from character {began + 1} is not closed")


def format(tree: Tree, tokens: bool = True) -> str:
    """The text form of a tree, with the word positions or without them."""
    return "".join(_write(tree, tokens))


def _malformed(position: int, what: str) -> TreeError:
    return TreeError(f"Malformed tree at character {position + 1}: {what}.")


_LEAVES: dict[tuple[str, str, str | None, str | None], Leaf[Any]] = {}
"""Leaves already read: they are few, and immutable."""


def _leaf(name: str, value: str, first: str | None, last: str | None, at: int) -> Leaf[Any]:
    """A leaf from its parts, as the text has them."""
    if name in NUMBERS:
        content: Any = _number(value, name, at)
        if str(content) != value:
            raise _malformed(at, f"{value!r} is not written as a whole number is")
    elif name in ENUMS:
        if value not in LEAF_VALUES[name]:
            known = list(LEAF_VALUES[name])
            raise _malformed(
                at,
                f"no {name} is called {value!r}; known: {', '.join(known)}"
                + did_you_mean(value, known).removesuffix("."),
            )
        content = ENUMS[name](value)
    elif name in BUILDERS:
        raise _malformed(at, f"{an(name)} holds further nodes, not the word {value!r}")
    else:
        known = [*LEAF_VALUES, *NUMBERS]
        raise _malformed(at, f"there is no leaf called {name!r}{did_you_mean(name, known)}")
    if first is None:
        return Leaf(content)
    begin = _number(first, "token", at)
    end = begin if last is None else _number(last, "token", at)
    if end < begin:
        raise _malformed(at, f"words {begin} to {end} run backwards")
    return Leaf(content, tuple(range(begin, end + 1)))


def _number(digits: str, name: str, at: int) -> int:
    """A whole number from 1 to `LARGEST_NUMBER`."""
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 6):
        raise _malformed(at, f"{an(name)} is a whole number, not {digits!r}")
    number = int(digits)
    if not 1 <= number <= LARGEST_NUMBER:
        raise _malformed(at, f"{an(name)} is 1 to {LARGEST_NUMBER}, not {number}")
    return number


def _write_leaf(name: str, leaf: Leaf[Any], tokens: bool) -> str:
    if not tokens or not leaf.tokens:
        return f"({name}: {leaf.value})"
    first, last = leaf.tokens[0], leaf.tokens[-1]
    return f"({name}: {leaf.value} (token: {first if first == last else f'{first} {last}'}))"


def _write(node: Any, tokens: bool) -> Iterator[str]:
    """The pieces of a node's text."""
    match node:
        case Sequence(events):
            yield "(sequence:"
            for event in events:
                yield " "
                yield from _write(event, tokens)
        case Event(action, entity, destination):
            yield f"(event: {_write_leaf('action', action, tokens)} "
            yield from _write(entity, tokens)
            if destination is not None:
                yield " (destination: "
                yield from _write(destination, tokens)
                yield ")"
        case SpatialRelation(relation, entity, measure):
            yield "(spatial-relation: "
            if measure is not None:
                yield "(measure: "
                yield from _write(measure.entity, tokens)
                yield ") "
            yield _write_leaf("relation", relation, tokens)
            if entity is not None:
                yield " "
                yield from _write(entity, tokens)
        case Entity():
            leaves: list[tuple[str, Leaf[Any] | None]] = [("id", node.id)]
            leaves += [("indicator", leaf) for leaf in node.indicators]
            leaves += [("cardinal", node.cardinal)]
            leaves += [("color", leaf) for leaf in node.colors]
            leaves += [("type", node.type), ("reference-id", node.reference_id)]
            written = (_write_leaf(name, leaf, tokens) for name, leaf in leaves if leaf is not None)
            yield "(entity: " + " ".join(written)
            for spatial_relation in node.relations:
                yield " "
                yield from _write(spatial_relation, tokens)
    yield ")"
