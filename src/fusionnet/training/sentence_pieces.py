"""Pieces of aligned sentences that can be taken out and put into others.

A piece is a run of symbols together with the run of words that says it: a whole
entity, its *core* ("the red and green tower"), or its *modifier* ("that is near the
left edge"). Exchanging them makes trees that nobody has written yet.
"""

from typing import NamedTuple

from fusionnet.models.tree_symbols import ID, MEASURE
from fusionnet.training.aligned_sentences import AlignedSentence, EntityPart, Span

_DETERMINERS = frozenset({"the", "a", "an"})
_BLOCKS = frozenset({"type:cube", "type:prism", "type:stack", "type:cube-group"})


class Piece(NamedTuple):
    """Words, symbols, and which of the words say which symbol."""

    words: tuple[str, ...]
    symbols: tuple[str, ...]
    spans: tuple[Span | None, ...]

    @property
    def form(self) -> tuple[str, ...]:
        """Its symbols, colours aside."""
        return tuple("color" if n.startswith("color:") else n for n in self.symbols)


class Place(NamedTuple):
    """Where a piece stands in a sentence.

    Attributes:
        begin: Number of its first symbol.
        end: One more than the number of its last symbol.
        first: Its first word.
        last: Its last word; one before `first` if it has none.
    """

    begin: int
    end: int
    first: int
    last: int


def whole(sentence: AlignedSentence, part: EntityPart) -> Place | None:
    """The place of an entity, if its words are its own and stand together."""
    if part.role == MEASURE or sentence.spans[part.head] is None:
        return None
    return _place(sentence, part.first, part.end)


def core(sentence: AlignedSentence, part: EntityPart) -> Place | None:
    """The place of an entity without its name and its modifier."""
    if part.role == MEASURE or sentence.spans[part.head] is None:
        return None
    named = sentence.symbols[part.first] == ID
    return _place(sentence, part.first + named, part.head + 1)


def modifier(sentence: AlignedSentence, part: EntityPart) -> Place | None:
    """The place of what stands behind an entity's core to describe it, empty if there is nothing.

    The words that join both ("that is") belong to it.
    """
    place = core(sentence, part)
    if place is None:
        return None
    if part.end == part.head + 1:
        return Place(part.end, part.end, place.last + 1, place.last)
    said = [s for s in sentence.spans[part.head + 1 : part.end] if s is not None]
    if not said or min(s[0] for s in said) <= place.last:
        return None
    last = max(s[1] for s in said)
    return _alone(sentence, Place(part.head + 1, part.end, place.last + 1, last))


def taken(sentence: AlignedSentence, place: Place) -> Piece | None:
    """A copy of the piece in a place; None if it refers to something outside."""
    symbols = sentence.symbols[place.begin : place.end]
    if any("reference" in name for name in symbols):
        return None
    spans = tuple(
        None if s is None else (s[0] - place.first, s[1] - place.first)
        for s in sentence.spans[place.begin : place.end]
    )
    return Piece(sentence.words[place.first : place.last + 1], symbols, spans)


def exchanged(sentence: AlignedSentence, place: Place, piece: Piece) -> AlignedSentence:
    """The sentence with another piece in a place."""
    bare = sentence.with_words(place.first, place.last, piece.words)
    spans = (None if s is None else (s[0] + place.first, s[1] + place.first) for s in piece.spans)
    return bare._replace(
        symbols=(*bare.symbols[: place.begin], *piece.symbols, *bare.symbols[place.end :]),
        spans=(*bare.spans[: place.begin], *spans, *bare.spans[place.end :]),
    )


def is_block(sentence: AlignedSentence, part: EntityPart) -> bool:
    """Whether an entity is a block or several."""
    return sentence.symbols[part.head] in _BLOCKS


def context(sentence: AlignedSentence, part: EntityPart) -> tuple[str, ...]:
    """Which entities may stand where one stands: those of the same context."""
    kind = "block" if is_block(sentence, part) else sentence.symbols[part.head]
    named = "named" if sentence.symbols[part.first] == ID else ""
    return part.role, kind, named, "where" if part.in_destination else ""


def _place(sentence: AlignedSentence, begin: int, end: int) -> Place | None:
    """The place of some symbols, the determiner before their words included."""
    said = [s for s in sentence.spans[begin:end] if s is not None]
    if not said:
        return None
    first, last = min(s[0] for s in said), max(s[1] for s in said)
    if first > 0 and sentence.words[first - 1] in _DETERMINERS:
        first -= 1
    return _alone(sentence, Place(begin, end, first, last))


def _alone(sentence: AlignedSentence, place: Place) -> Place | None:
    """The place, if no symbol outside it is said by its words."""
    for index, span in enumerate(sentence.spans):
        outside = not place.begin <= index < place.end
        if outside and span is not None and span[0] <= place.last and span[1] >= place.first:
            return None
    return place
