"""Trees as short runs of symbols, the language that the translator's decoder speaks.

A tree is written in preorder as its values, with few markers and no brackets:
`take id white cube above gray stack drop reference destination above red cube`.
That is 8.8 symbols a sentence in the treebank where the text form takes 67, and
nothing is lost:

- events follow each other; each begins with its action;
- an entity ends with its type; a relation right behind it is its own;
- a relation without an entity is followed by an action, a marker or nothing;
- `destination`, `measure` and `id` announce what they are called after;
- references refer to id 1; the marker `reference` says that an entity refers
  though its type does not say so, or does not though it does.
"""

from collections.abc import Iterator
from collections.abc import Sequence as Run
from typing import NamedTuple

from fusionnet.errors import TreeError
from fusionnet.rcl import (
    Action,
    Color,
    Entity,
    Event,
    Indicator,
    Leaf,
    Measure,
    Node,
    Relation,
    Sequence,
    SpatialRelation,
    Tree,
    Type,
    events,
)

PADDING = "<pad>"
START = "<start>"
END = "<end>"
DESTINATION = "destination"
MEASURE = "measure"
ID = "id"
REFERENCE = "reference"
SEQUENCE = "sequence"
CARDINALS = tuple(range(1, 9))

MARKERS = (PADDING, START, END, DESTINATION, MEASURE, ID, REFERENCE, SEQUENCE)
SYMBOLS: tuple[str, ...] = (
    *MARKERS,
    *(f"action:{v}" for v in Action),
    *(f"type:{v}" for v in Type),
    *(f"color:{v}" for v in Color),
    *(f"indicator:{v}" for v in Indicator),
    *(f"relation:{v}" for v in Relation),
    *(f"cardinal:{v}" for v in CARDINALS),
)
"""All symbols, in the order of their numbers."""

NUMBERS = {name: number for number, name in enumerate(SYMBOLS)}
"""The number of each symbol."""

LONGEST_RUN = 64
"""Symbols that a tree may take; the treebank's longest takes 22."""

_REFERRING = (Type.REFERENCE, Type.TYPE_REFERENCE, Type.TYPE_REFERENCE_GROUP)


class Symbol(NamedTuple):
    """One symbol, and the words (1-based token positions) that a leaf stands for."""

    name: str
    tokens: tuple[int, ...] = ()

    @property
    def kind(self) -> str:
        """What kind of leaf it is ("color"), or the marker itself."""
        return self.name.partition(":")[0]

    @property
    def is_leaf(self) -> bool:
        """Whether it is a value of the tree, not a marker."""
        return ":" in self.name


def symbols_of(tree: Tree) -> tuple[Symbol, ...]:
    """The symbols of a tree, its word positions kept.

    Raises:
        TreeError: If the tree has what the symbols cannot say: an id other than
            1, a cardinal above 8, or two relations at one entity.
    """
    return tuple(symbol for _, symbol in owned_symbols(tree))


def owned_symbols(tree: Tree) -> tuple[tuple[Node, Symbol], ...]:
    """The symbols of a tree, each behind the node that it belongs to.

    An event has its action; an entity its description and how it lies to its landmark, which
    is an entity of its own; a destination how the place lies to its landmark.

    Raises:
        TreeError: As `symbols_of`.
    """
    return tuple(_written(tree))


def tree_of(run: Run[Symbol]) -> Tree:
    """The tree that a run of symbols writes; the inverse of `symbols_of`.

    Raises:
        TreeError: If the run writes no tree; the message names the symbol.
    """
    reader = _Reader(run)
    single = reader.take(SEQUENCE) is not None
    found = [reader.event()]
    while reader.kind == "action":
        found.append(reader.event())
    if reader.kind is not None:
        raise reader.misfit("an action or the end")
    if single and len(found) > 1:
        raise TreeError("Malformed symbols: the marker 'sequence' stands before several events.")
    return Sequence(tuple(found)) if single or len(found) > 1 else found[0]


Written = Iterator[tuple[Node, Symbol]]


def _written(tree: Tree) -> Written:
    if isinstance(tree, Sequence) and len(tree.events) == 1:
        yield tree, Symbol(SEQUENCE)
    for event in events(tree):
        yield event, _leaf("action", event.action)
        yield from _entity(event.entity, event.entity)
        if event.destination is not None:
            yield event.destination, Symbol(DESTINATION)
            yield from _relation(event.destination, event.destination)


