"""Readings of a sentence, and how to tell that even the best of them is none.

A network always answers something. Before its answer counts, every leaf of the tree
must rest on words that are known or nearly so, most of the sentence must be known,
the network must be reasonably sure, and where it is known what words say, every leaf
must rest on words that were seen to say it, and no telling word be left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from fusionnet.errors import NotUnderstoodError, TreeError
from fusionnet.models.lexicon import Lexicon
from fusionnet.models.tree_symbols import ID, Symbol, symbols_of
from fusionnet.rcl import Tree, Type
from fusionnet.sentences import Vocabulary, Words, edits, shortened
from fusionnet.sentences.phrases import VERBS

LEAST_PROBABILITY = 0.05
"""Below this, the best reading of a sentence is a guess."""

MOST_UNKNOWN = 0.34
"""Share of a sentence's words that may be unknown."""

LONGEST_SLIP = 24
"""Letters that a misspelt word, or two that were written as one, may have."""

OTHER_MEANINGS = frozenset(
    "not no never dont don't cannot can't without except unless if but instead "
    "what where when who whose why how "
    "make build stop swap switch rotate turn flip spin throw roll knock "
    "under beneath behind between through around against outside "
    "first second third fourth fifth last both every each either neither".split()
)
"""Words that change what a sentence asks for; where one is not known, nothing was understood."""

REFERENCE_TYPE = f"type:{Type.REFERENCE}"

EXAMPLE = "put the red pyramid on the blue cube"


@dataclass(frozen=True)
class Reading:
    """One way to understand a sentence.

    Attributes:
        tree: What it asks for; every leaf carries the positions of its words.
        probability: As the network sees it, among all readings.
        log_probability: Its natural logarithm.
        symbols: The tree as the network wrote it, one name a symbol (or token of its text).
        words: The sentence's words (or tokens) as the network read them.
        attention: How much each symbol looked at each word, all heads together; rows sum to
            at most 1, the rest went to the gripper's state.
    """

    tree: Tree
    probability: float
    log_probability: float
    symbols: tuple[str, ...]
    words: tuple[str, ...]
    attention: Float[np.ndarray, "symbols words"]


def refuse_what_is_no_command(
    sentence: str,
    words: Words,
    readings: Sequence[Reading],
    vocabulary: Vocabulary,
    lexicon: Lexicon | None = None,
) -> None:
    """Raise if a sentence was not understood.

    Raises:
        NotUnderstoodError: If too many words are unknown, if a part of the tree rests
            on unknown words alone or on words that never said it, if an action rests on no
            verb, if an unknown word is one of those that change what is asked for, if a
            telling word has no part in the tree, or if no reading is probable; the
            message names the unknown words and the nearest known ones.
    """
    strange = strange_words(words, vocabulary)
    best = readings[0] if readings else None
    if best is None or best.probability < LEAST_PROBABILITY:
        raise _not_understood(sentence, strange, vocabulary)
    if len(strange) > MOST_UNKNOWN * len(words):
        raise _not_understood(sentence, strange, vocabulary)
    changing = {at: word for at, word in strange.items() if word in OTHER_MEANINGS}
    if changing:
        raise _not_understood(sentence, changing, vocabulary)
    unknown = set(strange)
    try:
        symbols = symbols_of(best.tree)
    except TreeError:  # a tree as no corpus has one
        raise _not_understood(sentence, strange, vocabulary) from None
    for symbol in symbols:
        if not symbol.is_leaf:
            continue
        said = [
            w for at, w in zip(words.positions, words.texts, strict=True) if at in symbol.tokens
        ]
        if symbol.kind == "action" and not any(map(_asks, said)):
            raise _not_understood(sentence, strange, vocabulary)
        if symbol.tokens and all(token in unknown for token in symbol.tokens):
            told = {t: w for t, w in strange.items() if t in symbol.tokens}
            raise _not_understood(sentence, told, vocabulary)
    if lexicon is not None:
        _refuse_what_words_do_not_say(sentence, words, symbols, vocabulary, lexicon)


