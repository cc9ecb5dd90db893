"""Words that people use for colours, numbers and things: what a synonym may replace.

Phrases are in plain form (lower case, no punctuation). The first of a colour's
are the usual ones; their weights follow what people were seen to type.
"""

import numpy as np

from fusionnet.rcl import Color

_COLORS: dict[Color, dict[str, float]] = {
    Color.BLUE: {"blue": 94, "dark blue": 3, "navy": 1, "navy blue": 1, "deep blue": 1},
    Color.CYAN: {
        "cyan": 42,
        "turquoise": 34,
        "sky blue": 9,
        "light blue": 7,
        "blue sky": 3,
        "aqua": 2,
        "teal": 2,
        "pale blue": 1,
    },
    Color.RED: {"red": 97, "dark red": 1, "scarlet": 1, "crimson": 1},
    Color.YELLOW: {"yellow": 98, "gold": 1, "golden": 1},
    Color.GREEN: {"green": 97, "dark green": 1, "light green": 1, "lime": 1},
    Color.MAGENTA: {
        "pink": 58,
        "purple": 21,
        "magenta": 16,
        "violet": 2,
        "fuchsia": 1,
        "dark pink": 1,
        "lilac": 1,
    },
    Color.GRAY: {"grey": 62, "gray": 33, "dark grey": 3, "dark gray": 1, "silver": 1},
    Color.WHITE: {"white": 96, "light grey": 3, "light gray": 1},
}

COLOR_PHRASES: dict[Color, tuple[tuple[str, ...], np.ndarray]] = {
    color: (tuple(phrases), np.array(list(phrases.values())) / sum(phrases.values()))
    for color, phrases in _COLORS.items()
}
"""For each colour its phrases and how often each is used."""

NUMBER_WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight")

_GROUPS: dict[str, tuple[str, ...]] = {
    "type:cube": ("cube", "block", "brick", "box", "square block", "building block"),
    "type:prism": ("prism", "pyramid", "tetrahedron", "triangle", "triangular block", "cone"),
    "type:stack": (
        "tower",
        "stack",
        "pillar",
        "column",
        "pile",
        "stack of blocks",
        "tower of cubes",
        "slab",
    ),
    "type:cube-group": ("blocks", "cubes", "bricks", "boxes"),
    "type:edge": ("edge", "margin", "border", "side"),
    "type:board": ("board", "floor", "ground", "table", "table top", "desk"),
    "type:robot": ("you", "robot", "yourself", "the robot"),
    "type:reference": ("it", "that", "this"),
    "relation:adjacent": ("next", "beside", "alongside", "adjacent"),
    "relation:forward": ("forward", "forwards", "ahead"),
    "relation:backward": ("backwards", "back", "backward"),
    "relation:nearest": ("nearest", "closest", "nearer", "closer"),
    "indicator:center": ("center", "centre", "middle", "central"),
    "indicator:individual": ("single", "lone", "solitary", "individual", "isolated"),
    "indicator:nearest": ("nearest", "closest"),
    "indicator:leftmost": ("leftmost", "left most", "most left", "furthest left"),
    "indicator:rightmost": ("rightmost", "right most", "most right", "furthest right"),
    "action:take": ("pick up", "take", "grab", "hold", "lift", "remove", "get", "grasp", "fetch"),
}
_MORE_GROUPS: dict[str, tuple[tuple[str, ...], ...]] = {
    "type:tile": (
        ("square", "space", "step", "tile", "cell", "field"),
        ("squares", "spaces", "steps", "tiles", "cells", "fields"),
    ),
    "relation:above": (
        ("on", "onto", "upon"),
        ("on top of", "on the top of", "atop"),
        ("above", "over"),
        ("placed on", "sitting on", "standing on", "resting on", "lying on"),
        ("placed on top of", "sitting on top of", "standing on top of", "located on top of"),
    ),
    "relation:within": (("in", "into", "inside"),),
    "action:drop": (
        ("put", "place", "set", "lay", "stack", "position"),
        ("drop", "release", "put down"),
    ),
    "action:move": (
        ("move", "shift", "transfer", "bring", "carry"),
        ("put", "place", "set", "stack", "position"),
    ),
}

SYNONYMS: dict[str, dict[str, tuple[str, ...]]] = {
    name: {
        phrase: tuple(other for other in group if other != phrase)
        for group in groups
        for phrase in group
    }
    for name, groups in {
        **{name: (group,) for name, group in _GROUPS.items()},
        **_MORE_GROUPS,
    }.items()
}
"""For each symbol, what may be said instead of a phrase."""

VERBS = frozenset(
    "move place put drop pick take shift grab hold remove lift lower get grasp fetch transfer "
    "bring carry set lay release stack position leave pop relocate return raise".split()
)
"""Words that ask for an action."""

BESIDE = ("next to", "next to", "next to", "beside", "alongside", "adjacent to")
"""Where a block is put that stands at another's side; the first word says so."""

OPENINGS = (
    "please",
    "now",
    "now please",
    "robot",
    "robot please",
    "could you",
    "could you please",
    "can you",
    "can you please",
    "would you",
    "ok",
    "okay",
    "next",
    "then",
    "i want you to",
    "i would like you to",
    "carefully",
    "slowly",
)
"""What people say before a command."""

_PLURALS = {
    "square": "squares",
    "space": "spaces",
    "step": "steps",
    "tile": "tiles",
    "cell": "cells",
    "field": "fields",
    "grid": "grids",
}
_SINGULARS = {plural: singular for singular, plural in _PLURALS.items()}


def singular_or_plural(word: str, *, plural: bool) -> str:
    """A word for tiles in the number that is asked for; other words stay as they are."""
    return _PLURALS.get(word, word) if plural else _SINGULARS.get(word, word)
