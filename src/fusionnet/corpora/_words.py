"""The words of the synthetic corpus: how often people say what for each value of a tree.

The words and their shares follow the treebank's, with some more that people may
use. In a phrase, a bar marks a part that is said but not aligned: "to the |left".
"""

from fusionnet.rcl import Color, Indicator, Relation, Type

Choice = tuple[tuple[str, ...], tuple[int, ...]]
"""Phrases, and their shares."""


def choice(*weighted: tuple[str, int]) -> Choice:
    """Phrases and how often each is said."""
    return tuple(word for word, _ in weighted), tuple(weight for _, weight in weighted)


MOVES = choice(("move", 45), ("place", 25), ("put", 20), ("shift", 3), ("set", 2), ("lay", 1),
                ("transfer", 2), ("bring", 1), ("position", 1))  # fmt: skip
TAKES = choice(("pick up", 45), ("pick", 18), ("take", 14), ("grab", 6), ("lift", 5),
                ("remove", 5), ("hold", 2), ("get", 2), ("lift up", 2),
                ("take hold of", 1))  # fmt: skip
DROPS = choice(("drop", 55), ("place", 16), ("put", 12), ("lower", 4), ("put down", 6),
                ("release", 4), ("let go of", 1), ("set down", 2))  # fmt: skip
PUTS = choice(("drop", 50), ("place", 28), ("put", 20), ("set", 2))
THEN_PUTS = choice(("place", 45), ("put", 30), ("move", 15), ("drop", 5), ("set", 3), ("lay", 2))
COLORS = {
    Color.CYAN: choice(("cyan", 50), ("turquoise", 32), ("light blue", 8), ("sky blue", 10)),
    Color.GRAY: choice(("grey", 60), ("gray", 40)),
    Color.MAGENTA: choice(("pink", 50), ("purple", 25), ("magenta", 25)),
}
NOUNS = {
    Type.CUBE: choice(("cube", 45), ("block", 45), ("brick", 6), ("box", 4)),
    Type.PRISM: choice(("pyramid", 58), ("prism", 28), ("tetrahedron", 11), ("triangle", 3)),
    Type.STACK: choice(("tower", 62), ("stack", 18), ("parallelipiped", 8), ("pillar", 4),
                        ("column", 3), ("block tower", 2), ("stack of blocks", 3)),
    Type.EDGE: choice(("edge", 88), ("border", 7), ("margin", 5)),
    Type.TILE: choice(("square", 62), ("step", 15), ("space", 15), ("tile", 8)),
    Type.BOARD: choice(("floor", 40), ("board", 25), ("ground", 20), ("table", 15)),
}  # fmt: skip
DESTINATION_ABOVE = choice(("on", 38), ("on top of", 31), ("over", 9), ("above", 7), ("onto", 8),
                            ("on the top of", 3), ("to the |top of", 3), ("upon", 1))  # fmt: skip
CORNER_SIDES = {
    Indicator.FRONT: choice(("top", 75), ("far", 20), ("upper", 5)),
    Indicator.BACK: choice(("bottom", 62), ("back", 33), ("lower", 5)),
    Indicator.LEFT: choice(("left", 1)),
    Indicator.RIGHT: choice(("right", 1)),
}
INDICATORS = {
    Indicator.INDIVIDUAL: choice(("single", 88), ("lone", 6), ("individual", 6)),
    Indicator.LEFTMOST: choice(("leftmost", 60), ("left most", 40)),
    Indicator.RIGHTMOST: choice(("rightmost", 60), ("right most", 40)),
    Indicator.NEAREST: choice(("nearest", 65), ("closest", 35)),
    Indicator.LEFT: choice(("left", 1)),
    Indicator.RIGHT: choice(("right", 1)),
}
NEARS = choice(("closest", 55), ("nearest", 30), ("near", 12), ("closer", 3))
STEPS = {
    Relation.LEFT: choice(("to the |left", 60), ("left", 35), ("on the left", 5)),
    Relation.RIGHT: choice(("to the |right", 60), ("right", 35), ("on the right", 5)),
    Relation.FORWARD: choice(("forward", 65), ("forwards", 15), ("up", 20)),
    Relation.BACKWARD: choice(("backwards", 65), ("backward", 15), ("back", 20)),
}
BESIDES = {
    Relation.LEFT: choice(("to the |left of", 50), ("left of", 20), ("on the left side of", 15),
                           ("on the left of", 15)),
    Relation.RIGHT: choice(("to the |right of", 50), ("right of", 20),
                            ("on the right side of", 15), ("on the right of", 15)),
    Relation.FRONT: choice(("in front of", 1)),
    Relation.FORWARD: choice(("in front of", 1)),
    Relation.ADJACENT: choice(("next| to", 75), ("beside", 25)),
}  # fmt: skip
INTO = choice(("in", 58), ("into", 16), ("at", 8), ("to", 18))
YOU = choice(("you", 65), ("the |robot", 35))
CENTERS = choice(("center", 60), ("centre", 25), ("middle", 15))
AFTER_CENTER = choice(("", 70), ("of the board", 30))
AFTER_SIDE = choice(("", 75), ("side", 20), ("side of the board", 5))
WITHIN = choice(("in", 65), ("at", 35))
THAT_IS_ABOVE = choice(("on top of", 60), ("on", 25), ("above", 15))
STANDING = choice(("on", 55), ("on top of", 45))
ABOVE = choice(("on", 40), ("on top of", 40), ("above", 20))
JOINS = choice(("and", 78), (", and", 8), ("and then", 6), (", then", 3), (".", 5))
NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight")
