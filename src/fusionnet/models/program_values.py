"""The words in which programs of trees are written: kinds, attributes and relations, numbered.

What is numbered here has learned parameters in a network that runs programs; a change of
order or number makes older checkpoints unreadable.
"""

from enum import IntEnum
from itertools import product

from fusionnet.rcl import Indicator, Relation, Type

LARGEST_NUMBER = 8
"""Cardinals and measures above this are read as this: the board has eight tiles a side."""

MOST_COLORS = 3
"""Colours of one entity that are heard; the treebank has no more."""


class Kind(IntEnum):
    """What an entity is as a landmark: each kind has its own displacements."""

    BLOCK = 0
    GROUP = 1
    PLACE = 2
    BOARD = 3
    ROBOT = 4


class Subject(IntEnum):
    """What is related to a landmark: a thing that is there, a place, or where to put a block."""

    THING = 0
    PLACE = 1
    TARGET = 2


class Goal(IntEnum):
    """How the place of a command follows."""

    DESTINATION = 0
    LIFT = 1
    DOWN = 2


class Held(IntEnum):
    """Whether an entity is the block in the hand."""

    NO = 0
    YES = 1
    IF_ANY = 2


KIND_OF_TYPE = {
    Type.CUBE: Kind.BLOCK,
    Type.PRISM: Kind.BLOCK,
    Type.STACK: Kind.GROUP,
    Type.CUBE_GROUP: Kind.GROUP,
    Type.CORNER: Kind.PLACE,
    Type.EDGE: Kind.PLACE,
    Type.REGION: Kind.PLACE,
    Type.BOARD: Kind.BOARD,
    Type.ROBOT: Kind.ROBOT,
}
TYPES = tuple(KIND_OF_TYPE)

_NUMBERS = range(1, LARGEST_NUMBER + 1)
THINGS = tuple(t for t in TYPES if KIND_OF_TYPE[t] <= Kind.GROUP)
PLACES = tuple(t for t in TYPES if KIND_OF_TYPE[t] > Kind.GROUP)
_COLOR_COUNTS = range(MOST_COLORS + 1)
ATTRIBUTES = (
    *(f"type:{t}" for t in TYPES),
    *(f"thing indicator:{i}" for i in Indicator),
    *(f"type:{t} indicator:{i}" for t, i in product(PLACES, Indicator)),
    *(f"type:{t} cardinal:{n}" for t, n in product(THINGS, _NUMBERS)),
    *(f"type:{t} colors:{n}" for t, n in product(THINGS, _COLOR_COUNTS)),
    *(f"role:{role}" for role in ("moved", "held", "landmark", "destination")),
)
"""What can be said of an entity beside its colours; each has learned scores."""

DIRECTIONS = (
    Relation.LEFT,
    Relation.RIGHT,
    Relation.FORWARD,
    Relation.FRONT,
    Relation.BACKWARD,
)
"""Relations that may have a measure."""

RELATIONS = (
    *product(Relation, (0,), Subject, Kind),
    *product(DIRECTIONS, _NUMBERS, Subject, Kind),
)
"""Every relation with its measure (0: none), its subject and its landmark's kind."""

RANKINGS = tuple(product((Relation.NEAREST, Relation.ABOVE, Relation.WITHIN), (0,), Subject, Kind))
"""The relations that pick the best of several."""
