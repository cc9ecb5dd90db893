"""Readings of a sentence, and how to tell that even the best of them is none.

A network always answers something. Before its answer counts, every leaf of the tree
must rest on words that are known or nearly so, most of the sentence must be known,
and the network must be reasonably sure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fusionnet.errors import NotUnderstoodError, TreeError
from fusionnet.models.tree_symbols import symbols_of
from fusionnet.rcl import Tree
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
    sentence: str, words: Words, readings: Sequence[Reading], vocabulary: Vocabulary
) -> None:
    """Raise if a sentence was not understood.

    Raises:
        NotUnderstoodError: If too many words are unknown, if a part of the tree rests
            on unknown words alone, if an action rests on no verb, if an unknown word is
            one of those that change what is asked for, or if no reading is probable; the
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


def strange_words(words: Words, vocabulary: Vocabulary) -> dict[int, str]:
    """The words that are neither known nor a slip of the pen away from it, by token position."""
    pairs = zip(words.positions, words.texts, strict=True)
    return {at: word for at, word in pairs if not recognisable(word, vocabulary)}


def recognisable(word: str, vocabulary: Vocabulary) -> bool:
    """Whether a word is known, nearly so, or two known words written as one."""
    if word in vocabulary:
        return True
    if word in OTHER_MEANINGS or len(word) > LONGEST_SLIP:
        return False
    near = vocabulary.nearest(word)
    if near is not None and len(word) > 2 and edits(word, near) <= (1 if len(word) < 8 else 2):
        return True
    return vocabulary.halves(word) is not None


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
