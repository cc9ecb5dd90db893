"""Decoding: the most probable runs of symbols for sentences, greedily or with a beam.

The encoder's work is done once a sentence; each step then advances all beams of
all sentences together. Runs only become less probable as they grow, so the
search ends as soon as the wanted number of best runs is complete.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import log_softmax, softmax

from fusionnet.models.translator_network import Memory, SentenceBatch, TranslatorNetwork
from fusionnet.models.tree_symbols import END, LONGEST_RUN, NUMBERS, PADDING, START

_END, _PADDING, _START = NUMBERS[END], NUMBERS[PADDING], NUMBERS[START]


@dataclass(frozen=True)
class Hypothesis:
    """One run of symbols that the network proposes for a sentence.

    Attributes:
        numbers: Its symbols, without start and end.
        log_probability: Natural logarithm of its probability.
        attention: Attention of the two heads (first word, last word) over the words,
            the gripper's state first, for each symbol.
    """

    numbers: tuple[int, ...]
    log_probability: float
    attention: Float[np.ndarray, "s 2 t"]


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
    return decode(network, network.encode(batch), beam=beam, count=count, longest=longest)


@torch.inference_mode()
def decode(
    network: TranslatorNetwork, memory: Memory, *, beam: int, count: int, longest: int
) -> list[list[Hypothesis]]:
    """`beam_search` behind the encoder."""
    sentences, size = memory.mask.shape[0], network.config.symbols
    wide = memory.repeated(beam)
    state = network.start(wide)
    first = torch.arange(sentences).unsqueeze(1) * beam
    totals = torch.full((sentences, beam), -torch.inf)
    totals[:, 0] = 0
    current = torch.full((sentences * beam,), _START)
    finished = torch.zeros(sentences * beam, dtype=torch.bool)
    only_padding = torch.full((size,), -torch.inf)
    only_padding[_PADDING] = 0
    never = torch.zeros(size)
    never[[_PADDING, _START]] = -torch.inf
    steps: list[tuple[Tensor, Tensor, Tensor]] = []
    for _ in range(longest + 1):
        logits, scores, state = network.step(current, state, wide)
        gains = log_softmax(logits + never, -1)
        gains = torch.where(finished.unsqueeze(1), only_padding, gains)
        reached = (totals.unsqueeze(-1) + gains.unflatten(0, (sentences, beam))).flatten(1)
        totals, chosen = reached.topk(beam, dim=1)
        parents = (first + chosen // size).flatten()
        current = (chosen % size).flatten()
        steps.append((parents, current, scores))
        state = state.rows(parents)
        finished = finished[parents] | (current == _END)
        if bool(finished.view(sentences, beam)[:, :count].all()):
            break
    return _collect(steps, totals, finished.view(sentences, beam), count)


def _collect(
    steps: list[tuple[Int[Tensor, " n"], Int[Tensor, " n"], Float[Tensor, "n 2 t"]]],
    totals: Float[Tensor, "b k"],
    finished: Tensor,
    count: int,
) -> list[list[Hypothesis]]:
    """Follow every finished beam back to its beginning."""
    parents = [p.numpy() for p, _, _ in steps]
    symbols = [s.numpy() for _, s, _ in steps]
    attention = [softmax(a, -1).numpy() for _, _, a in steps]
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
                if number not in (_END, _PADDING):
                    numbers.append(number)
                    looked.append(attention[step][row])
            width = attention[0].shape[-1]
            stacked = np.stack(looked[::-1]) if looked else np.zeros((0, 2, width), np.float32)
            best.append(Hypothesis(tuple(numbers[::-1]), total, stacked))
        found.append(best)
    return found
