"""Sentences to tokens and words: split at spaces and around punctuation, then made plain.

A *token* is what word positions in a tree count: a run of letters and digits (an
apostrophe inside belongs to it), or one other visible character. A *word* is a
token as a network reads it: in lower case, digits spelt out, punctuation dropped.

References:
    Thesis, section 3.4.
"""

import re
import unicodedata
from dataclasses import dataclass
from typing import NamedTuple

from fusionnet.errors import NotUnderstoodError

MOST_WORDS = 200
"""Words that a sentence may have, the thesis's greatest source length (table 7.1)."""

MOST_CHARACTERS = 4000
"""Characters that a sentence may have."""

_TOKEN = re.compile(r"[^\W_]+(?:['\u2019][^\W_]+)*|[^\w\s]|_")
_DIGITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


class Token(NamedTuple):
    """A piece of a sentence, and where it stands: `sentence[start:end] == text`."""

    text: str
    start: int
    end: int

    @property
    def is_word(self) -> bool:
        """Whether it holds letters or digits."""
        return self.text[0].isalnum()


@dataclass(frozen=True, slots=True)
class Words:
    """The words of a sentence.

    Attributes:
        texts: The words, in lower case.
        positions: For each word the 1-based position of its token in the sentence.
    """

    texts: tuple[str, ...]
    positions: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.texts)


def tokenize(sentence: str) -> tuple[Token, ...]:
    """The tokens of a sentence, punctuation included."""
    return tuple(Token(m.group(), m.start(), m.end()) for m in _TOKEN.finditer(sentence))


def plain(token: str) -> str:
    """A token as a network reads it: `"Blue"` is `"blue"`, `"2"` is `"two"`."""
    if token.isascii():
        word = token.lower()
    else:
        word = unicodedata.normalize("NFKC", token.replace("\u2019", "'")).casefold()
    if word.isascii() and word.isdigit() and len(word) <= 2 and int(word) < len(_DIGITS):
        return _DIGITS[int(word)]
    return word


def words_of(sentence: str) -> Words:
    """The words of a sentence and their positions among its tokens."""
    numbered = [(i, plain(t.text)) for i, t in enumerate(tokenize(sentence), 1) if t.is_word]
    return Words(tuple(w for _, w in numbered), tuple(i for i, _ in numbered))


def readable_words(sentence: str) -> Words:
    """The words of a sentence that somebody means to have read.

    Raises:
        NotUnderstoodError: If it has no words, or too many.
    """
    if not sentence.strip():
        raise NotUnderstoodError(
            "The sentence is empty; say what to move, for example "
            "'put the red pyramid on the blue cube'."
        )
    if len(sentence) > MOST_CHARACTERS:
        raise NotUnderstoodError(
            f"The sentence has {len(sentence)} characters; at most {MOST_CHARACTERS} "
            f"(and {MOST_WORDS} words) are read. Give one short command."
        )
    words = words_of(sentence)
    if not words.texts:
        raise NotUnderstoodError(
            f"There is no word in {shortened(sentence)}; say what to move, for example "
            "'put the red pyramid on the blue cube'."
        )
    if len(words) > MOST_WORDS:
        raise NotUnderstoodError(
            f"The sentence has {len(words)} words; at most {MOST_WORDS} are read. "
            "Give one short command."
        )
    return words


def shortened(sentence: str, longest: int = 60) -> str:
    """A sentence in quotation marks, safe to print in a one-line message."""
    cut = sentence if len(sentence) <= longest else sentence[: longest - 3] + "..."
    return ascii(cut) if not cut.isprintable() else repr(cut)
