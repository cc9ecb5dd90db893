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

_LEAF = re.compile(
    r"\(\s*([\w-]+)\s*:\s*([\w-]+)\s*(?:\(\s*token\s*:\s*(\d+)(?:\s+(\d+))?\s*\)\s*)?\)\s*"
)
_NODE = re.compile(r"\(\s*([\w-]+)\s*:\s*")
_PIECES = re.compile(
    r"\(\s*[\w-]+\s*:\s*[\w-]+\s*(?:\(\s*token\s*:\s*\d+(?:\s+\d+)?\s*\)\s*)?\)\s*"
    r"|\(\s*[\w-]+\s*:\s*"
    r"|\)\s*|.",
    re.DOTALL,
)
"""A whole leaf, the opening of a node, a closing bracket, or one character that fits nowhere."""

_Child = tuple[str, Any]
"""A name and what it names: a leaf's value or a finished node."""


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
    pieces = _PIECES.findall(text, len(text) - len(text.lstrip()))

    def malformed(number: int, what: str) -> TreeError:
        """The error at the piece with this number."""
        position = len(text) - sum(map(len, pieces[number:]))
        return TreeError(f"Malformed tree at character {position + 1}: {what}.")

    # One open node a level: its name, the piece that began it, and its children so far.
    open_nodes: list[tuple[str, int, list[_Child]]] = []
    children: list[_Child] = []
    for number, piece in enumerate(pieces):
        if piece[0] != ")":
            try:
                known = _KNOWN.get(piece) or _learn(piece)
            except Misfit as misfit:
                raise malformed(number, str(misfit)) from None
            name, leaf = known
            if leaf is None:
                if len(open_nodes) == DEEPEST:
                    raise malformed(number, f"more than {DEEPEST} levels")
                children = []
                open_nodes.append((name, number, children))
            elif open_nodes:
                children.append(known)
            else:
                raise malformed(number, f"{_BEGINS}, not {name!r}")
            continue
        if not open_nodes:
            raise malformed(number, "')' closes nothing")
        name, began, inner = open_nodes.pop()
        try:
            result = BUILDERS[name](inner)
        except Misfit as misfit:
            raise malformed(began, f"{an(name)} {misfit}") from None
        if open_nodes:
            children = open_nodes[-1][2]
            children.append((name, result))
        elif number + 1 < len(pieces):
            raise malformed(number + 1, "text after the end of the tree")
        elif isinstance(result, (Event, Sequence)):
            return result
        else:
            raise malformed(began, f"{_BEGINS}, not {name!r}")
    if not open_nodes:
        raise malformed(len(pieces), "there is no tree: the text is empty")
    name, began, _ = open_nodes[-1]
    opened = len(text) - sum(map(len, pieces[began:])) + 1
    raise malformed(len(pieces), f"{name!r} from character {opened} is not closed")


def format(tree: Tree, tokens: bool = True) -> str:
    """The text form of a tree, with the word positions or without them."""
    return "".join(_write(tree, tokens))


_BEGINS = "a tree begins with an event or sequence"

_KNOWN: dict[str, _Child] = {}
"""Leaves, and openings of nodes (None), already read: they are few, and immutable."""


def _learn(piece: str) -> _Child:
    """What a piece says: a leaf, or None behind the name of a node that it opens.

    Raises:
        Misfit: If it says nothing that a tree may hold.
    """
    if match := _LEAF.fullmatch(piece):
        known: _Child = (match[1], _leaf(*match.groups()))
    elif match := _NODE.fullmatch(piece):
        if match[1] not in BUILDERS:
            names = [*BUILDERS, *LEAF_VALUES, *NUMBERS]
            said = "no value stands behind" if match[1] in names else "there is no node called"
            raise Misfit(f"{said} {match[1]!r}{did_you_mean(match[1], names)}")
        known = (match[1], None)
    else:
        raise Misfit(f"expected '(name: ...)' or ')', found {piece!r}")
    if len(piece) < 100 and len(_KNOWN) < 50_000:
        _KNOWN[piece] = known
    return known


def _leaf(name: str, value: str, first: str | None, last: str | None) -> Leaf[Any]:
    """A leaf from its parts, as the text has them."""
    if name in NUMBERS:
        content: Any = _number(value, name)
        if str(content) != value:
            raise Misfit(f"{value!r} is not written as a whole number is")
    elif name in ENUMS:
        if value not in LEAF_VALUES[name]:
            known = list(LEAF_VALUES[name])
            raise Misfit(
                f"no {name} is called {value!r}; known: {', '.join(known)}"
                + did_you_mean(value, known).removesuffix(".")
            )
        content = ENUMS[name](value)
    elif name in BUILDERS:
        raise Misfit(f"{an(name)} holds further nodes, not the word {value!r}")
    else:
        known = [*LEAF_VALUES, *NUMBERS]
        raise Misfit(f"there is no leaf called {name!r}{did_you_mean(name, known)}")
    if first is None:
        return Leaf(content)
    begin = _number(first, "token")
    end = begin if last is None else _number(last, "token")
    if end < begin:
        raise Misfit(f"words {begin} to {end} run backwards")
    return Leaf(content, tuple(range(begin, end + 1)))


def _number(digits: str, name: str) -> int:
    """A whole number from 1 to `LARGEST_NUMBER`."""
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 6):
        raise Misfit(f"{an(name)} is a whole number, not {digits!r}")
    number = int(digits)
    if not 1 <= number <= LARGEST_NUMBER:
        raise Misfit(f"{an(name)} is 1 to {LARGEST_NUMBER}, not {number}")
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
