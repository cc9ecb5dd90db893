"""The network behind the translator: words in, tree symbols and their words out.

A two-layer bidirectional LSTM reads the words; an LSTM writes the symbols. Two
attention heads point at the first and the last word of each symbol, and are
taught to by the corpus's alignments, so that the tree's word positions come for
free. Beside the deep path there is a *lexical* one: a small convolution over the
raw word vectors at the attended words speaks to the symbols directly, so that a
rare colour is read off its word whatever the sentence around it.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn.functional import pad, softmax
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from fusionnet.errors import CheckpointError
from fusionnet.models.tree_symbols import SYMBOLS
from fusionnet.sentences import PADDING, Vocabulary, ngrams

HOLDING, FREE, UNSURE = "<holding>", "<free>", "<unsure>"
STATES = (HOLDING, FREE, UNSURE)
"""The gripper's state, the first word of every sentence: "put" means move or drop by it."""


def state_word(holding: bool | None) -> str:
    """The first word that tells the network whether the gripper holds a block."""
    return UNSURE if holding is None else HOLDING if holding else FREE


@dataclass(frozen=True, kw_only=True)
class TranslatorNetworkConfig:
    """The sizes of the network.

    Attributes:
        words: Numbers in the vocabulary.
        symbols: Symbols in the tree language.
        buckets: Numbers of the character n-grams.
        word_size: Length of a word's vector.
        encoder_size: Units of the encoder, each direction.
        encoder_layers: Layers of the encoder.
        symbol_size: Length of a symbol's vector.
        decoder_size: Units of the decoder.
        attention_size: Length of queries and keys.
        dropout: Share of units dropped while training.
    """

    words: int
    symbols: int = len(SYMBOLS)
    buckets: int = 1024
    word_size: int = 128
    encoder_size: int = 128
    encoder_layers: int = 2
    symbol_size: int = 64
    decoder_size: int = 224
    attention_size: int = 96
    dropout: float = 0.3

    def __post_init__(self) -> None:
        """Refuse sizes that build no network."""
        sizes = {k: v for k, v in asdict(self).items() if k != "dropout"}
        if any(not isinstance(v, int) or not 1 <= v <= 100_000 for v in sizes.values()):
            raise CheckpointError(f"A translator's sizes are whole numbers from 1; got {sizes}.")
        if not 0 <= self.dropout < 1:
            raise CheckpointError(f"A dropout is at least 0 and below 1; got {self.dropout}.")


@dataclass  # not frozen: Fabric converts its tensors
class SentenceBatch:
    """Sentences as the network reads them; the gripper's state is their first word.

    Attributes:
        numbers: Number of each word.
        spellings: For each word, which of the batch's different spellings it has.
        ngram_numbers: The n-grams of all spellings, one after the other.
        ngram_offsets: Where each spelling's n-grams begin.
        lengths: Words of each sentence, the state included.
    """

    numbers: Int[Tensor, "b t"]
    spellings: Int[Tensor, "b t"]
    ngram_numbers: Int[Tensor, " g"]
    ngram_offsets: Int[Tensor, " u"]
    lengths: Int[Tensor, " b"]

    @classmethod
    def of(
        cls, sentences: Sequence[Sequence[str]], vocabulary: Vocabulary, buckets: int
    ) -> "SentenceBatch":
        """Number the words of sentences; each begins with one of `STATES`."""
        index: dict[str, int] = {"": 0}
        longest = max(len(words) for words in sentences)
        numbers = torch.full((len(sentences), longest), PADDING)
        spellings = torch.zeros((len(sentences), longest), dtype=torch.long)
        for row, words in enumerate(sentences):
            numbers[row, : len(words)] = torch.tensor([vocabulary.number(w) for w in words])
            spelt = [index.setdefault("" if w in STATES else w, len(index)) for w in words]
            spellings[row, : len(words)] = torch.tensor(spelt)
        pieces = [ngrams(word, buckets) for word in index]
        counts = torch.tensor([0, *(len(p) for p in pieces[:-1])])
        return cls(
            numbers,
            spellings,
            torch.tensor([n for piece in pieces for n in piece], dtype=torch.long),
            counts.cumsum(0),
            torch.tensor([len(words) for words in sentences]),
        )

    def to(self, device: torch.device) -> "SentenceBatch":
        """The same batch on another device."""
        return SentenceBatch(
            self.numbers.to(device),
            self.spellings.to(device),
            self.ngram_numbers.to(device),
            self.ngram_offsets.to(device),
            self.lengths,
        )


