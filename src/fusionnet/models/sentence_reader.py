"""What every translator offers, whatever its network: sentences to readings, features for a fusion.

A translator says how one reads many sentences at once (`read`); asking for one sentence,
for many, remembering answers and refusing what is no command are the same for all.
"""

import functools
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from fusionnet.errors import InputError, NotUnderstoodError
from fusionnet.models.lexicon import Lexicon
from fusionnet.models.reading import Reading, refuse_what_is_no_command
from fusionnet.rcl import Tree
from fusionnet.sentences import Vocabulary, Words, readable_words

SENTENCES_AT_ONCE = 32
"""How many sentences are read together, where there are many."""


class SentenceReader(ABC):
    """Sentences to trees with a trained network.

    Args:
        network: The trained network.
        known: Words that count as known when a sentence may have to be refused.
        lexicon: What these words say, if that was learnt.
    """

    def __init__(
        self, network: torch.nn.Module, known: Vocabulary, lexicon: Lexicon | None = None
    ) -> None:
        self.network: Any = network.eval()
        self.known = known
        self.lexicon = lexicon
        self._cached = functools.lru_cache(maxsize=256)(self._translate)

    @abstractmethod
    def save(self, folder: Path, *, metadata: dict[str, Any], half: bool = False) -> None:
        """Write the checkpoint that `from_folder` reads.

        Raises:
            OutputError: If the folder cannot be written.
        """

    @abstractmethod
    def read(
        self,
        sentences: Sequence[str],
        holding: Sequence[bool | None],
        *,
        beam: int = 10,
        count: int = 5,
    ) -> list[tuple[Reading, ...]]:
        """The readings of many sentences at once; none where none is a whole tree.

        Nothing is refused here: strange words are read as well as they can be.
        """

    @abstractmethod
    def features(self, sentence: str, *, holding: bool | None = None) -> Float[Tensor, "t f"]:
        """Vectors for a fusion, one a token.

        Raises:
            NotUnderstoodError: If the sentence is empty or too long.
        """

    @abstractmethod
    def teacher_forced(
        self,
        sentences: Sequence[str],
        holding: Sequence[bool | None],
        trees: Sequence[Tree],
        size: int = 64,
    ) -> tuple[float, float]:
        """Share of right symbols and mean cross-entropy [nats], each given the right ones before.

        Trees that the symbols cannot write are left out.
        """

    def readable(self, sentence: str) -> Words:
        """The words of a sentence that can be read.

        Raises:
            NotUnderstoodError: If it has none, or too many.
        """
        return readable_words(sentence)

    def translate(
        self, sentence: str, *, holding: bool | None = None, beam: int = 10, count: int = 5
    ) -> tuple[Reading, ...]:
        """The readings of a sentence, the most probable first.

        Args:
            sentence: What a person typed.
            holding: Whether the gripper holds a block; None when that is not known. By
                it "put" means to move a block or to drop the held one.
            beam: Width of the search, from 1 (greedy) to 100.
            count: Readings wanted, at most.

        Raises:
            InputError: If `beam` or `count` is out of range.
            NotUnderstoodError: If it is empty, too long, or no command in English;
                the message says which words are not known.
        """
        _check_search(beam, count)
        return self._cached(sentence, holding, beam, count)

    def translate_many(
        self,
        sentences: Sequence[str],
        *,
        holding: bool | None = None,
        beam: int = 10,
        count: int = 1,
    ) -> list[tuple[Reading, ...] | NotUnderstoodError]:
        """The readings of many sentences, or why one has none; together they take less time.

        Sentences of like length are read together, and what is said twice is read once.

        Raises:
            InputError: If `beam` or `count` is out of range.
        """
        _check_search(beam, count)
        found: dict[str, tuple[Reading, ...] | NotUnderstoodError] = {}
        readable: list[tuple[str, Words]] = []
        for sentence in dict.fromkeys(sentences):
            try:
                readable.append((sentence, self.readable(sentence)))
            except NotUnderstoodError as error:
                found[sentence] = error
        readable.sort(key=lambda pair: len(pair[1]))
        for start in range(0, len(readable), SENTENCES_AT_ONCE):
            part = readable[start : start + SENTENCES_AT_ONCE]
            states = [holding] * len(part)
            read = self.read([said for said, _ in part], states, beam=beam, count=count)
            for (sentence, words), readings in zip(part, read, strict=True):
                try:
                    self.refuse(sentence, words, readings)
                    found[sentence] = readings
                except NotUnderstoodError as error:
                    found[sentence] = error
        return [found[sentence] for sentence in sentences]

    def _translate(
        self, sentence: str, holding: bool | None, beam: int, count: int
    ) -> tuple[Reading, ...]:
        words = self.readable(sentence)
        [readings] = self.read([sentence], [holding], beam=beam, count=count)
        self.refuse(sentence, words, readings)
        return readings

    def refuse(self, sentence: str, words: Words, readings: Sequence[Reading]) -> None:
        """Raise if what was read of a sentence does not count.

        Raises:
            NotUnderstoodError: See `refuse_what_is_no_command`.
        """
        refuse_what_is_no_command(sentence, words, readings, self.known, self.lexicon)


def _check_search(beam: int, count: int) -> None:
    if not (1 <= beam <= 100 and 1 <= count):
        raise InputError(f"A beam is 1 to 100 wide, a count at least 1; got {beam}, {count}.")