def _refuse_what_words_do_not_say(
    sentence: str,
    words: Words,
    symbols: Sequence[Symbol],
    vocabulary: Vocabulary,
    lexicon: Lexicon,
) -> None:
    """Raise if a leaf rests on words that never said it, or a telling word says nothing."""
    pairs = list(zip(words.positions, words.texts, strict=True))
    misspelt = {at: word for at, word in pairs if word not in vocabulary}
    named = any(symbol.name == ID for symbol in symbols)
    for symbol in symbols:
        if not symbol.is_leaf:
            continue
        said = [(at, word) for at, word in pairs if at in symbol.tokens]
        if not said:
            unsaid = symbol.name not in lexicon.silent
            if symbol.name == REFERENCE_TYPE:  # "put down", "pick the cube and place on the box"
                unsaid = bool(misspelt) and not named
            if unsaid:
                raise _not_understood(sentence, misspelt, vocabulary)
            continue
        meanings = {known for _, word in said for known in meant(word, vocabulary)}
        if not lexicon.supports(meanings, symbol.name):
            told = {at: word for at, word in said if at in misspelt}
            raise _not_understood(sentence, told, vocabulary)
    covered = {at for symbol in symbols for at in symbol.tokens}
    left = [word for at, word in pairs if at not in covered and word in lexicon.telling]
    if left:
        raise NotUnderstoodError(
            f"I did not understand {shortened(sentence)}: I see no place for "
            f"{', '.join(map(repr, dict.fromkeys(left[:4])))} in a command. Try {EXAMPLE!r}."
        )


def strange_words(words: Words, vocabulary: Vocabulary) -> dict[int, str]:
    """The words that are neither known nor a slip of the pen away from it, by token position."""
    pairs = zip(words.positions, words.texts, strict=True)
    return {at: word for at, word in pairs if not recognisable(word, vocabulary)}


def recognisable(word: str, vocabulary: Vocabulary) -> bool:
    """Whether a word is known, nearly so, or two known words written as one."""
    return bool(meant(word, vocabulary))


@lru_cache(maxsize=4096)
def meant(word: str, vocabulary: Vocabulary) -> frozenset[str]:
    """The known words that a word may stand for: itself, its two halves, or a slip away."""
    if word in vocabulary:
        return frozenset((word,))
    if word in OTHER_MEANINGS or len(word) > LONGEST_SLIP:
        return frozenset()
    halves = vocabulary.halves(word)
    if halves is not None:
        return frozenset(halves)
    most = 1 if len(word) < 8 else 2
    return frozenset(
        known
        for known in vocabulary.words
        if len(word) > 2
        and known[0] != "<"  # not the gripper's states
        and abs(len(known) - len(word)) <= most
        and edits(word, known) <= most
    )


def _asks(word: str) -> bool:
    """Whether a word asks for an action, perhaps misspelt or written with its neighbour."""
    if any(word.startswith(verb) or word.endswith(verb) for verb in VERBS):
        return True
    return any(edits(word, verb) <= 1 for verb in VERBS if abs(len(verb) - len(word)) < 2)


def _not_understood(
    sentence: str, strange: dict[int, str], vocabulary: Vocabulary
) -> NotUnderstoodError:
    said = f"I did not understand {shortened(sentence)}"
    told = list(dict.fromkeys(strange.values()))
    if not told:
        return NotUnderstoodError(
            f"{said}: it does not read as a command to move a block. "
            f"Say what to move and where to, for example {EXAMPLE!r}."
        )
    shown = ", ".join(shortened(word, 30) for word in told[:4]) + (", ..." if told[4:] else "")
    unsure = [word for word in told[:4] if word not in OTHER_MEANINGS]
    near = [n for word in unsure if (n := vocabulary.nearest(word, 0.7)) is not None]
    hint = f"; did you mean {', '.join(map(repr, near))}?" if near else f". Try {EXAMPLE!r}."
    kind = "the words" if len(told) > 1 else "the word"
    return NotUnderstoodError(f"{said}: I do not know {kind} {shown}{hint}")
