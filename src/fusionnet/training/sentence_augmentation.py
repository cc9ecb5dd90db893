"""New sentences from old ones, their trees changed with them.

Because alignments say which words stand for which part of a tree, parts can be
exchanged on both sides at once: colours are permuted, descriptions of entities
swapped between sentences, phrases replaced by others that say the same, numbers
and directions changed, left and right mirrored. What an edit cannot do truly it
does not do.
"""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fusionnet.models.tree_symbols import DESTINATION, ID, MEASURE
from fusionnet.rcl import Color, Relation
from fusionnet.sentences.phrases import (
    COLOR_PHRASES,
    NUMBER_WORDS,
    OPENINGS,
    SYNONYMS,
    singular_or_plural,
)
from fusionnet.training.aligned_sentences import (
    AlignedSentence,
    EntityPart,
    Span,
    entity_parts,
)

_DETERMINERS = frozenset({"the", "a", "an"})
_BLOCKS = frozenset({"type:cube", "type:prism", "type:stack", "type:cube-group"})
_MIRRORED = {"left": "right", "leftmost": "rightmost", "left-most": "right-most"}
_MIRRORED |= {b: a for a, b in _MIRRORED.items()}


@dataclass(frozen=True, kw_only=True)
class AugmentationConfig:
    """How often sentences are changed, as probabilities.

    Attributes:
        unchanged: That a sentence stays as it is but for slips of the pen.
        colors: That its colours are permuted.
        entities: That a description is swapped for another, each.
        phrases: That a phrase is replaced by another that means the same, each.
        directions: That a relation is replaced by another one, each.
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
    entities: float = 0.3
    phrases: float = 0.15
    directions: float = 0.04
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


class Description(NamedTuple):
    """An entity taken out of a sentence: its words, its symbols, and who says what."""

    words: tuple[str, ...]
    symbols: tuple[str, ...]
    spans: tuple[Span | None, ...]


@dataclass
class PhraseBook:
    """Phrases and descriptions found in sentences, by the context in which they may stand."""

    phrases: dict[tuple[str, ...], Counter[tuple[str, ...]]] = field(
        default_factory=lambda: defaultdict(Counter)
    )
    descriptions: dict[tuple[str, ...], list[Description]] = field(
        default_factory=lambda: defaultdict(list)
    )

    @classmethod
    def of(cls, sentences: Sequence[AlignedSentence]) -> "PhraseBook":
        """Collect from sentences."""
        book = cls()
        for sentence in sentences:
            for index, span in enumerate(sentence.spans):
                if span is not None:
                    words = sentence.words[span[0] : span[1] + 1]
                    book.phrases[_context(sentence, index)][words] += 1
            for part in entity_parts(sentence.symbols):
                taken = _description(sentence, part)
                if taken is not None:
                    book.descriptions[_place(sentence, part)].append(taken[1])
        return book

    def phrase(
        self, context: tuple[str, ...], rng: np.random.Generator, least: int = 2
    ) -> tuple[str, ...] | None:
        """A phrase for a context, the rarer ones a little more often than they are found."""
        found = self.phrases.get(context)
        if not found:
            return None
        kept = [(p, n) for p, n in found.items() if n >= least]
        if not kept:
            return None
        weights = np.array([n for _, n in kept], float) ** 0.7
        return kept[rng.choice(len(kept), p=weights / weights.sum())][0]


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
            sentence = self._swap_entities(sentence, rng)
            if rng.random() < c.mirror:
                sentence = mirrored(sentence)
            sentence = self._change_phrases(sentence, rng)
            if rng.random() < c.colors:
                sentence = recolored(sentence, rng)
            sentence = self._drop_fillers(sentence, rng)
            if rng.random() < c.pronouns:
                sentence = with_pronoun(sentence)
            if rng.random() < c.openings:
                opening = OPENINGS[rng.integers(len(OPENINGS))]
                sentence = _opened(sentence, opening)
        sentence = self._misspell(sentence, rng)
        if rng.random() < c.unsure:
            sentence = sentence._replace(holding=None)
        return sentence

    def _swap_entities(
        self, sentence: AlignedSentence, rng: np.random.Generator
    ) -> AlignedSentence:
        for turn in range(len(entity_parts(sentence.symbols))):
            parts = entity_parts(sentence.symbols)
            if turn >= len(parts) or rng.random() >= self.config.entities:
                continue
            part = parts[turn]
            others = self.book.descriptions.get(_place(sentence, part), [])
            taken = _description(sentence, part)
            if taken is None or len(others) < 2:
                continue
            (first, last), _ = taken
            other = others[rng.integers(len(others))]
            sentence = _with_description(sentence, part, first, last, other)
        return sentence

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
                other = f"relation:{list(Relation)[rng.integers(len(Relation))]}"
                turned = sentence.with_symbol(index, other)
                words = self.book.phrase(_context(turned, index), rng)
                if words is None:
                    continue
                sentence = turned
            elif chance < c.directions + c.phrases:
                words = self.book.phrase(_context(sentence, index), rng)
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


def recolored(sentence: AlignedSentence, rng: np.random.Generator) -> AlignedSentence:
    """The sentence with its colours exchanged for others, the same for the same."""
    colors = list(Color)
    order = rng.permutation(len(colors))
    other = {f"color:{a}": colors[i] for a, i in zip(colors, order, strict=True)}
    for index, name in enumerate(sentence.symbols):
        span = sentence.spans[index]
        if name not in other or span is None:
            continue
        color = other[name]
        phrases, weights = COLOR_PHRASES[color]
        phrase = phrases[rng.choice(len(phrases), p=weights)]
        sentence = sentence.with_words(*span, phrase.split()).with_symbol(index, f"color:{color}")
    return sentence


def mirrored(sentence: AlignedSentence) -> AlignedSentence:
    """The sentence with left and right exchanged; unchanged where a "left" says nothing."""
    said = [False] * len(sentence.words)
    symbols = list(sentence.symbols)
    for index, name in enumerate(symbols):
        kind, _, value = name.partition(":")
        span = sentence.spans[index]
        if value in _MIRRORED:
            symbols[index] = f"{kind}:{_MIRRORED[value]}"
            if span is None:
                return sentence
            said[span[0] : span[1] + 1] = [True] * (span[1] - span[0] + 1)
    sided = [place for place, word in enumerate(sentence.words) if word in _MIRRORED]
    if not all(said[place] for place in sided):
        return sentence
    words = tuple(_MIRRORED.get(word, word) for word in sentence.words)
    return sentence._replace(words=words, symbols=tuple(symbols))


def with_pronoun(sentence: AlignedSentence) -> AlignedSentence:
    """A drop of the held block with that block called "it"; other sentences as they are.

    Nobody in the treebank says so, but anybody would.
    """
    actions = [name for name in sentence.symbols if name.startswith("action:")]
    if actions != ["action:drop"] or not sentence.holding:
        return sentence
    part = entity_parts(sentence.symbols)[0]
    taken = _description(sentence, part)
    if taken is None:
        return sentence
    (first, last), _ = taken
    return _with_description(
        sentence, part, first, last, Description(("it",), ("type:reference",), ((0, 0),))
    )


def renumbered(sentence: AlignedSentence, index: int, number: int) -> AlignedSentence:
    """The sentence with another number of tiles; unchanged where it counts other things."""
    span = sentence.spans[index]
    tile = index + 1
    if span is None or tile >= len(sentence.symbols) or sentence.symbols[tile] != "type:tile":
        return sentence
    sentence = sentence.with_words(*span, (NUMBER_WORDS[number],))
    sentence = sentence.with_symbol(index, f"cardinal:{number}")
    span = sentence.spans[tile]
    if span is not None:
        word = singular_or_plural(sentence.words[span[1]], plural=number != 1)
        sentence = sentence.with_words(span[1], span[1], (word,))
    return sentence


def relocated(sentence: AlignedSentence, place: int, goal: int) -> AlignedSentence:
    """The sentence with one word moved to another place.

    A leaf whose words are torn apart keeps the longest part that still stands together.
    """
    order = list(range(len(sentence.words)))
    order.insert(goal, order.pop(place))
    now = {old: new for new, old in enumerate(order)}

    def moved(span: Span | None) -> Span | None:
        if span is None:
            return None
        runs: list[list[int]] = []
        for at in sorted(now[old] for old in range(span[0], span[1] + 1)):
            if runs and runs[-1][-1] == at - 1:
                runs[-1].append(at)
            else:
                runs.append([at])
        longest: list[int] = max(runs, key=len)
        return longest[0], longest[-1]

    words = tuple(sentence.words[old] for old in order)
    return sentence._replace(words=words, spans=tuple(moved(s) for s in sentence.spans))


def misspelt(word: str, rng: np.random.Generator) -> str:
    """A word with one letter lost, added, doubled or exchanged with its neighbour."""
    if len(word) < 3:
        return word
    at = int(rng.integers(len(word)))
    match int(rng.integers(4)):
        case 0:
            return word[:at] + word[at + 1 :]
        case 1:
            return word[:at] + chr(97 + int(rng.integers(26))) + word[at:]
        case 2:
            return word[: at + 1] + word[at:]
        case _:
            at = min(at, len(word) - 2)
            return word[:at] + word[at + 1] + word[at] + word[at + 2 :]


def _context(sentence: AlignedSentence, index: int) -> tuple[str, ...]:
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


def _place(sentence: AlignedSentence, part: EntityPart) -> tuple[str, ...]:
    """Which descriptions may stand where an entity stands."""
    head = sentence.symbols[part.head]
    kind = "block" if head in _BLOCKS else head
    named = "named" if sentence.symbols[part.first] == ID else ""
    return part.role, kind, named, "where" if part.in_destination else ""


def _description(sentence: AlignedSentence, part: EntityPart) -> tuple[Span, Description] | None:
    """The words and symbols of an entity, if its words are its own and stand together."""
    inside = range(part.first, part.end)
    if any("reference" in sentence.symbols[i] for i in inside) or part.role == MEASURE:
        return None
    said = [span for i in inside if (span := sentence.spans[i]) is not None]
    if not said or sentence.spans[part.head] is None:
        return None
    first, last = min(s[0] for s in said), max(s[1] for s in said)
    if first > 0 and sentence.words[first - 1] in _DETERMINERS:
        first -= 1
    for index, span in enumerate(sentence.spans):
        if index not in inside and span is not None and span[0] <= last and span[1] >= first:
            return None
    spans = (sentence.spans[i] for i in inside)
    own = tuple(None if s is None else (s[0] - first, s[1] - first) for s in spans)
    symbols = sentence.symbols[part.first : part.end]
    return (first, last), Description(sentence.words[first : last + 1], symbols, own)


def _with_description(
    sentence: AlignedSentence, part: EntityPart, first: int, last: int, new: Description
) -> AlignedSentence:
    """The sentence with an entity's words and symbols replaced by another's."""
    bare = sentence.with_words(first, last, new.words)
    spans = tuple(None if s is None else (s[0] + first, s[1] + first) for s in new.spans)
    return bare._replace(
        symbols=(*bare.symbols[: part.first], *new.symbols, *bare.symbols[part.end :]),
        spans=(*bare.spans[: part.first], *spans, *bare.spans[part.end :]),
    )


def _opened(sentence: AlignedSentence, opening: str) -> AlignedSentence:
    """The sentence behind a few words that say nothing."""
    words = opening.split()
    n = len(words)
    spans = tuple(None if s is None else (s[0] + n, s[1] + n) for s in sentence.spans)
    return sentence._replace(words=(*words, *sentence.words), spans=spans)
