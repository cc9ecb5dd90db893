"""A picture of a Robot Command Language tree, with the words of the sentence aligned below.

Every leaf and every word has a column of its own; a leaf stands above its words,
and what no word says stands above a gap.
"""

import io
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusionnet import rcl
from fusionnet.apps.drawing import PAINT, hexadecimal, ink_on
from fusionnet.files import write_whole

INK, SOFT, LINE, PAPER = "#1d2430", "#667085", "#98a2b3", "#fefefe"
"""The colours of text, small text, edges and background; a page may replace them."""

_LETTER = 0.105
_ROW = 0.62
"""Inches: width of a letter, height of one level."""


@dataclass(frozen=True)
class Part:
    """One node as it is drawn: an inner one has parts, a leaf a value and maybe words."""

    name: str
    value: str = ""
    tokens: tuple[int, ...] = ()
    parts: tuple["Part", ...] = ()

    @property
    def height(self) -> int:
        """Levels below it."""
        return 1 + max((part.height for part in self.parts), default=-1)

    @property
    def leaves(self) -> tuple["Part", ...]:
        """All leaves below it, from left to right."""
        return tuple(leaf for part in self.parts for leaf in part.leaves) or (self,)

    @property
    def first_token(self) -> int:
        """The first word it speaks of; far to the right when none does."""
        return min((t for leaf in self.leaves for t in leaf.tokens), default=10_000)


def parts_of(node: rcl.Node | rcl.Leaf[Any], name: str = "") -> Part:
    """A tree as it is drawn: its children in the order of the words they stand for."""
    if isinstance(node, rcl.Leaf):
        return Part(name, str(node.value), node.tokens)
    match node:
        case rcl.Sequence(events):
            return Part("sequence", parts=tuple(parts_of(event) for event in events))
        case rcl.Event(action, entity, destination):
            children = [parts_of(action, "action"), parts_of(entity)]
            if destination is not None:
                children.append(Part("destination", parts=(parts_of(destination),)))
            return _node("event", children)
        case rcl.SpatialRelation(relation, landmark, measure):
            children = [] if measure is None else [parts_of(measure)]
            children.append(parts_of(relation, "relation"))
            children += [] if landmark is None else [parts_of(landmark)]
            return _node("spatial relation", children)
        case rcl.Measure(entity):
            return Part("measure", parts=(parts_of(entity),))
        case rcl.Entity():
            children = [parts_of(leaf, "indicator") for leaf in node.indicators]
            children += [] if node.cardinal is None else [parts_of(node.cardinal, "cardinal")]
            children += [parts_of(leaf, "color") for leaf in node.colors]
            children.append(parts_of(node.type, "type"))
            children += [parts_of(relation) for relation in node.relations]
            children += [] if node.id is None else [parts_of(node.id, "id")]
            if node.reference_id is not None:
                children.append(parts_of(node.reference_id, "reference"))
            return _node("entity", children)
    raise AssertionError(node)


def _node(name: str, children: list[Part]) -> Part:
    return Part(name, parts=tuple(sorted(children, key=lambda part: part.first_token)))


def draw_tree(tree: rcl.Tree, words: Sequence[str], *files: Path) -> None:
    """Draw a tree into files; their endings (.png, .svg) say how.

    Args:
        tree: What the sentence means.
        words: The tokens that the tree's word positions count, from the first.
        files: Where to.

    Raises:
        OutputError: If a file cannot be written.
    """
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    root = parts_of(tree)
    leaf_x, word_x, width = _columns(root.leaves, words)
    levels = root.height
    style: dict[Any, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": "fusionnet",
        "font.family": ["DejaVu Sans"],
        "font.size": 10,
        "text.parse_math": False,
    }
    with matplotlib.rc_context(style), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # words in scripts that the font lacks
        figure = pyplot.figure(figsize=(width, _ROW * (levels + 2.1)), facecolor=PAPER)
        try:
            axes = figure.add_axes((0, 0, 1, 1))
            axes.set(xlim=(0, width), ylim=(-_ROW * 1.6, _ROW * (levels + 0.5)))
            axes.axis("off")
            _draw_part(axes, root, leaf_x, levels)
            for leaf in root.leaves:
                for token in leaf.tokens:
                    if token <= len(words):
                        ends = [leaf_x[id(leaf)], word_x[token - 1]]
                        axes.plot(ends, [-0.3, -_ROW * 1.05], ":", color=LINE, lw=1)
            meant = {token for leaf in root.leaves for token in leaf.tokens}
            for position, (word, x) in enumerate(zip(words, word_x, strict=True), 1):
                color, weight = (INK, "bold") if position in meant else (SOFT, "normal")
                axes.text(
                    x, -_ROW * 1.3, word, ha="center", va="center", color=color, weight=weight
                )
            for file in files:
                metadata = {"Date": None} if file.suffix == ".svg" else None
                drawn = io.BytesIO()
                figure.savefig(drawn, format=file.suffix[1:], dpi=150, metadata=metadata)
                write_whole(file, drawn.getvalue())
        finally:
            pyplot.close(figure)


