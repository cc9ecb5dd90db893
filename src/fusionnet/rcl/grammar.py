"""The grammar: which children a node may have, and which values a leaf."""

from collections.abc import Callable
from typing import Any

from fusionnet.rcl.tree import Entity, Event, Leaf, Measure, Sequence, SpatialRelation
from fusionnet.rcl.values import Action, Color, Indicator, Relation, Type

LEAF_VALUES: dict[str, tuple[str, ...]] = {
    "action": tuple(Action),
    "type": tuple(Type),
    "color": tuple(Color),
    "indicator": tuple(Indicator),
    "relation": tuple(Relation),
}
"""The values that a leaf of each name may hold; `cardinal`, `id`, `reference-id` hold numbers."""

NUMBERS = ("cardinal", "id", "reference-id")
"""Leaves that hold whole numbers."""

ENUMS: dict[str, Callable[[str], Any]] = {
    "action": Action,
    "type": Type,
    "color": Color,
    "indicator": Indicator,
    "relation": Relation,
}


class Misfit(Exception):
    """A node's children do not fit it; `parse` adds the position."""


def an(name: str) -> str:
    """The name with its article."""
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _one(
    children: list[tuple[str, Any]], allowed: tuple[str, ...], needed: tuple[str, ...]
) -> dict[str, Any]:
    """The children by name, each at most once, only `allowed` ones, all `needed` ones."""
    found: dict[str, Any] = {}
    for name, child in children:
        if name not in allowed:
            raise Misfit(f"cannot hold {an(name)}; it holds {', '.join(allowed)}")
        if name in found:
            raise Misfit(f"holds {name!r} twice")
        found[name] = child
    for name in needed:
        if name not in found:
            raise Misfit(f"needs {an(name)}")
    return found


def _entity(children: list[tuple[str, Any]]) -> Entity:
    single: dict[str, Any] = {}
    colors: list[Leaf[Color]] = []
    indicators: list[Leaf[Indicator]] = []
    relations: list[SpatialRelation] = []
    for name, child in children:
        if name == "color":
            colors.append(child)
        elif name == "spatial-relation":
            relations.append(child)
        elif name == "indicator":
            indicators.append(child)
        elif name in single:
            raise Misfit(f"holds {name!r} twice")
        elif name in _ENTITY_PARTS:
            single[name] = child
        else:
            raise Misfit(f"cannot hold {an(name)}")
    if "type" not in single:
        raise Misfit("needs a type")
    return Entity(
        single["type"],
        tuple(colors),
        tuple(indicators),
        single.get("cardinal"),
        tuple(relations),
        single.get("id"),
        single.get("reference-id"),
    )


_ENTITY_PARTS = ("type", "id", "reference-id", "cardinal")


def _spatial_relation(children: list[tuple[str, Any]]) -> SpatialRelation:
    parts = _one(children, ("measure", "relation", "entity"), ("relation",))
    return SpatialRelation(parts["relation"], parts.get("entity"), parts.get("measure"))


def _event(children: list[tuple[str, Any]]) -> Event:
    parts = _one(children, ("action", "entity", "destination"), ("action", "entity"))
    return Event(parts["action"], parts["entity"], parts.get("destination"))


def _sequence(children: list[tuple[str, Any]]) -> Sequence:
    if not children:
        raise Misfit("needs an event")
    for name, _ in children:
        if name != "event":
            raise Misfit(f"cannot hold {an(name)}; it holds events")
    return Sequence(tuple(child for _, child in children))


BUILDERS: dict[str, Callable[[list[tuple[str, Any]]], Any]] = {
    "sequence": _sequence,
    "event": _event,
    "destination": lambda c: _one(c, ("spatial-relation",), ("spatial-relation",))[
        "spatial-relation"
    ],
    "spatial-relation": _spatial_relation,
    "measure": lambda c: Measure(_one(c, ("entity",), ("entity",))["entity"]),
    "entity": _entity,
}
