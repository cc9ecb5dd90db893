"""Word vectors by gensim: skip-gram and continuous bag of words, as the thesis trained them.

Tables 5.2 and 5.3 print a negative-sampling exponent of 5 and a minimum frequency of
0.75. The two columns are swapped, we decide: a frequency is a whole number and one of
0.75 would exclude no word, while an exponent of 5 would draw nearly every negative
sample from the one or two commonest words; and 0.75 and 5 are what word2vec itself
has for exponent and frequency. So the exponent is 0.75, the minimum frequency 5, and
the window 9, which the text confirms (1 + 4 x 2).

References:
    Thesis, sections 2.1.9 and 5.1. Mikolov et al. (2013), Efficient Estimation of Word
    Representations in Vector Space.
"""

import json
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from fusionnet.corpora import Command
from fusionnet.errors import DataError, InputError, UnknownNameError
from fusionnet.files import write_whole
from fusionnet.randomness import derived_seed, generator
from fusionnet.rcl import format
from fusionnet.sentences.perturbations import variants
from fusionnet.sentences.tokens import tokenize
from fusionnet.sentences.vocabulary import PADDING, Vocabulary

LARGEST_FILE = 256 * 2**20
"""Bytes that a file of word vectors may have."""


@dataclass(frozen=True, kw_only=True)
class WordVectorConfig:
    """How to train word vectors; the defaults are the thesis's (tables 5.2 and 5.3).

    Attributes:
        model: "skip-gram" predicts the words around a word, "cbow" the word between them.
        size: Length of a vector; the thesis tried 10, 50, 100, 200 and 500.
        epochs: Passes over the sentences.
        negatives: Words drawn beside each right one.
        negative_exponent: To which power a word's frequency counts in that draw.
        window: Words before and behind that count as near.
        least: Words that occur less often get no vector.
        learning_rate: At the beginning.
        least_learning_rate: At the end; it falls linearly.
        mean: Whether "cbow" takes the mean of the words around, not the sum.
        seed: Source of all randomness.
    """

    model: Literal["skip-gram", "cbow"] = "skip-gram"
    size: int = 50
    epochs: int = 200
    negatives: int = 5
    negative_exponent: float = 0.75
    window: int = 9
    least: int = 5
    learning_rate: float = 0.025
    least_learning_rate: float = 0.001
    mean: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        counts = (self.size, self.epochs, self.negatives, self.window, self.least)
        if min(counts) < 1 or self.learning_rate < self.least_learning_rate or self.size > 10_000:
            raise InputError(
                "Size (to 10000), epochs, negatives, window and least are at least 1, and the "
                f"learning rate does not rise; got {self}."
            )


def skip_gram() -> WordVectorConfig:
    """Table 5.3 of the thesis, with vectors of its best size, 50."""
    return WordVectorConfig()


def cbow() -> WordVectorConfig:
    """Table 5.2 of the thesis, with vectors of its best size, 50."""
    return WordVectorConfig(model="cbow")


