"""Decoding: the most probable runs of symbols for sentences, greedily or with a beam.

The encoder's work is done once a sentence; each step then advances all beams of
all sentences together. Runs only become less probable as they grow, so the
search ends as soon as the wanted number of best runs is complete.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import softmax

from fusionnet.models.translator_network import SentenceBatch, TranslatorNetwork
from fusionnet.models.tree_symbols import END, LONGEST_RUN, NUMBERS, PADDING, START, SYMBOLS


@dataclass(frozen=True)
class Alphabet:
    """The numbers that a network writes, and which of them are marks.

    Attributes:
        size: How many numbers there are.
        start: What every run begins with.
        end: What every run ends with.
        padding: What stands behind the end.
        never: Further numbers that are never written.
    """

    size: int
    start: int
    end: int
    padding: int
    never: tuple[int, ...] = ()


TREE_SYMBOLS = Alphabet(len(SYMBOLS), NUMBERS[START], NUMBERS[END], NUMBERS[PADDING])
"""Those of `tree_symbols`."""


@runtime_checkable
class DecoderMemory(Protocol):
    """What a network keeps of sentences while it writes."""

    @property
    def mask(self) -> Tensor:
        """Which places hold words, a row a sentence."""

    def repeated(self, times: int) -> Any:
        """Every sentence `times` times."""


@runtime_checkable
class StepwiseDecoder(Protocol):
    """A network that writes one symbol after the other."""

    def start(self, memory: Any) -> Any:
        """The state before the first symbol; its `rows(index)` chooses hypotheses."""

    def step(self, symbols: Tensor, state: Any, memory: Any) -> tuple[Tensor, Tensor, Any]:
        """Logits of the next symbol, logarithms of the heads' attention, the next state."""


@dataclass(frozen=True)
class Hypothesis:
    """One run of symbols that the network proposes for a sentence.

    Attributes:
        numbers: Its symbols, without start and end.
        log_probability: Natural logarithm of its probability.
        attention: Attention of the heads over the words, for each symbol; of our own
            translator two (first word, last word), with the gripper's state before the words.
    """

    numbers: tuple[int, ...]
    log_probability: float
    attention: Float[np.ndarray, "s h t"]


@torch.inference_mode()
def beam_search(
    network: TranslatorNetwork,
    batch: SentenceBatch,
    *,
    beam: int = 10,
    count: int = 5,
    longest: int = LONGEST_RUN,
) -> list[list[Hypothesis]]:
    """The best runs of every sentence, the most probable first.

    Args:
        network: In evaluation mode.
        batch: The sentences.
        beam: How many runs are followed at once; 1 decodes greedily.
        count: How many are wanted, at most `beam`; fewer come back where fewer ended.
        longest: Symbols after which a run is given up.
    """
    memory = network.encode(batch)
    return decode(network, memory, TREE_SYMBOLS, beam=beam, count=count, longest=longest)


@torch.inference_mode()
def decode(
    network: StepwiseDecoder,
    memory: DecoderMemory,
    alphabet: Alphabet,
    *,
    beam: int,
    count: int,
    longest: int,
) -> list[list[Hypothesis]]:
    """`beam_search` behind the encoder, for any network that writes step by step."""
    sentences, size = memory.mask.shape[0], alphabet.size
    wide = memory.repeated(beam)
    state = network.start(wide)
    first = torch.arange(sentences).unsqueeze(1) * beam
    themselves, totals = first.flatten(), torch.full((sentences, beam), -torch.inf)
    totals[:, 0] = 0
    current = torch.full((sentences * beam,), alphabet.start)
    finished = torch.zeros(sentences * beam, dtype=torch.bool)
    only_padding = torch.full((size,), -torch.inf)
    only_padding[alphabet.padding] = 0
    never = torch.zeros(size)
    never[[alphabet.padding, alphabet.start, *alphabet.never]] = -torch.inf
    steps: list[tuple[Tensor, Tensor, Tensor]] = []
    some_finished = False
    for _ in range(longest + 1):
        logits, scores, state = network.step(current, state, wide)
        gains = torch.log_softmax(logits + never, -1)
        if some_finished:
            gains = torch.where(finished.unsqueeze(1), only_padding, gains)
        if beam == 1:  # every hypothesis goes on from itself
            gained, current = gains.max(-1)
            totals, parents = totals + gained.unsqueeze(1), themselves
        else:
            reached = (totals.unsqueeze(-1) + gains.unflatten(0, (sentences, beam))).flatten(1)
            totals, chosen = reached.topk(beam, dim=1)
            parents = (first + chosen // size).flatten()
            current = (chosen % size).flatten()
            state = state.rows(parents)
            finished = finished[parents]
        steps.append((parents, current, scores))
        if alphabet.end in current.tolist():
            some_finished, finished = True, finished | (current == alphabet.end)
        if some_finished and bool(finished.view(sentences, beam)[:, :count].all()):
            break
    marks = (alphabet.end, alphabet.padding)
    return _collect(steps, totals, finished.view(sentences, beam), count, marks)


def _collect(
    steps: list[tuple[Int[Tensor, " n"], Int[Tensor, " n"], Float[Tensor, "n h t"]]],
    totals: Float[Tensor, "b k"],
    finished: Tensor,
    count: int,
    marks: tuple[int, int],
) -> list[list[Hypothesis]]:
    """Follow every finished beam back to its beginning."""
    parents = [p.numpy() for p, _, _ in steps]
    symbols = [s.numpy() for _, s, _ in steps]
    attention = softmax(torch.stack([a for _, _, a in steps]), -1).numpy()
    sentences, beam = totals.shape
    found: list[list[Hypothesis]] = []
    for sentence in range(sentences):
        best: list[Hypothesis] = []
        for place in range(beam):
            total = float(totals[sentence, place])
            if len(best) == count or not finished[sentence, place] or total == -np.inf:
                continue
            row, numbers, looked = sentence * beam + place, [], []
            for step in reversed(range(len(steps))):
                number, row = int(symbols[step][row]), int(parents[step][row])
                if number not in marks:
                    numbers.append(number)
                    looked.append(attention[step][row])
            nothing = np.zeros((0, *attention[0].shape[1:]), np.float32)
            stacked = np.stack(looked[::-1]) if looked else nothing
            best.append(Hypothesis(tuple(numbers[::-1]), total, stacked))
        found.append(best)
    return found