def _draw_part(axes: Any, part: Part, leaf_x: dict[int, float], level: int) -> float:
    """Draw a node and all below it; the result is where it stands."""
    if not part.parts:
        x = leaf_x[id(part)]
        axes.text(x, 0.19, part.name, ha="center", va="center", color=SOFT, size=7.5)
        fill, ink = "none", INK
        if part.name == "color" and part.value in PAINT:
            paint = PAINT[part.value]
            fill, ink = hexadecimal(paint), hexadecimal(ink_on(paint))
        pill = {"boxstyle": "round,pad=0.32", "facecolor": fill, "edgecolor": LINE}
        axes.text(
            x, -0.1, part.value, ha="center", va="center", color=ink, weight="bold", bbox=pill
        )
        return x
    y = _ROW * level
    below = [
        (_draw_part(axes, child, leaf_x, child.height), _ROW * child.height + 0.15)
        if child.parts
        else (_draw_part(axes, child, leaf_x, 0), 0.29)
        for child in part.parts
    ]
    x = (below[0][0] + below[-1][0]) / 2
    bar = y - 0.26
    edges = [([x, x], [y - 0.13, bar]), ([below[0][0], below[-1][0]], [bar, bar])]
    edges += [([child_x, child_x], [bar, child_y]) for child_x, child_y in below]
    for edge in edges:
        axes.plot(*edge, "-", color=LINE, lw=1.1, zorder=0, solid_capstyle="round")
    label = {"boxstyle": "round,pad=0.2", "facecolor": PAPER, "edgecolor": "none"}
    axes.text(x, y, part.name, ha="center", va="center", color=INK, size=9, bbox=label)
    return x


def _columns(
    leaves: Sequence[Part], words: Sequence[str]
) -> tuple[dict[int, float], list[float], float]:
    """Where each leaf (by identity) and each word stands, and the width of all, in inches."""
    columns: list[tuple[list[int], Part | None]] = [([i], None) for i in range(len(words))]
    for leaf in leaves:
        _give_column(columns, leaf, len(words))
    left, word_x, leaf_x = 0.25, [0.0] * len(words), {}
    for tokens, owner in columns:
        text = sum(len(words[t]) for t in tokens) + max(0, len(tokens) - 1)
        label = 0 if owner is None else max(len(owner.value) + 2, 0.8 * len(owner.name))
        width = _LETTER * max(text, label) + 0.16
        cursor = left + (width - _LETTER * text) / 2
        for token in tokens:
            word_x[token] = cursor + _LETTER * len(words[token]) / 2
            cursor += _LETTER * (len(words[token]) + 1)
        if owner is not None:
            leaf_x[id(owner)] = left + width / 2
        left += width
    return leaf_x, word_x, max(left + 0.25, 3.0)


def _give_column(columns: list[tuple[list[int], Part | None]], leaf: Part, count: int) -> None:
    """Give a leaf the column of its words (merged into one), or a new one beside the last's."""
    wanted = [t - 1 for t in leaf.tokens if t <= count]
    found = [i for i, (tokens, owner) in enumerate(columns) if owner is None and tokens]
    mine = [i for i in found if columns[i][0][0] in wanted]
    run = list(_leading_run(mine))
    if run:
        tokens = [t for i in run for t in columns[i][0]]
        columns[run[0] : run[-1] + 1] = [(tokens, leaf)]
        return
    owned = [i for i, (_, owner) in enumerate(columns) if owner is not None]
    columns.insert(owned[-1] + 1 if owned else 0, ([], leaf))


def _leading_run(numbers: Sequence[int]) -> Iterator[int]:
    """The numbers up to the first gap."""
    for place, number in enumerate(numbers):
        if place and number != numbers[place - 1] + 1:
            return
        yield number
