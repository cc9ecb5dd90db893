"""The words that the leaves of a tree may hold.

They are all the values that the Robot Commands Treebank uses; the order is
that of their frequency there, and fixed, so that a network may number them.

References:
    Dukes (2014), SemEval-2014 task 6; thesis, sections 2.2 and 3.1.
"""

from enum import StrEnum


class Action(StrEnum):
    """What an event asks for: a drop begins with a held block, a take ends so."""

    TAKE = "take"
    DROP = "drop"
    MOVE = "move"


class Type(StrEnum):
    """What kind of thing an entity is."""

    CUBE = "cube"
    PRISM = "prism"
    REFERENCE = "reference"
    CORNER = "corner"
    STACK = "stack"
    REGION = "region"
    CUBE_GROUP = "cube-group"
    TILE = "tile"
    EDGE = "edge"
    TYPE_REFERENCE = "type-reference"
    ROBOT = "robot"
    BOARD = "board"
    TYPE_REFERENCE_GROUP = "type-reference-group"


class Color(StrEnum):
    """The eight colours of a block, in the order of the class numbers."""

    BLUE = "blue"
    CYAN = "cyan"
    RED = "red"
    YELLOW = "yellow"
    GREEN = "green"
    MAGENTA = "magenta"
    GRAY = "gray"
    WHITE = "white"


class Indicator(StrEnum):
    """What picks one thing among several, or one side of the board."""

    LEFT = "left"
    FRONT = "front"
    RIGHT = "right"
    BACK = "back"
    INDIVIDUAL = "individual"
    CENTER = "center"
    LEFTMOST = "leftmost"
    NEAREST = "nearest"
    RIGHTMOST = "rightmost"


class Relation(StrEnum):
    """How a thing or a place lies to a landmark."""

    ABOVE = "above"
    NEAREST = "nearest"
    WITHIN = "within"
    LEFT = "left"
    RIGHT = "right"
    FORWARD = "forward"
    BACKWARD = "backward"
    ADJACENT = "adjacent"
    FRONT = "front"
