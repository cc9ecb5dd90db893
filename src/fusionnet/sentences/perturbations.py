"""The eight perturbations: small accidents of typing, each labelled with what was done.

A perturbed sentence remembers where each of its tokens came from, so a tree's word
positions stay true: `realigned` moves them to the new places. Every variant is made
from the clean sentence; perturbations never compound from one variant to the next.

References:
    Thesis, section 3.4.1 and figure 3.9.
"""

import dataclasses
import string
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from fusionnet.errors import InputError
from fusionnet.rcl import Leaf, Tree
from fusionnet.sentences.tokens import Token, tokenize


class Perturbation(StrEnum):
    """What can happen to a sentence."""

    REMOVE_LETTER = "remove letter"
    ADD_LETTER = "add letter"
    REPEAT_LETTER = "repeat letter"
    FLIP_LETTER = "flip letter"
    REMOVE_PUNCTUATION = "remove punctuation"
    FLIP_CASE = "flip case"
    RELOCATE_WORD = "relocate word"
    REMOVE_SPACE = "remove space"


MOST = 4
"""Perturbations that one sentence may suffer."""


@dataclass(frozen=True)
class Perturbed:
    """A sentence after some perturbations.

    Attributes:
        sentence: As it reads now.
        applied: What was done, in this order.
        origins: For each token now (in order), the 1-based positions of the tokens of
            the clean sentence that its characters came from.
    """

    sentence: str
    applied: tuple[Perturbation, ...]
    origins: tuple[tuple[int, ...], ...]

    def realigned(self, tree: Tree) -> Tree:
        """The tree of the clean sentence with its word positions in the perturbed one.

        A leaf keeps the words that survive; where a relocated word tears its words
        apart, it keeps the largest part that still stands together.
        """
        places: dict[int, list[int]] = {}
        for place, origin in enumerate(self.origins, 1):
            for position in origin:
                places.setdefault(position, []).append(place)
        return _mapped(tree, places)


def perturb(
    sentence: str,
    rng: np.random.Generator,
    *,
    kinds: Sequence[Perturbation] = tuple(Perturbation),
    count: int | None = None,
) -> Perturbed:
    """One perturbed variant of a clean sentence.

    Args:
        sentence: The clean sentence.
        rng: Source of all choices.
        kinds: What may be done.
        count: How many different ones; by default one to four. Fewer are done where
            the sentence offers no place for more (no punctuation, no second word).

    Raises:
        InputError: If `count` or `kinds` ask for what cannot be done.
    """
    if not kinds or (count is not None and not 1 <= count <= len(set(kinds))):
        raise InputError(
            f"A sentence gets 1 to {len(set(kinds))} perturbations of {len(set(kinds))} kinds; "
            f"asked for {count}."
        )
    wanted = int(rng.integers(1, min(MOST, len(kinds)) + 1)) if count is None else count
    text = _Text.of(sentence)
    applied: list[Perturbation] = []
    for number in rng.permutation(len(kinds)):
        if len(applied) == wanted:
            break
        if _DONE_BY[kinds[number]](text, rng):
            applied.append(kinds[number])
    return Perturbed(str(text), tuple(applied), text.origins())


def variants(sentence: str, rng: np.random.Generator, number: int = 3) -> tuple[Perturbed, ...]:
    """Some perturbed variants of a clean sentence, three as in the thesis."""
    return tuple(perturb(sentence, rng) for _ in range(number))


class _Text:
    """Characters that each remember the token that they came from (0: from none)."""

    def __init__(self, characters: list[tuple[str, int]]) -> None:
        self.characters = characters

    @classmethod
    def of(cls, sentence: str) -> "_Text":
        origin = [0] * len(sentence)
        for number, token in enumerate(tokenize(sentence), 1):
            origin[token.start : token.end] = [number] * (token.end - token.start)
        return cls(list(zip(sentence, origin, strict=True)))

    def __str__(self) -> str:
        return "".join(character for character, _ in self.characters)

    def tokens(self) -> tuple[Token, ...]:
        return tokenize(str(self))

    def origins(self) -> tuple[tuple[int, ...], ...]:
        return tuple(
            tuple(sorted({o for _, o in self.characters[t.start : t.end] if o}))
            for t in self.tokens()
        )

    def word(self, rng: np.random.Generator, least: int) -> Token | None:
        """A random word of letters and digits with at least `least` of them."""
        words = [t for t in self.tokens() if t.text.isalnum() and len(t.text) >= least]
        return words[rng.integers(len(words))] if words else None


def _remove_letter(text: _Text, rng: np.random.Generator) -> bool:
    word = text.word(rng, 3)
    if word is None:
        return False
    del text.characters[int(rng.integers(word.start, word.end))]
    return True