@dataclass(frozen=True)
class Memory:
    """What the encoder keeps of sentences, computed once and read at every step.

    Attributes:
        features: One vector a word; also what the fusion reads.
        lexical: The lexical path's vector of each word.
        keys: Keys of the two attention heads.
        mask: Which places hold words.
        state: The decoder's first hidden vector.
    """

    features: Float[Tensor, "b t f"]
    lexical: Float[Tensor, "b t w"]
    keys: Float[Tensor, "b 2 k t"]
    mask: Bool[Tensor, "b t"]
    state: Float[Tensor, "b d"]

    def repeated(self, times: int) -> "Memory":
        """Every sentence `times` times, for a beam of that width."""
        return Memory(
            *(t.repeat_interleave(times, 0) for t in (self.features, self.lexical)),
            *(t.repeat_interleave(times, 0) for t in (self.keys, self.mask, self.state)),
        )

    def rows(self, index: Int[Tensor, " n"]) -> "Memory":
        """The sentences with these numbers."""
        return Memory(
            self.features[index],
            self.lexical[index],
            self.keys[index],
            self.mask[index],
            self.state[index],
        )


@dataclass(frozen=True)
class DecoderState:
    """What the decoder carries from one symbol to the next."""

    hidden: Float[Tensor, "b d"]
    cell: Float[Tensor, "b d"]
    attended: Float[Tensor, "b d"]

    def rows(self, index: Int[Tensor, " n"]) -> "DecoderState":
        """The hypotheses with these numbers."""
        return DecoderState(self.hidden[index], self.cell[index], self.attended[index])


