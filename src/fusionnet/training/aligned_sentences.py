"""Sentences with the tree symbols that they mean and the words of each: what the translator learns.

An `AlignedSentence` can be edited word by word; its alignments stay true. The
augmentations are built from that.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from fusionnet.corpora import Command
from fusionnet.errors import TreeError
from fusionnet.models.tree_symbols import DESTINATION, MEASURE, symbols_of
from fusionnet.rcl import Tree
from fusionnet.sentences import words_of

DROP = "action:drop"
"""Role of the entity that is let go. The gripper holds it, so that it is not described by where
it is: in "drop the cube on the red block" the red block is where to."""

Span = tuple[int, int]
"""First and last word of a leaf, from 0; both belong to it."""


class AlignedSentence(NamedTuple):
    """The words of a command, its tree as symbols, and which words say which symbol.

    Attributes:
        words: In lower case, without punctuation.
        symbols: Names of the tree's symbols, in preorder.
        spans: For each symbol its words; None for markers and what no word says.
        holding: Whether the gripper held a block when it was said; None if unknown.
    """

    words: tuple[str, ...]
    symbols: tuple[str, ...]
    spans: tuple[Span | None, ...]
    holding: bool | None = None

    def with_words(self, first: int, last: int, words: Sequence[str]) -> "AlignedSentence":
        """The sentence with the words `first` to `last` replaced by others.

        Leaves said by some of the replaced words are then said by all the new ones, or
        by none when there are none. A leaf of which only a part is replaced grows or
        shrinks with it.
        """
        grown = len(words) - (last - first + 1)

        def moved(span: Span | None) -> Span | None:
            if span is None or span[1] < first:
                return span
            if span[0] > last:
                return span[0] + grown, span[1] + grown
            begin = min(span[0], first)
            end = max(span[1], last) + grown
            return (begin, end) if end >= begin else None

        return self._replace(
            words=(*self.words[:first], *words, *self.words[last + 1 :]),
            spans=tuple(moved(span) for span in self.spans),
        )

    def with_symbol(self, index: int, name: str) -> "AlignedSentence":
        """The sentence with one symbol exchanged."""
        return self._replace(symbols=(*self.symbols[:index], name, *self.symbols[index + 1 :]))

    def covered(self) -> list[bool]:
        """For each word whether it says a symbol."""
        said = [False] * len(self.words)
        for span in self.spans:
            if span is not None:
                said[span[0] : span[1] + 1] = [True] * (span[1] - span[0] + 1)
        return said


class EntityPart(NamedTuple):
    """Where an entity stands among the symbols of a sentence, and in which role.

    Attributes:
        first: Number of its first symbol.
        end: One more than the number of its last symbol, its own relation included.
        head: Number of its type.
        role: What it is to the symbol above it: `DROP` for what is dropped, "event" for what is
            taken or moved, else for example "relation:above".
        in_destination: Whether it describes where to.
    """

    first: int
    end: int
    head: int
    role: str
    in_destination: bool


def aligned(command: Command) -> AlignedSentence | None:
    """A command as an aligned sentence; None if the symbols cannot write its tree."""
    return aligned_with(command.sentence, command.tree, command.scene.before.held is not None)


def aligned_with(sentence: str, tree: Tree, holding: bool | None) -> AlignedSentence | None:
    """A sentence with its tree; None if the symbols cannot write the tree.

    Args:
        sentence: What was said.
        tree: What it means; its leaves carry the positions of their words.
        holding: Whether the gripper held a block; None if unknown.
    """
    try:
        run = symbols_of(tree)
    except TreeError:
        return None
    words = words_of(sentence)
    index = {position: i for i, position in enumerate(words.positions)}
    spans: list[Span | None] = []
    for symbol in run:
        said = [index[t] for t in symbol.tokens if t in index]
        spans.append((said[0], said[-1]) if said else None)
    return AlignedSentence(words.texts, tuple(s.name for s in run), tuple(spans), holding)


def aligned_all(commands: Iterable[Command]) -> list[AlignedSentence]:
    """All commands that can be aligned."""
    return [a for c in commands if (a := aligned(c)) is not None and a.words]


def describes_what_is_dropped(sentence: AlignedSentence) -> bool:
    """Whether a tree tells by its place what the gripper lets go, instead of where to.

    Two of the treebank's 2,500 do, and teach that "drop the cube next to the red one" means to let
    go right here.
    """
    return any(p.role == DROP and p.end > p.head + 1 for p in entity_parts(sentence.symbols))


def entity_parts(symbols: Sequence[str]) -> list[EntityPart]:
    """The entities of a well-formed run of symbols, the outer ones first."""
    parts: list[EntityPart] = []

    def kind(at: int) -> str:
        return symbols[at].partition(":")[0] if at < len(symbols) else ""

    def entity(at: int, role: str, where: bool, measured: bool = False) -> int:
        place, first = len(parts), at
        parts.append(EntityPart(first, first, first, role, where))
        while kind(at) != "type":
            at += 1
        head = at
        at += 1
        if not measured and kind(at) in ("relation", MEASURE):
            at = relation(at, where)
        parts[place] = EntityPart(first, at, head, role, where)
        return at

    def relation(at: int, where: bool) -> int:
        if kind(at) == MEASURE:
            at = entity(at + 1, MEASURE, where, measured=True)
        name = symbols[at]
        at += 1
        if kind(at) not in ("", "action", DESTINATION, MEASURE, "relation"):
            at = entity(at, name, where)
        return at

    at = 0
    while at < len(symbols):
        if kind(at) == "action":
            at = entity(at + 1, symbols[at] if symbols[at] == DROP else "event", False)
        elif kind(at) == DESTINATION:
            at = relation(at + 1, True)
        else:
            at += 1
    return parts
