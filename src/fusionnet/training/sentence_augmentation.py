"""New sentences from old ones, their trees changed with them.

Because alignments say which words stand for which part of a tree, parts can be
exchanged on both sides at once: colours are permuted; entities, their cores and
their modifiers swapped between sentences; phrases replaced by others that say the
same; numbers and directions changed; left and right mirrored. What an edit cannot do
truly it does not do.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from fusionnet.errors import InputError
from fusionnet.rcl import Relation
from fusionnet.sentences.phrases import BESIDE, OPENINGS, SYNONYMS
from fusionnet.training.aligned_sentences import DROP, AlignedSentence, entity_parts
from fusionnet.training.phrase_book import PhraseBook, Pool, phrase_context
from fusionnet.training.sentence_edits import (
    mirrored,
    misspelt,
    opened,
    recolored,
    relocated,
    renumbered,
    sent_to,
    set_beside,
    with_pronoun,
)
from fusionnet.training.sentence_pieces import (
    Piece,
    Place,
    context,
    core,
    exchanged,
    is_block,
    modifier,
    taken,
    whole,
)

NOTHING = Piece((), (), ())
"""What stands where a modifier was cut away."""


def _side(indicator: str, said: str) -> Piece:
    """A destination such as "to the right side of the board"."""
    symbols = ("relation:within", f"indicator:{indicator}", "type:region")
    return Piece(("to", "the", *said.split()), symbols, ((0, 0), (2, 2), None))


SIDES = tuple(
    _side(indicator, f"{name} {behind}")
    for indicator, names, behinds in (
        ("left", ("left",), ("side", "side of the board")),
        ("right", ("right",), ("side", "side of the board")),
        ("front", ("far", "top"), ("side", "side of the board")),
        ("back", ("near", "bottom"), ("side", "side of the board")),
        ("center", ("center", "centre", "middle"), ("", "of the board")),
    )
    for name in names
    for behind in behinds
)
"""Where people say that a block shall go, though it leaves open to which square: the treebank has
none of them."""

ONE = "type:type-reference"
"""What "one" says: of the kind that was spoken of last. Another description of the block before it
may speak of other things last."""

EDGE = "type:edge"
"""Annotators say above of it where people say "at", so that words of other relations mislead."""

MOST_SYMBOLS = 24
"""A sentence with more symbols is not made longer."""


@dataclass(frozen=True, kw_only=True)
class AugmentationConfig:
    """How often sentences are changed, as probabilities.

    Attributes:
        unchanged: That a sentence stays as it is but for slips of the pen.
        colors: That its colours are permuted.
        entities: That an entity is swapped for another of its context, each.
        cores: That a block's core is swapped for another, each.
        grafts: That a block without a modifier gets one, each; never one that is dropped.
        prunings: That a block with a modifier loses it, each.
        evenness: How much more often rare forms are drawn than they are found, 0 to 1.
        phrases: That a phrase is replaced by another that means the same, each.
        directions: That a relation is replaced by another one, each.
        beside: That a block is put next to the other one instead of upon it.
        sides: That a block is sent to a side of the board, or to its centre.
        numbers: That a number is changed, each.
        mirror: That left and right are exchanged.
        synonyms: That a word is replaced from our own list of synonyms, each.
        openings: That a polite opening is put before it.
        fillers: That a word that says nothing is left out, each.
        pronouns: That the block to drop is called "it", where the gripper holds one.
        slips: That a word is misspelt, each.
        joined: That two words are written as one, each sentence.
        moved: That a word is moved by one or two places, each sentence.
        unsure: That the gripper's state is hidden.
    """

    unchanged: float = 0.15
    colors: float = 0.6
    entities: float = 0.25
    cores: float = 0.12
    grafts: float = 0.08
    prunings: float = 0.03
    evenness: float = 0.5
    phrases: float = 0.15
    directions: float = 0.04
    beside: float = 0.02
    sides: float = 0.01
    numbers: float = 0.3
    mirror: float = 0.25
    synonyms: float = 0.05
    openings: float = 0.03
    fillers: float = 0.02
    pronouns: float = 0.1
    slips: float = 0.03
    joined: float = 0.03
    moved: float = 0.06
    unsure: float = 0.15

    def __post_init__(self) -> None:
        """Refuse what is no probability."""
        for name, value in asdict(self).items():
            if not 0 <= value <= 1:
                raise InputError(f"augmentation.{name} goes from 0 to 1; received {value}.")


class Augmenter:
    """Changes sentences at random; see `AugmentationConfig`.

    Args:
        sentences: What phrases and descriptions are collected from.
        config: How often what is done.
    """

    def __init__(self, sentences: Sequence[AlignedSentence], config: AugmentationConfig) -> None:
        self.book = PhraseBook.of(sentences)
        self.config = config

    def __call__(self, sentence: AlignedSentence, rng: np.random.Generator) -> AlignedSentence:
        """A changed copy of a sentence."""
        c = self.config
        if rng.random() >= c.unchanged:
            sentence = self._exchange_pieces(sentence, rng)
            if rng.random() < c.mirror:
                sentence = mirrored(sentence)
            sentence = self._change_phrases(sentence, rng)
            if rng.random() < c.beside:
                sentence = set_beside(sentence, BESIDE[rng.integers(len(BESIDE))].split())
            if rng.random() < c.sides:
                sentence = sent_to(sentence, SIDES[rng.integers(len(SIDES))])
            if rng.random() < c.colors:
                sentence = recolored(sentence, rng)
            sentence = self._drop_fillers(sentence, rng)
            if rng.random() < c.pronouns:
                sentence = with_pronoun(sentence)
            if rng.random() < c.openings:
                opening = OPENINGS[rng.integers(len(OPENINGS))]
                sentence = opened(sentence, opening)
        sentence = self._misspell(sentence, rng)
        if rng.random() < c.unsure:
            sentence = sentence._replace(holding=None)
        return sentence

    def _exchange_pieces(
        self, sentence: AlignedSentence, rng: np.random.Generator
    ) -> AlignedSentence:
        c = self.config
        for turn in range(len(entity_parts(sentence.symbols))):
            parts = entity_parts(sentence.symbols)
            if turn >= len(parts) or len(sentence.symbols) > MOST_SYMBOLS:
                break
            part, block = parts[turn], is_block(sentence, parts[turn])
            chances = rng.random(3)
            if part.role == "event" and ONE in sentence.symbols:
                continue
            if chances[0] < c.entities:
                pool = self.book.wholes.get(context(sentence, part))
                sentence = self._exchange(sentence, whole(sentence, part), pool, rng)
            elif block and chances[1] < c.cores:
                sentence = self._exchange(sentence, core(sentence, part), self.book.cores, rng)
            elif block and part.end > part.head + 1 and chances[2] < c.prunings:
                place = modifier(sentence, part)
                if place is not None and taken(sentence, place) is not None:
                    sentence = exchanged(sentence, place, NOTHING)
            elif (
                block and part.role != DROP and part.end == part.head + 1 and chances[2] < c.grafts
            ):
                pool = self.book.modifiers.get(part.in_destination)
                sentence = self._exchange(sentence, modifier(sentence, part), pool, rng)
        return sentence

    def _exchange(
        self,
        sentence: AlignedSentence,
        place: Place | None,
        pool: Pool | None,
        rng: np.random.Generator,
    ) -> AlignedSentence:
        """Another piece of a pool in a place, where what stands there may go."""
        if place is None or pool is None or taken(sentence, place) is None:
            return sentence
        piece = pool.draw(rng, self.config.evenness)
        return sentence if piece is None else exchanged(sentence, place, piece)

    def _change_phrases(
        self, sentence: AlignedSentence, rng: np.random.Generator
    ) -> AlignedSentence:
        c = self.config
        for index in range(len(sentence.symbols)):
            span, name = sentence.spans[index], sentence.symbols[index]
            if span is None:
                continue
            chance = rng.random()
            words: Sequence[str] | None = None
            if name.startswith("cardinal:") and chance < c.numbers:
                sentence = renumbered(sentence, index, int(rng.integers(1, 6)))
                continue
            if name.startswith("relation:") and chance < c.directions:
                if EDGE in sentence.symbols[index + 1 : index + 3]:
                    continue
                other = f"relation:{list(Relation)[rng.integers(len(Relation))]}"
                turned = sentence.with_symbol(index, other)
                words = self.book.phrase(phrase_context(turned, index), rng)
                if words is None:
                    continue
                sentence = turned
            elif chance < c.directions + c.phrases:
                words = self.book.phrase(phrase_context(sentence, index), rng)
            elif chance < c.directions + c.phrases + c.synonyms:
                said = " ".join(sentence.words[span[0] : span[1] + 1])
                known = SYNONYMS.get(name, {}).get(said, ())
                words = known[rng.integers(len(known))].split() if known else None
            if words is not None:
                sentence = sentence.with_words(*span, words)
        return sentence

    def _drop_fillers(self, sentence: AlignedSentence, rng: np.random.Generator) -> AlignedSentence:
        said = sentence.covered()
        for place in reversed(range(len(said))):
            if not said[place] and rng.random() < self.config.fillers and len(sentence.words) > 1:
                sentence = sentence.with_words(place, place, ())
        return sentence

    def _misspell(self, sentence: AlignedSentence, rng: np.random.Generator) -> AlignedSentence:
        c = self.config
        chances = rng.random(len(sentence.words))
        words = tuple(
            misspelt(word, rng) if chance < c.slips else word
            for word, chance in zip(sentence.words, chances, strict=True)
        )
        sentence = sentence._replace(words=words)
        if rng.random() < c.moved and len(words) > 2:
            place = int(rng.integers(len(words)))
            goal = place + int(rng.choice((-2, -1, 1, 2), p=(0.15, 0.35, 0.35, 0.15)))
            sentence = relocated(sentence, place, min(max(goal, 0), len(words) - 1))
        words = sentence.words
        if rng.random() < c.joined and len(words) > 2:
            place = int(rng.integers(len(words) - 1))
            sentence = sentence.with_words(place, place + 1, (words[place] + words[place + 1],))
        return sentence
