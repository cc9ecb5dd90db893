"""The typed, immutable nodes of a Robot Command Language tree.

A leaf carries the words of the sentence that it stands for. They are left out
of equality and hashing: two trees are equal when they mean the same, wherever
the words stood.

References:
    Thesis, section 2.2 and figure 2.11.
"""

from dataclasses import dataclass, field
from typing import Generic, TypeVar

from fusionnet.rcl.values import Action, Color, Indicator, Relation, Type

V = TypeVar("V", Action, Color, Indicator, Relation, Type, int)


@dataclass(frozen=True, slots=True)
class Leaf(Generic[V]):
    """One value, and the words it was read from.

    Attributes:
        value: The value: an enumeration member, or a whole number.
        tokens: 1-based positions of *all* its words in the sentence, a gapless
            ascending run; empty when no word says it. The text form writes
            the first and the last: `(token: 4 6)` is `(4, 5, 6)`.
    """

    value: V
    tokens: tuple[int, ...] = field(default=(), compare=False)


@dataclass(frozen=True, slots=True)
class Entity:
    """A block, several blocks, or a place, by its description.

    Attributes:
        type: What kind of thing it is.
        colors: Its colours; a stack has several, from the bottom to the top or
            from the top to the bottom.
        indicators: What picks it among several; two make a corner ("back", "left").
        cardinal: How many.
        relations: How it lies to other entities; every one must hold.
        id: Name under which a later entity refers to it.
        reference_id: The `id` of the entity that this one refers to.
    """

    type: Leaf[Type]
    colors: tuple[Leaf[Color], ...] = ()
    indicators: tuple[Leaf[Indicator], ...] = ()
    cardinal: Leaf[int] | None = None
    relations: tuple["SpatialRelation", ...] = ()
    id: Leaf[int] | None = None
    reference_id: Leaf[int] | None = None


@dataclass(frozen=True, slots=True)
class Measure:
    """A distance in tiles: `(measure: (entity: (cardinal: 2) (type: tile)))`."""

    entity: Entity


@dataclass(frozen=True, slots=True)
class SpatialRelation:
    """How something lies to a landmark.

    Attributes:
        relation: For example above or left.
        entity: The landmark; without one, the thing's own place before the move.
        measure: How far, when the sentence says so.
    """

    relation: Leaf[Relation]
    entity: Entity | None = None
    measure: Measure | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """One action on one entity, and where it shall go."""

    action: Leaf[Action]
    entity: Entity
    destination: SpatialRelation | None = None


@dataclass(frozen=True, slots=True)
class Sequence:
    """Events that follow each other: take this, then drop it there."""

    events: tuple[Event, ...]


Tree = Event | Sequence
"""What a sentence asks for."""

Node = Event | Sequence | SpatialRelation | Measure | Entity
"""Any inner node of a tree."""


def events(tree: Tree) -> tuple[Event, ...]:
    """The events of a tree, in order; one that is a single event has itself."""
    return tree.events if isinstance(tree, Sequence) else (tree,)