def _add_letter(text: _Text, rng: np.random.Generator) -> bool:
    word = text.word(rng, 2)
    if word is None:
        return False
    letter = string.ascii_lowercase[rng.integers(26)]
    origin = text.characters[word.start][1]
    text.characters.insert(int(rng.integers(word.start, word.end + 1)), (letter, origin))
    return True


def _repeat_letter(text: _Text, rng: np.random.Generator) -> bool:
    word = text.word(rng, 2)
    if word is None:
        return False
    at = int(rng.integers(word.start, word.end))
    text.characters.insert(at, text.characters[at])
    return True


def _flip_letter(text: _Text, rng: np.random.Generator) -> bool:
    word = text.word(rng, 2)
    if word is None:
        return False
    differ = [i for i in range(len(word.text) - 1) if word.text[i] != word.text[i + 1]]
    if not differ:
        return False
    at = word.start + differ[rng.integers(len(differ))]
    pair = text.characters[at : at + 2]
    text.characters[at : at + 2] = pair[::-1]
    return True


def _remove_punctuation(text: _Text, rng: np.random.Generator) -> bool:
    marks = [token for token in text.tokens() if not token.is_word]
    if not marks:
        return False
    mark = marks[rng.integers(len(marks))]
    del text.characters[mark.start : mark.end]
    return True


def _flip_case(text: _Text, rng: np.random.Generator) -> bool:
    """Flip a run of a word's letters: its first one, or all of it, or a part."""
    word = text.word(rng, 1)
    if word is None or word.text.swapcase() == word.text:
        return False
    first, last = sorted(int(i) for i in rng.integers(word.start, word.end, 2))
    if rng.random() < 0.5:
        first = last = word.start
    for at in range(first, last + 1):
        letter, origin = text.characters[at]
        if len(letter.swapcase()) == 1:
            text.characters[at] = (letter.swapcase(), origin)
    return True


def _relocate_word(text: _Text, rng: np.random.Generator) -> bool:
    """Move a word by one or two places; further, and the sentence says something else."""
    words = [t for t in text.tokens() if t.is_word]
    if len(words) < 2:
        return False
    moved = int(rng.integers(len(words)))
    near = [i for i in range(moved - 2, moved + 3) if i != moved and 0 <= i < len(words)]
    goal = near[rng.integers(len(near))]
    word = words[moved]
    piece = text.characters[word.start : word.end]
    behind = text.characters[word.end : word.end + 1]
    spaced = 1 if behind and behind[0][0].isspace() else 0
    at = words[goal].end if goal > moved else words[goal].start
    inserted = [(" ", 0), *piece] if goal > moved else [*piece, (" ", 0)]
    cut = slice(word.start, word.end + spaced)
    if goal > moved:
        text.characters[at:at] = inserted
        del text.characters[cut]
    else:
        del text.characters[cut]
        text.characters[at:at] = inserted
    return True


def _remove_space(text: _Text, rng: np.random.Generator) -> bool:
    tokens = text.tokens()
    pairs = [
        (a.end, b.start)
        for a, b in zip(tokens, tokens[1:], strict=False)
        if a.is_word and b.is_word and b.start > a.end
    ]
    if not pairs:
        return False
    start, end = pairs[rng.integers(len(pairs))]
    del text.characters[start:end]
    return True


_DONE_BY: dict[Perturbation, Callable[[_Text, np.random.Generator], bool]] = {
    Perturbation.REMOVE_LETTER: _remove_letter,
    Perturbation.ADD_LETTER: _add_letter,
    Perturbation.REPEAT_LETTER: _repeat_letter,
    Perturbation.FLIP_LETTER: _flip_letter,
    Perturbation.REMOVE_PUNCTUATION: _remove_punctuation,
    Perturbation.FLIP_CASE: _flip_case,
    Perturbation.RELOCATE_WORD: _relocate_word,
    Perturbation.REMOVE_SPACE: _remove_space,
}


def _mapped(node: Any, places: Mapping[int, Sequence[int]]) -> Any:
    """A node with every leaf's positions moved."""
    if isinstance(node, Leaf):
        now = sorted({place for token in node.tokens for place in places.get(token, ())})
        return dataclasses.replace(node, tokens=_longest_run(now))
    if isinstance(node, tuple):
        return tuple(_mapped(part, places) for part in node)
    if dataclasses.is_dataclass(node) and not isinstance(node, type):
        fields = {f.name: getattr(node, f.name) for f in dataclasses.fields(node)}
        return dataclasses.replace(node, **{k: _mapped(v, places) for k, v in fields.items()})
    return node


def _longest_run(places: Sequence[int]) -> tuple[int, ...]:
    """The longest part of ascending numbers that has no gap; the first of equals."""
    runs: list[list[int]] = []
    for place in places:
        if runs and runs[-1][-1] == place - 1:
            runs[-1].append(place)
        else:
            runs.append([place])
    longest: list[int] = max(runs, key=len, default=[])
    return tuple(longest)