def _leaf(kind: str, leaf: Leaf) -> Symbol:
    return Symbol(f"{kind}:{leaf.value}", leaf.tokens)


def _entity(entity: Entity, owner: Node) -> Written:
    if len(entity.relations) > 1:
        raise TreeError("The translator's symbols hold one relation an entity.")
    for name in (entity.id, entity.reference_id):
        if name is not None and name.value != 1:
            raise TreeError(f"The translator's symbols hold id 1 only, not {name.value}.")
    if entity.cardinal is not None and entity.cardinal.value not in CARDINALS:
        raise TreeError(f"The translator's symbols count to 8, not {entity.cardinal.value}.")
    own = [] if entity.id is None else [Symbol(ID)]
    own += [_leaf("indicator", leaf) for leaf in entity.indicators]
    own += [] if entity.cardinal is None else [_leaf("cardinal", entity.cardinal)]
    own += [_leaf("color", leaf) for leaf in entity.colors]
    if (entity.type.value in _REFERRING) != (entity.reference_id is not None):
        own.append(Symbol(REFERENCE))
    own.append(_leaf("type", entity.type))
    for symbol in own:
        yield owner, symbol
    for relation in entity.relations:
        yield from _relation(relation, owner)


def _relation(relation: SpatialRelation, owner: Node) -> Written:
    if relation.measure is not None:
        if relation.measure.entity.relations:
            raise TreeError("The translator's symbols hold no relation inside a measure.")
        yield owner, Symbol(MEASURE)
        yield from _entity(relation.measure.entity, owner)
    yield owner, _leaf("relation", relation.relation)
    if relation.entity is not None:
        yield from _entity(relation.entity, relation.entity)


class _Reader:
    """Reads a run from left to right."""

    def __init__(self, run: Run[Symbol]) -> None:
        if len(run) > LONGEST_RUN:
            raise TreeError(f"A run of {len(run)} symbols; at most {LONGEST_RUN} are read.")
        self.run = run
        self.at = 0

    @property
    def kind(self) -> str | None:
        """The kind of the next symbol; nothing at the end."""
        return self.run[self.at].kind if self.at < len(self.run) else None

    def misfit(self, expected: str) -> TreeError:
        found = repr(self.run[self.at].name) if self.at < len(self.run) else "the end"
        return TreeError(
            f"Malformed symbols at number {self.at + 1}: expected {expected}, found {found}."
        )

    def take(self, kind: str) -> Symbol | None:
        """The next symbol if it is of a kind, read."""
        if self.kind != kind:
            return None
        self.at += 1
        return self.run[self.at - 1]

    def need(self, kind: str) -> Symbol:
        symbol = self.take(kind)
        if symbol is None:
            raise self.misfit(f"a symbol of kind {kind!r}")
        return symbol

    def event(self) -> Event:
        action = self.need("action")
        entity = self.entity()
        destination = self.relation() if self.take(DESTINATION) else None
        return Event(Leaf(Action(_value(action)), action.tokens), entity, destination)

    def entity(self, *, in_measure: bool = False) -> Entity:
        named = self.take(ID) is not None
        indicators, colors = [], []
        while (symbol := self.take("indicator")) is not None:
            indicators.append(Leaf(Indicator(_value(symbol)), symbol.tokens))
        cardinal = self.take("cardinal")
        while (symbol := self.take("color")) is not None:
            colors.append(Leaf(Color(_value(symbol)), symbol.tokens))
        turned = self.take(REFERENCE) is not None
        head = self.need("type")
        refers = (Type(_value(head)) in _REFERRING) != turned
        plain = in_measure or self.kind not in ("relation", MEASURE)
        return Entity(
            Leaf(Type(_value(head)), head.tokens),
            tuple(colors),
            tuple(indicators),
            Leaf(int(_value(cardinal)), cardinal.tokens) if cardinal else None,
            () if plain else (self.relation(),),
            Leaf(1) if named else None,
            Leaf(1) if refers else None,
        )

    def relation(self) -> SpatialRelation:
        measure = Measure(self.entity(in_measure=True)) if self.take(MEASURE) else None
        symbol = self.need("relation")
        starts_entity = ("indicator", "cardinal", "color", "type", ID, REFERENCE)
        entity = self.entity() if self.kind in starts_entity else None
        return SpatialRelation(Leaf(Relation(_value(symbol)), symbol.tokens), entity, measure)


def _value(symbol: Symbol) -> str:
    return symbol.name.partition(":")[2]
