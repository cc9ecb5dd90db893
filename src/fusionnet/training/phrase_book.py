"""Phrases and pieces collected from sentences, by the context in which each may stand."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fusionnet.models.tree_symbols import DESTINATION, MEASURE
from fusionnet.training.aligned_sentences import AlignedSentence, entity_parts
from fusionnet.training.sentence_pieces import (
    Piece,
    context,
    core,
    is_block,
    modifier,
    taken,
    whole,
)

Context = tuple[str, ...]


class Pool:
    """Pieces that may stand for each other; rare forms are drawn more often than they are found."""

    def __init__(self) -> None:
        self.forms: dict[tuple[str, ...], list[Piece]] = defaultdict(list)

    def add(self, piece: Piece) -> None:
        """Put a piece in."""
        self.forms[piece.form].append(piece)

    def draw(self, rng: np.random.Generator, evenness: float) -> Piece | None:
        """A piece; `evenness` 0 draws forms as often as they are found, 1 all alike."""
        if not self.forms:
            return None
        weights = np.array([len(pieces) for pieces in self.forms.values()], float)
        weights **= 1 - evenness
        chosen = int(rng.choice(len(weights), p=weights / weights.sum()))
        pieces = list(self.forms.values())[chosen]
        return pieces[rng.integers(len(pieces))]


@dataclass
class PhraseBook:
    """What sentences are made of.

    Attributes:
        phrases: Words that say one symbol.
        wholes: Whole entities.
        cores: Blocks without name and modifier.
        modifiers: What describes a block behind its core; key: is it part of a destination?
    """

    phrases: dict[Context, Counter[tuple[str, ...]]] = field(
        default_factory=lambda: defaultdict(Counter)
    )
    wholes: dict[Context, Pool] = field(default_factory=lambda: defaultdict(Pool))
    cores: Pool = field(default_factory=Pool)
    modifiers: dict[bool, Pool] = field(default_factory=lambda: defaultdict(Pool))

    @classmethod
    def of(cls, sentences: Sequence[AlignedSentence]) -> "PhraseBook":
        """Collect from sentences."""
        book = cls()
        for sentence in sentences:
            for index, span in enumerate(sentence.spans):
                if span is not None:
                    words = sentence.words[span[0] : span[1] + 1]
                    book.phrases[phrase_context(sentence, index)][words] += 1
            for part in entity_parts(sentence.symbols):
                pools = [(whole, book.wholes[context(sentence, part)])]
                if is_block(sentence, part):
                    pools.append((core, book.cores))
                    pools.append((modifier, book.modifiers[part.in_destination]))
                for where, pool in pools:
                    place = where(sentence, part)
                    piece = None if place is None else taken(sentence, place)
                    if piece is not None and piece.symbols:
                        pool.add(piece)
        return book

    def phrase(
        self, context: Context, rng: np.random.Generator, least: int = 2
    ) -> tuple[str, ...] | None:
        """A phrase for a context, the rarer ones a little more often than they are found."""
        kept = [(p, n) for p, n in self.phrases.get(context, {}).items() if n >= least]
        if not kept:
            return None
        weights = np.array([n for _, n in kept], float) ** 0.7
        return kept[rng.choice(len(kept), p=weights / weights.sum())][0]


def phrase_context(sentence: AlignedSentence, index: int) -> tuple[str, ...]:
    """Where a symbol's phrase stands: phrases of one context can stand for each other."""
    name = sentence.symbols[index]
    kind = name.partition(":")[0]
    span = sentence.spans[index]
    if kind == "action":
        places = [i for i, s in enumerate(sentence.symbols) if s.startswith("action:")]
        turn = "only" if len(places) == 1 else str(places.index(index))
        held = str(sentence.holding) if turn == "only" else ""
        return name, turn, held, str(_has_destination(sentence.symbols, index))
    if kind == "relation":
        before = sentence.symbols[index - 1]
        measured = before == "type:tile"
        role = MEASURE if measured else DESTINATION if before == DESTINATION else "modifier"
        assert span is not None
        behind = index + 1 < len(sentence.symbols)
        following = sentence.symbols[index + 1].partition(":")[0] if behind else ""
        landmark = following not in ("", "action", DESTINATION)
        left = sentence.words[span[0] - 1] if span[0] > 0 else ""
        said = any(s is not None and s[0] <= span[0] - 1 <= s[1] for s in sentence.spans)
        return name, role, str(landmark), "" if said else left
    return (name,)


def _has_destination(symbols: Sequence[str], action: int) -> bool:
    for name in symbols[action + 1 :]:
        if name.startswith("action:"):
            return False
        if name == DESTINATION:
            return True
    return False