class TranslatorNetwork(nn.Module):
    """Encoder and decoder; see the module's docstring."""

    def __init__(self, config: TranslatorNetworkConfig) -> None:
        super().__init__()
        self.config = c = config
        features = 2 * c.encoder_size
        self.words = nn.Embedding(c.words, c.word_size, padding_idx=PADDING)
        self.ngrams = nn.EmbeddingBag(c.buckets, c.word_size, mode="mean")
        self.encoder = nn.LSTM(
            c.word_size,
            c.encoder_size,
            c.encoder_layers,
            batch_first=True,
            bidirectional=True,
            dropout=c.dropout if c.encoder_layers > 1 else 0.0,
        )
        self.lexical = nn.Conv1d(c.word_size, c.word_size, 3, padding=1)
        self.key = nn.Linear(features, 2 * c.attention_size, bias=False)
        self.first_state = nn.Linear(features, c.decoder_size)
        self.symbols = nn.Embedding(c.symbols, c.symbol_size)
        self.decoder = nn.LSTMCell(c.symbol_size + c.decoder_size, c.decoder_size)
        self.query = nn.Linear(c.decoder_size, 2 * c.attention_size)
        self.attend = nn.Linear(c.decoder_size + 2 * features, c.decoder_size)
        self.deep_output = nn.Linear(c.decoder_size, c.symbols)
        self.lexical_output = nn.Linear(2 * c.word_size, c.symbols, bias=False)
        self.dropout = nn.Dropout(c.dropout)
        for embedding in (self.words, self.ngrams, self.symbols):
            nn.init.normal_(embedding.weight, std=0.3)
        with torch.no_grad():
            self.words.weight[PADDING] = 0

    def encode(self, batch: SentenceBatch) -> Memory:
        """Read sentences."""
        spelt = self.ngrams(batch.ngram_numbers, batch.ngram_offsets)
        raw = self.words(batch.numbers) + spelt[batch.spellings]
        mask = batch.numbers != PADDING
        raw = self.dropout(raw * mask.unsqueeze(-1))
        packed = pack_padded_sequence(raw, batch.lengths, batch_first=True, enforce_sorted=False)
        packed, (hidden, _) = self.encoder(packed)
        features, _ = pad_packed_sequence(packed, batch_first=True)
        features = self.dropout(features)
        lexical = torch.relu(self.lexical(raw.transpose(1, 2))).transpose(1, 2)
        keys = self.key(features).unflatten(-1, (2, -1)).permute(0, 2, 3, 1)
        keys = keys / keys.shape[2] ** 0.5
        last = torch.cat((hidden[-2], hidden[-1]), -1)
        return Memory(features, lexical, keys, mask, torch.tanh(self.first_state(last)))

    def start(self, memory: Memory) -> DecoderState:
        """The decoder's state before the first symbol."""
        zero = torch.zeros_like(memory.state)
        return DecoderState(memory.state, zero, zero)

    def step(
        self, symbols: Int[Tensor, " b"], state: DecoderState, memory: Memory
    ) -> tuple[Float[Tensor, "b s"], Float[Tensor, "b 2 t"], DecoderState]:
        """Take one symbol more.

        Returns:
            Logits of the next symbol, logarithms of the two heads' attention (up to a
            constant; first and last word), and the state behind it.
        """
        scores, weights, state = self._advance(self.symbols(symbols), state, memory)
        return self._logits(state.attended, weights, memory), scores, state

    def forward(
        self, batch: SentenceBatch, symbols: Int[Tensor, "b s"]
    ) -> tuple[Float[Tensor, "b s n"], Float[Tensor, "b s 2 t"]]:
        """Logits and attention scores of every symbol, given those before it.

        Args:
            batch: The sentences.
            symbols: The trees, each from its `START` on; what is predicted at a place
                is the symbol that follows it.
        """
        memory = self.encode(batch)
        state = self.start(memory)
        scores, weights, attended = [], [], []
        for vectors in self.symbols(symbols).unbind(1):
            step_scores, step_weights, state = self._advance(vectors, state, memory)
            scores.append(step_scores)
            weights.append(step_weights)
            attended.append(state.attended)
        logits = self._logits(torch.stack(attended, 1), torch.stack(weights, 1), memory)
        return logits, torch.stack(scores, 1)

    def _advance(
        self, vectors: Float[Tensor, "b v"], state: DecoderState, memory: Memory
    ) -> tuple[Float[Tensor, "b 2 t"], Float[Tensor, "b 2 t"], DecoderState]:
        """Attention scores, attention and state behind one more symbol."""
        given = torch.cat((vectors, state.attended), -1)
        hidden, cell = self.decoder(given, (state.hidden, state.cell))
        query = self.query(self.dropout(hidden)).unflatten(-1, (2, -1)).unsqueeze(2)
        scores = (query @ memory.keys).squeeze(2)
        scores = scores.masked_fill(~memory.mask.unsqueeze(1), -1e9)
        weights = softmax(scores, -1)
        context = (weights @ memory.features).flatten(1)
        attended = torch.tanh(self.attend(torch.cat((hidden, context), -1)))
        return scores, weights, DecoderState(hidden, cell, attended)

    def _logits(
        self,
        attended: Float[Tensor, "b *s d"],
        weights: Float[Tensor, "b *s 2 t"],
        memory: Memory,
    ) -> Float[Tensor, "b *s n"]:
        """What the deep path and the lexical one say together."""
        flat = weights.flatten(1, -2)
        lexical = (flat @ memory.lexical).unflatten(1, weights.shape[1:-1]).flatten(-2)
        return self.deep_output(self.dropout(attended)) + self.lexical_output(lexical)


def network_config(document: Any) -> TranslatorNetworkConfig:
    """The configuration that a checkpoint's JSON holds.

    Raises:
        CheckpointError: If it holds something else.
    """
    try:
        return TranslatorNetworkConfig(**document)
    except TypeError as error:
        raise CheckpointError(f"The translator's configuration does not fit: {error}.") from error


def padded(rows: Sequence[Sequence[int]], value: int) -> Int[Tensor, "b s"]:
    """Rows of numbers side by side, the shorter ones filled up."""
    longest = max(len(row) for row in rows)
    return torch.stack(
        [
            pad(torch.tensor(row, dtype=torch.long), (0, longest - len(row)), value=value)
            for row in rows
        ]
    )
