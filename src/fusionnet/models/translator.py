"""The translator: an English sentence to Robot Command Language trees, best first.

Every tree that comes back is whole and carries the words each of its leaves was
read from. A sentence that is no command gets an explanation instead of a tree.
"""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import cross_entropy, log_softmax

from fusionnet.errors import CheckpointError, TreeError
from fusionnet.models.beam_search import Hypothesis, beam_search
from fusionnet.models.checkpoint import load_checkpoint, restore, save_checkpoint
from fusionnet.models.lexicon import Lexicon
from fusionnet.models.reading import Reading
from fusionnet.models.sentence_reader import SentenceReader
from fusionnet.models.translator_network import (
    SentenceBatch,
    TranslatorNetwork,
    network_config,
    padded,
    state_word,
)
from fusionnet.models.tree_symbols import (
    END,
    NUMBERS,
    PADDING,
    START,
    SYMBOLS,
    Symbol,
    symbols_of,
    tree_of,
)
from fusionnet.rcl import Tree
from fusionnet.sentences import Vocabulary, Words, readable_words, unjoined, words_of

KIND = "translator"


class Translator(SentenceReader):
    """The translator that we ship: short runs of symbols, and the words of each.

    Args:
        network: The trained network.
        vocabulary: The words that it was trained with.
        lexicon: What these words say; without it fewer sentences are refused.
    """

    def __init__(
        self,
        network: TranslatorNetwork,
        vocabulary: Vocabulary,
        lexicon: Lexicon | None = None,
    ) -> None:
        sizes = (network.config.words, network.config.symbols)
        if sizes != (len(vocabulary), len(SYMBOLS)):
            raise CheckpointError(
                f"The translator's network has {sizes[0]} words and {sizes[1]} symbols, its "
                f"vocabulary {len(vocabulary)} and {len(SYMBOLS)}; it belongs to another release."
            )
        super().__init__(network, vocabulary, lexicon)
        self.network: TranslatorNetwork
        self.vocabulary = vocabulary

    @classmethod
    def from_folder(cls, folder: Path | str) -> "Translator":
        """Read a translator from its checkpoint.

        Raises:
            CheckpointError: If it is missing, damaged or of another version.
        """
        folder = Path(folder)
        checkpoint = load_checkpoint(folder, KIND)
        words = checkpoint.config.get("vocabulary")
        if not isinstance(words, list) or not all(isinstance(w, str) for w in words):
            raise CheckpointError(f"The checkpoint {folder} has no vocabulary.")
        if checkpoint.config.get("symbols") != list(SYMBOLS):
            raise CheckpointError(
                f"The checkpoint {folder} writes other tree symbols; it belongs to another release."
            )
        try:
            vocabulary = Vocabulary(words)
        except ValueError as error:
            raise CheckpointError(f"The checkpoint {folder} is damaged: {error}.") from error
        network = TranslatorNetwork(network_config(checkpoint.config.get("network")))
        restore(network, checkpoint.tensors, folder)
        learnt = checkpoint.config.get("lexicon")
        lexicon = None if learnt is None else Lexicon.from_json(learnt)
        return cls(network, vocabulary, lexicon)

    def save(self, folder: Path, *, metadata: dict[str, Any], half: bool = False) -> None:
        """Write the checkpoint that `from_folder` reads.

        Raises:
            OutputError: If the folder cannot be written.
        """
        config: dict[str, Any] = {
            "network": asdict(self.network.config),
            "vocabulary": list(self.vocabulary.words),
            "symbols": list(SYMBOLS),
        }
        if self.lexicon is not None:
            config["lexicon"] = self.lexicon.as_json()
        tensors = self.network.state_dict()
        save_checkpoint(
            folder, kind=KIND, config=config, tensors=tensors, metadata=metadata, half=half
        )

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
        said = [unjoined(words_of(sentence), self.vocabulary) for sentence in sentences]
        spare = min(beam, count + 2)  # should a run be no tree
        found = beam_search(self.network, self._batch(said, holding), beam=beam, count=spare)
        return [
            tuple(r for h in hypotheses if (r := _reading(h, words)) is not None)[:count]
            for words, hypotheses in zip(said, found, strict=True)
        ]

    @torch.inference_mode()
    def features(
        self, sentence: str, *, holding: bool | None = None
    ) -> Float[Tensor, "words features"]:
        """The encoder's vectors, one a word, for a fusion; the gripper's state comes first.

        Raises:
            NotUnderstoodError: If the sentence is empty or too long.
        """
        words = unjoined(readable_words(sentence), self.vocabulary)
        batch = self._batch([words], [holding])
        return self.network.encode(batch).features[0]

    def log_probabilities(
        self,
        sentences: Sequence[str],
        holding: Sequence[bool | None],
        runs: Sequence[Sequence[str]],
    ) -> Float[Tensor, " n"]:
        """How likely the network writes a run of symbols for each sentence; differentiable.

        Args:
            sentences: What was said.
            holding: Whether the gripper held a block; None when that is not known.
            runs: Names of symbols, as in `Reading.symbols`.

        Returns:
            Natural logarithms, the same as those of readings.
        """
        said = [unjoined(words_of(sentence), self.vocabulary) for sentence in sentences]
        numbers = [[NUMBERS[name] for name in run] for run in runs]
        given = padded([[NUMBERS[START], *run] for run in numbers], NUMBERS[PADDING])
        wanted = padded([[*run, NUMBERS[END]] for run in numbers], NUMBERS[PADDING])
        logits, _ = self.network(self._batch(said, holding), given)
        never = torch.tensor([NUMBERS[PADDING], NUMBERS[START]])
        shares = log_softmax(logits.float().index_fill(-1, never, -torch.inf), -1)
        chosen = shares.gather(-1, wanted[..., None])[..., 0]
        return torch.where(wanted == NUMBERS[PADDING], 0.0, chosen).sum(1)

    @torch.inference_mode()
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
        rows = []
        for sentence, held, tree in zip(sentences, holding, trees, strict=True):
            with contextlib.suppress(TreeError):
                rows.append((words_of(sentence), held, [NUMBERS[s.name] for s in symbols_of(tree)]))
        right, entropy, counted = 0, 0.0, 0
        for start in range(0, len(rows), size):
            part = rows[start : start + size]
            given = padded([[NUMBERS[START], *run] for _, _, run in part], NUMBERS[PADDING])
            wanted = padded([[*run, NUMBERS[END]] for _, _, run in part], NUMBERS[PADDING])
            batch = self._batch([words for words, _, _ in part], [held for _, held, _ in part])
            logits, _ = self.network(batch, given)
            asked = wanted != NUMBERS[PADDING]
            right += int((logits.argmax(-1) == wanted)[asked].sum())
            entropy += float(cross_entropy(logits[asked], wanted[asked], reduction="sum"))
            counted += int(asked.sum())
        return right / max(counted, 1), entropy / max(counted, 1)

    def _batch(self, sentences: Sequence[Words], holding: Sequence[bool | None]) -> SentenceBatch:
        rows = [(state_word(h), *w.texts) for w, h in zip(sentences, holding, strict=True)]
        return SentenceBatch.of(rows, self.vocabulary, self.network.config.buckets)


def _reading(hypothesis: Hypothesis, words: Words) -> Reading | None:
    """A hypothesis as a reading, if it writes a whole tree."""
    names = tuple(SYMBOLS[number] for number in hypothesis.numbers)
    symbols = [
        Symbol(name, span_tokens(weights, words) if ":" in name else ())
        for name, weights in zip(names, hypothesis.attention, strict=True)
    ]
    try:
        tree = tree_of(symbols)
    except TreeError:
        return None
    return Reading(
        tree=tree,
        probability=math.exp(hypothesis.log_probability),
        log_probability=hypothesis.log_probability,
        symbols=names,
        words=words.texts,
        attention=hypothesis.attention.mean(1)[:, 1 : 1 + len(words)],
    )


def span_tokens(attention: Float[np.ndarray, "2 t"], words: Words) -> tuple[int, ...]:
    """The token positions from the word the first head points at to the second head's.

    Place 0 is the gripper's state: a symbol that looks there was said by no word.
    """
    first = int(attention[0, : 1 + len(words)].argmax())
    if first == 0:
        return ()
    last = first + int(attention[1, first : 1 + len(words)].argmax())
    return tuple(range(words.positions[first - 1], words.positions[last - 1] + 1))
