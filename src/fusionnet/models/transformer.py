"""The thesis's translator: a Transformer from English tokens to the tokens of a tree's text.

Sentences and trees are split as in section 3.4: at spaces and around every bracket, colon
and mark. Case and punctuation stay; the positions of words in the tree are tokens like
any other. Unlike the translator that we ship it is not told whether the gripper holds a
block.

References:
    Thesis, sections 3.4, 4.2 and 5.4.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import cross_entropy

from fusionnet.errors import CheckpointError, InputError, NotUnderstoodError, TreeError
from fusionnet.models.beam_search import Alphabet, Hypothesis, decode
from fusionnet.models.checkpoint import load_checkpoint, restore, save_checkpoint
from fusionnet.models.reading import Reading
from fusionnet.models.sentence_reader import SentenceReader
from fusionnet.models.target_text import END, START, Writes, target_tokens, written_tree
from fusionnet.models.transformer_config import transformer_config
from fusionnet.models.transformer_network import TransformerNetwork, number_rows
from fusionnet.rcl import Tree, format
from fusionnet.sentences import PADDING, UNKNOWN, Vocabulary, Words, readable_words, tokenize

KIND = "transformer"


class Transformer(SentenceReader):
    """Sentences to trees with a trained Transformer.

    Args:
        network: The trained network.
        source: Tokens of sentences that it was trained with.
        target: Tokens that it writes, `START` and `END` among them.
        known: Words, in lower case, that count as known where a sentence may be refused.
        writes: What it was trained to write.
    """

    def __init__(
        self,
        network: TransformerNetwork,
        source: Vocabulary,
        target: Vocabulary,
        known: Vocabulary,
        *,
        writes: Writes = "rcl",
    ) -> None:
        sizes = (network.config.source_words, network.config.target_words)
        if sizes != (len(source), len(target)) or START not in target or END not in target:
            raise CheckpointError(
                f"The Transformer reads {sizes[0]} tokens and writes {sizes[1]}; its vocabularies "
                f"have {len(source)} and {len(target)}, or lack the marks. It is damaged."
            )
        super().__init__(network, known)
        self.network: TransformerNetwork
        self.source = source
        self.target = target
        self.writes = writes
        self.alphabet = Alphabet(
            len(target), target.number(START), target.number(END), PADDING, (UNKNOWN,)
        )

    @classmethod
    def from_folder(cls, folder: Path | str) -> "Transformer":
        """Read a Transformer from its checkpoint.

        Raises:
            CheckpointError: If it is missing, damaged or of another version.
        """
        folder = Path(folder)
        checkpoint = load_checkpoint(folder, KIND)
        vocabularies = [
            _vocabulary(checkpoint.config, n, folder) for n in ("source", "target", "known")
        ]
        writes: Any = checkpoint.config.get("writes")
        if writes not in get_args(Writes):
            raise CheckpointError(f"The checkpoint {folder} writes {writes!r}: it is damaged.")
        network = TransformerNetwork(transformer_config(checkpoint.config.get("network")))
        restore(network, checkpoint.tensors, folder)
        return cls(network, *vocabularies, writes=writes)

    def save(self, folder: Path, *, metadata: dict[str, Any], half: bool = False) -> None:
        """Write the checkpoint that `from_folder` reads.

        Raises:
            OutputError: If the folder cannot be written.
        """
        config = {
            "network": asdict(self.network.config),
            "writes": self.writes,
            "source": list(self.source.words),
            "target": list(self.target.words),
            "known": list(self.known.words),
        }
        tensors = self.network.state_dict()
        save_checkpoint(
            folder, kind=KIND, config=config, tensors=tensors, metadata=metadata, half=half
        )

    def readable(self, sentence: str) -> Words:
        """The words of a sentence whose tokens the network has places for.

        Raises:
            NotUnderstoodError: If it has none, or too many.
        """
        words = readable_words(sentence)
        tokens, longest = len(tokenize(sentence)), self.network.config.longest
        if tokens > longest:
            raise NotUnderstoodError(
                f"The sentence has {tokens} words and marks; at most {longest} are read. "
                "Give one short command."
            )
        return words

    def read(
        self,
        sentences: Sequence[str],
        holding: Sequence[bool | None],
        *,
        beam: int = 10,
        count: int = 5,
    ) -> list[tuple[Reading, ...]]:
        """The readings of many sentences at once; none where none is a whole tree.

        Tokens past the longest source are not seen. `holding` changes nothing.

        Raises:
            InputError: If the network does not write the text of trees.
        """
        if self.writes != "rcl":
            raise InputError(
                f"This Transformer writes {self.writes!r}, not trees as text ('rcl'): it has no "
                "readings."
            )
        rows = [_texts(sentence)[: self.network.config.longest] for sentence in sentences]
        found = self.hypotheses(rows, beam=beam, count=min(beam, count + 2))
        return [
            tuple(r for h in some if (r := self._reading(h, row)) is not None)[:count]
            for row, some in zip(rows, found, strict=True)
        ]

    @torch.inference_mode()
    def hypotheses(
        self, rows: Sequence[Sequence[str]], *, beam: int = 1, count: int = 1
    ) -> list[list[Hypothesis]]:
        """The most probable runs of target tokens for rows of source tokens."""
        memory = self.network.encode(self._numbers(rows))
        longest = self.network.config.longest - 1
        return decode(self.network, memory, self.alphabet, beam=beam, count=count, longest=longest)

    def wanted(self, sentence: str, tree: Tree) -> tuple[str, ...]:
        """The target tokens that are right for a sentence and its tree."""
        return tuple(target_tokens(self.writes, sentence, format(tree)))

    def written(self, hypothesis: Hypothesis) -> tuple[str, ...]:
        """The target tokens of a hypothesis."""
        return tuple(self.target.words[number - 2] for number in hypothesis.numbers)

    @torch.inference_mode()
    def features(
        self, sentence: str, *, holding: bool | None = None
    ) -> Float[Tensor, "tokens nodes"]:
        """The fusion sublayer's nodes of each token written greedily (thesis 4.2.1).

        Raises:
            NotUnderstoodError: If the sentence is empty or too long.
        """
        self.readable(sentence)
        source = self._numbers([_texts(sentence)])
        memory = self.network.encode(source)
        longest = self.network.config.longest - 1
        [found] = decode(self.network, memory, self.alphabet, beam=1, count=1, longest=longest)
        numbers = found[0].numbers if found else ()
        given = torch.tensor([[self.alphabet.start, *numbers]])
        decoded = self.network.decode(memory, given)
        return self.network.nodes(decoded, given, given.shape[1])[0]

    @torch.inference_mode()
    def teacher_forced(
        self,
        sentences: Sequence[str],
        holding: Sequence[bool | None],
        trees: Sequence[Tree],
        size: int = 64,
    ) -> tuple[float, float]:
        """Share of right tokens and mean cross-entropy [nats], each given the right ones before.

        Trees of more tokens than can be written are left out.
        """
        longest = self.network.config.longest
        pairs = [
            (_texts(sentence)[:longest], self.wanted(sentence, tree))
            for sentence, tree in zip(sentences, trees, strict=True)
        ]
        pairs = [pair for pair in pairs if len(pair[1]) < longest]
        right, entropy, counted = 0, 0.0, 0
        for start in range(0, len(pairs), size):
            part = pairs[start : start + size]
            given, wanted = self.targets([written for _, written in part])
            logits = self.network(self._numbers([said for said, _ in part]), given)
            asked = wanted != PADDING
            right += int((logits.argmax(-1) == wanted)[asked].sum())
            entropy += float(cross_entropy(logits[asked], wanted[asked], reduction="sum"))
            counted += int(asked.sum())
        return right / max(counted, 1), entropy / max(counted, 1)

    @torch.inference_mode()
    def missed(self, source: Sequence[str], target: Sequence[str]) -> list[int]:
        """The numbers that should stand where wrong ones do, given the right ones before each."""
        given, wanted = self.targets([target])
        written = self.network(self._numbers([source]), given).argmax(-1)
        return [int(number) for number in wanted[written != wanted]]

    def targets(
        self, rows: Sequence[Sequence[str]]
    ) -> tuple[Int[Tensor, "b s"], Int[Tensor, "b s"]]:
        """What the decoder is given, from the start on, and what it shall write, to the end."""
        numbers = [[self.target.number(token) for token in row] for row in rows]
        given = number_rows([[self.alphabet.start, *row] for row in numbers])
        return given, number_rows([[*row, self.alphabet.end] for row in numbers])

    def _numbers(self, rows: Sequence[Sequence[str]]) -> Int[Tensor, "b t"]:
        """Rows of source tokens as numbers; a row without tokens is one unknown one."""
        return number_rows([[self.source.number(t) for t in row] or [UNKNOWN] for row in rows])

    def _reading(self, hypothesis: Hypothesis, row: Sequence[str]) -> Reading | None:
        """A hypothesis as a reading, if it writes a whole tree."""
        tokens = self.written(hypothesis)
        try:
            tree = written_tree("rcl", tokens)
        except TreeError:
            return None
        return Reading(
            tree=tree,
            probability=math.exp(hypothesis.log_probability),
            log_probability=hypothesis.log_probability,
            symbols=tokens,
            words=tuple(row),
            attention=hypothesis.attention.mean(1)[:, : len(row)],
        )


def _texts(text: str) -> list[str]:
    """The tokens of section 3.4, of a sentence or of a tree's text."""
    return [token.text for token in tokenize(text)]


def _vocabulary(config: dict[str, Any], name: str, folder: Path) -> Vocabulary:
    words = config.get(name)
    if not isinstance(words, list) or not all(isinstance(w, str) and w for w in words):
        raise CheckpointError(f"The checkpoint {folder} has no {name} vocabulary.")
    try:
        return Vocabulary(words)
    except ValueError as error:
        raise CheckpointError(f"The checkpoint {folder} is damaged: {error}.") from error