@dataclass(frozen=True)
class WordVectors:
    """Words and their vectors.

    Attributes:
        words: The words, the most frequent first.
        vectors: One row a word.
        config: How they were trained.
    """

    words: tuple[str, ...]
    vectors: Float[np.ndarray, "words size"]
    config: WordVectorConfig

    def nearest(self, word: str, count: int = 5) -> list[tuple[str, float]]:
        """The words whose vectors point the same way, with the cosine.

        Raises:
            UnknownNameError: If the word has no vector.
        """
        if word not in self.words:
            raise UnknownNameError(f"No vector for the word {word!r}; {len(self.words)} have one.")
        unit = self.vectors / np.linalg.norm(self.vectors, axis=1, keepdims=True).clip(1e-12)
        own = self.words.index(word)
        cosines = unit @ unit[own]
        order = [int(i) for i in np.argsort(-cosines) if i != own][:count]
        return [(self.words[i], float(cosines[i])) for i in order]

    def matrix(self, vocabulary: Vocabulary) -> Float[np.ndarray, "vocabulary size"]:
        """A network's first embedding: one row for each number of a vocabulary.

        Words without a vector, and the number of all unknown words, get random rows of
        He's scale (the thesis's default embedding); padding is 0.
        """
        size = self.vectors.shape[1]
        rng = generator(self.config.seed, "word vectors", "words without one")
        rows = rng.normal(scale=np.sqrt(2 / size), size=(len(vocabulary), size))
        rows[PADDING] = 0
        for word, vector in zip(self.words, self.vectors, strict=True):
            if word in vocabulary:
                rows[vocabulary.number(word)] = vector
        return rows.astype(np.float32)

    def save(self, file: Path) -> None:
        """Write one safetensors file, whole or not at all; the words lie in its metadata.

        Raises:
            OutputError: If it cannot be written.
        """
        said = {"words": json.dumps(self.words), "config": json.dumps(asdict(self.config))}
        write_whole(file, save({"vectors": np.ascontiguousarray(self.vectors)}, metadata=said))

    @classmethod
    def load(cls, file: Path) -> "WordVectors":
        """Read what `save` wrote; nothing in the file is executed.

        Raises:
            DataError: If it is missing, damaged or no file of word vectors.
        """
        try:
            if file.stat().st_size > LARGEST_FILE:
                raise DataError(f"{file} has more than {LARGEST_FILE} bytes.")
            with safe_open(file, framework="np") as opened:
                said: dict[str, str] = opened.metadata() or {}
                vectors = opened.get_tensor("vectors")
            words = tuple(map(str, json.loads(said["words"])))
            config = WordVectorConfig(**json.loads(said["config"]))
        except OSError as error:
            raise DataError(f"{file} cannot be read: {error.strerror or error}.") from None
        except DataError:
            raise
        except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise DataError(f"{file} holds no word vectors: {error}.") from None
        if vectors.shape != (len(words), config.size) or vectors.dtype != np.float32:
            raise DataError(f"{file} is damaged: {len(words)} words, vectors {vectors.shape}.")
        return cls(words, vectors, config)


def train_word_vectors(
    sentences: Sequence[Sequence[str]],
    config: WordVectorConfig | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> WordVectors:
    """Vectors of the words that occur often enough in some sentences.

    One thread trains, so that a seed gives the same vectors again.

    Args:
        sentences: Each a sequence of words.
        config: How; by default `skip_gram()`.
        progress: Called after every epoch with epochs done and all epochs.

    Raises:
        InputError: If no word occurs often enough.
    """
    from gensim.models import Word2Vec
    from gensim.models.callbacks import CallbackAny2Vec

    how = config or skip_gram()
    logging.getLogger("gensim").setLevel(logging.ERROR)

    class Epochs(CallbackAny2Vec):
        """Tells how many epochs are done."""

        done = 0

        def on_epoch_end(self, model: Any) -> None:
            self.done += 1
            if progress is not None:
                progress(self.done, how.epochs)

    model = Word2Vec(
        sg=int(how.model == "skip-gram"),
        vector_size=how.size,
        epochs=how.epochs,
        negative=how.negatives,
        ns_exponent=how.negative_exponent,
        window=how.window,
        min_count=how.least,
        alpha=how.learning_rate,
        min_alpha=how.least_learning_rate,
        cbow_mean=int(how.mean),
        seed=derived_seed(how.seed, "word vectors", how.model) % 2**31,
        workers=1,
    )
    said = [list(words) for words in sentences]
    model.build_vocab(said)
    if not model.wv.index_to_key:
        raise InputError(
            f"No word occurs {how.least} times in the {len(said)} sentences; "
            "give more of them, or lower the least frequency."
        )
    model.train(
        said,
        total_examples=model.corpus_count,
        epochs=how.epochs,
        callbacks=[Epochs()],
    )
    vectors = np.array(model.wv.vectors, dtype=np.float32)
    return WordVectors(tuple(model.wv.index_to_key), vectors, how)


def noised_sentences(
    commands: Iterable[Command], seed: int = 0, number: int = 3
) -> list[tuple[str, ...]]:
    """The tokens of every sentence and of its perturbed variants, three as in the thesis.

    References:
        Thesis, sections 3.4.1 and 5.1: "the original sentence and its three noised versions".
    """
    found = []
    for command in commands:
        rng = generator(seed, "word vectors", "noise", command.id)
        texts = [command.sentence, *(v.sentence for v in variants(command.sentence, rng, number))]
        found += [tuple(token.text for token in tokenize(text)) for text in texts]
    return found


def tree_sentences(commands: Iterable[Command]) -> list[tuple[str, ...]]:
    """The tokens of every tree's text: brackets, names, values and word positions (3.4)."""
    return [tuple(t.text for t in tokenize(format(command.tree))) for command in commands]
