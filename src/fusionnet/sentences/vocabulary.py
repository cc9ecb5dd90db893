"""The words that a network knows: numbered, with a way to find the nearest to one it does not.

Beside its number a word has character n-grams, so that a misspelt word still
resembles the one that was meant.
"""

import difflib
import zlib
from collections import Counter
from collections.abc import Iterable
from functools import lru_cache

from fusionnet.sentences.tokens import Words, plain

PADDING = 0
UNKNOWN = 1
_FIRST = 2


class Vocabulary:
    """Words and their numbers; 0 is padding, 1 stands for every word that is not known.

    Args:
        words: The known words, in the order of their numbers.
    """

    def __init__(self, words: Iterable[str]) -> None:
        self.words = tuple(words)
        self._numbers = {word: i for i, word in enumerate(self.words, _FIRST)}
        if len(self._numbers) != len(self.words):
            raise ValueError("a vocabulary holds every word once")

    @classmethod
    def of(cls, sentences: Iterable[Iterable[str]], least: int = 1) -> "Vocabulary":
        """The words that occur at least `least` times, the most frequent first."""
        counts = Counter(word for words in sentences for word in words)
        kept = sorted((-n, word) for word, n in counts.items() if n >= least)
        return cls(word for _, word in kept)

    def __len__(self) -> int:
        """How many numbers there are, those of padding and unknown words included."""
        return len(self.words) + _FIRST

    def __contains__(self, word: str) -> bool:
        return word in self._numbers

    def number(self, word: str) -> int:
        """The number of a word; `UNKNOWN` when it is not known."""
        return self._numbers.get(word, UNKNOWN)

    def halves(self, word: str) -> tuple[str, str] | None:
        """Two known words that were written as one; none if it is known itself or nothing fits.

        Where several cuts fit, the most even one counts.
        """
        if word in self or len(word) > 2 * LONGEST_WORD:
            return None
        cuts = sorted(range(1, len(word)), key=lambda cut: abs(2 * cut - len(word)))
        for cut in cuts:
            pair = plain(word[:cut]), plain(word[cut:])
            if pair[0] in self and pair[1] in self:
                return pair
        return None

    def nearest(self, word: str, likeness: float = 0.6) -> str | None:
        """The known word most like this one, if any is like it enough."""
        if len(word) > 2 * LONGEST_WORD:
            return None
        spoken = [known for known in self.words if known[0] != "<"]  # not the gripper's states
        near = difflib.get_close_matches(word, spoken, n=5, cutoff=likeness)
        return min(near, key=lambda known: edits(word, known)) if near else None


def unjoined(words: Words, vocabulary: Vocabulary) -> Words:
    """The words with those written as one ("bluecube") taken apart; both keep its position."""
    texts: list[str] = []
    positions: list[int] = []
    for text, position in zip(words.texts, words.positions, strict=True):
        parts = vocabulary.halves(text) or (text,)
        texts += parts
        positions += [position] * len(parts)
    return Words(tuple(texts), tuple(positions))


def edits(word: str, other: str) -> int:
    """How many letters must be added, left out, replaced or exchanged with their neighbour.

    References:
        Damerau (1964); here as optimal string alignment.
    """
    before: list[int] = []
    above = list(range(len(other) + 1))
    for i, a in enumerate(word, 1):
        row = [i]
        for j, b in enumerate(other, 1):
            cost = min(above[j] + 1, row[j - 1] + 1, above[j - 1] + (a != b))
            if i > 1 and j > 1 and a == other[j - 2] and b == word[i - 2]:
                cost = min(cost, before[j - 2] + 1)
            row.append(cost)
        before, above = above, row
    return above[-1]


LONGEST_WORD = 24
"""Letters of a word that count for its n-grams."""


@lru_cache(maxsize=20_000)
def ngrams(word: str, buckets: int, sizes: tuple[int, ...] = (2, 3, 4)) -> tuple[int, ...]:
    """The character n-grams of a word as numbers below `buckets` (by CRC-32).

    The word's ends count as characters, so no word is without n-grams.

    References:
        Bojanowski et al. (2017), Enriching Word Vectors with Subword Information.
    """
    text = f"<{word[:LONGEST_WORD]}>"
    pieces = {text[i : i + n] for n in sizes for i in range(len(text) - n + 1)}
    return tuple(sorted(zlib.crc32(p.encode("utf-8", "surrogatepass")) % buckets for p in pieces))
