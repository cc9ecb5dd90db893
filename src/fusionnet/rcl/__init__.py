"""Robot Command Language: typed trees, their text form, and what they say in plain English."""

from fusionnet.rcl.english import describe, outline
from fusionnet.rcl.grammar import LEAF_VALUES
from fusionnet.rcl.text import format, parse
from fusionnet.rcl.tree import (
    Entity,
    Event,
    Leaf,
    Measure,
    Node,
    Sequence,
    SpatialRelation,
    Tree,
    events,
)
from fusionnet.rcl.values import Action, Color, Indicator, Relation, Type

__all__ = [
    "LEAF_VALUES",
    "Action",
    "Color",
    "Entity",
    "Event",
    "Indicator",
    "Leaf",
    "Measure",
    "Node",
    "Relation",
    "Sequence",
    "SpatialRelation",
    "Tree",
    "Type",
    "describe",
    "events",
    "format",
    "outline",
    "parse",
]
