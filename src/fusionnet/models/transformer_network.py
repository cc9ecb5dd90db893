"""The thesis's Transformer: tokens in, tokens out, and the nodes that the fusion takes.

Encoder and decoder are those of Vaswani et al.: attention and a feed-forward layer, each
with a residual connection, dropout before the addition, and normalisation behind it. The
size of a head's queries, keys and values is a number of its own (d_a), so that it need
not divide the size of the embedding. Beside the output layer stands the *fusion
sublayer*: the same layer with a few nodes in place of the vocabulary.

References:
    Thesis, sections 2.1.11 and 4.2.1, tables 5.1 and 7.1. Vaswani et al. (2017),
    Attention Is All You Need.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from fusionnet.models.transformer_config import TransformerConfig
from fusionnet.models.transformer_decoding import (
    PreparedDecoder,
    TargetCache,
    next_token,
    prepared,
    transposed,
)
from fusionnet.models.transformer_layers import Layer, Pair, Stack
from fusionnet.sentences.vocabulary import PADDING

_NOWHERE = -1e9


@dataclass(frozen=True)
class SourceMemory:
    """What is kept of sentences: computed once, read at every step.

    Attributes:
        features: The encoder's vectors.
        pairs: For each layer of the decoder, keys and values of its look at the source.
        mask: Which places hold tokens.
        full: Whether all do, so that nothing need be masked.
    """

    features: Float[Tensor, "b t e"]
    pairs: tuple[Pair, ...]
    mask: Bool[Tensor, "b t"]
    full: bool

    def repeated(self, times: int) -> "SourceMemory":
        """Every sentence `times` times, for a beam of that width."""
        if times == 1:
            return self
        return SourceMemory(
            self.features.repeat_interleave(times, 0),
            tuple(
                (k.repeat_interleave(times, 0), v.repeat_interleave(times, 0))
                for k, v in self.pairs
            ),
            self.mask.repeat_interleave(times, 0),
            self.full,
        )

    @property
    def attention_mask(self) -> Bool[Tensor, "b 1 1 t"] | None:
        """The mask as attention takes it; None where nothing is masked."""
        return None if self.full else self.mask[:, None, None]


class TransformerNetwork(nn.Module):
    """Encoder and decoder; see the module's docstring."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        self.config = c = config
        self.source_words = nn.Embedding(c.source_words, c.embedding_size, padding_idx=PADDING)
        self.target_words = nn.Embedding(c.target_words, c.embedding_size, padding_idx=PADDING)
        self.encoder = Stack(Layer(c, crossed=False) for _ in range(c.layers))
        self.decoder = Stack(Layer(c, crossed=True) for _ in range(c.layers))
        self.output = nn.Linear(c.embedding_size, c.target_words)
        self.fusion = nn.Linear(c.embedding_size, c.fusion_nodes)
        self.dropout = nn.Dropout(c.dropout)
        self.places: Tensor
        self.register_buffer("places", positions(c.longest, c.embedding_size), persistent=False)
        self._begin()

    def _begin(self) -> None:
        """Glorot's uniform weights (4.2.2); embeddings of He's scale (figure 5.1)."""
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.xavier_uniform_(module.weight)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
            elif isinstance(module, nn.Embedding):
                nn.init.normal_(module.weight, std=(2 / self.config.embedding_size) ** 0.5)
                with torch.no_grad():
                    module.weight[PADDING] = 0

    def encode(self, source: Int[Tensor, "b t"]) -> SourceMemory:
        """Read sentences, filled up with padding."""
        mask = source != PADDING
        full = bool(mask.all())
        shown = None if full else mask[:, None, None]
        x = self.dropout(self.source_words(source) + self.places[: source.shape[1]])
        for layer in self.encoder:
            x = layer.added(x, layer.own(x, layer.own.pair(x), shown), layer.own_norm)
            x = layer.fed_forward(x)
        return SourceMemory(x, tuple(layer.source.pair(x) for layer in self.decoder), mask, full)

    def decode(self, memory: SourceMemory, given: Int[Tensor, "b s"]) -> Float[Tensor, "b s e"]:
        """The final decoder's output at every place, given the tokens up to there."""
        mask = memory.attention_mask
        x = self.dropout(self.target_words(given) + self.places[: given.shape[1]])
        for layer, pair in zip(self.decoder, memory.pairs, strict=True):
            x = layer.added(x, layer.own(x, layer.own.pair(x), causal=True), layer.own_norm)
            x = layer.added(x, layer.source(x, pair, mask), layer.source_norm)
            x = layer.fed_forward(x)
        return x

    def forward(
        self, source: Int[Tensor, "b t"], given: Int[Tensor, "b s"]
    ) -> Float[Tensor, "b s w"]:
        """Logits of the token behind every place, given those up to there."""
        logits: Tensor = self.output(self.decode(self.encode(source), given))
        return logits

    def nodes(
        self, decoded: Float[Tensor, "b s e"], given: Int[Tensor, "b s"], length: int | None = None
    ) -> Float[Tensor, "b l d"]:
        """The fusion sublayer's nodes of every token, 0 at padding.

        Args:
            decoded: What `decode` returns.
            given: The tokens that it was given.
            length: Places to fill the result up to; by default `longest`, so that
                FusionNet always gets as many.
        """
        length = self.config.longest if length is None else length
        found = self.fusion(decoded) * (given != PADDING).unsqueeze(-1)
        return nn.functional.pad(found, (0, 0, 0, length - given.shape[1]))

    def start(self, memory: SourceMemory) -> TargetCache:
        """The cache before the first token."""
        rows, heads, _, size = memory.pairs[0][0].shape
        empty = memory.features.new_empty((len(self.decoder), rows, heads, 0, 2, size))
        shown = torch.where(memory.mask, 0.0, _NOWHERE).repeat(1, heads)
        ahead, *behind = [layer.own.output.bias.detach() for layer in self.decoder]
        behind.append(torch.zeros_like(ahead))
        layers = zip(self.decoder, memory.pairs, behind, strict=True)
        ready = tuple(prepared(layer, pair, shown, bias) for layer, pair, bias in layers)
        output = transposed(self.output.weight, self.output.bias)
        decoder = PreparedDecoder(self.target_words.weight, self.places + ahead, ready, output)
        return TargetCache(empty, decoder)

    def step(
        self, tokens: Int[Tensor, " b"], cache: TargetCache, memory: SourceMemory
    ) -> tuple[Float[Tensor, "b w"], Float[Tensor, "b h t"], TargetCache]:
        """Take one token more; what came before is read from the cache.

        Returns:
            Logits of the next token, scores of the last layer's heads at the source
            (logarithms of their attention, up to a constant), and the longer cache.
        """
        return next_token(tokens, cache)

    def write(self, memory: SourceMemory, start: int, end: int) -> Int[Tensor, "b s"]:
        """Targets written greedily.

        Args:
            memory: What is known of the sources.
            start: Number of the first mark, with which every row begins.
            end: Number of the last mark, which ends a row and is not in it.

        Returns:
            Rows of at most `longest` tokens, filled up with `PADDING`.
        """
        token = memory.features.new_full((len(memory.features),), start, dtype=torch.long)
        cache = self.start(memory)
        written, done = [token], torch.zeros_like(token, dtype=torch.bool)
        for _ in range(self.config.longest - 1):
            logits, _, cache = self.step(token, cache, memory)
            token = logits.argmax(dim=-1)
            done = done | (token == end)
            if bool(done.all()):
                break
            written.append(torch.where(done, PADDING, token))
        return torch.stack(written, dim=1)


def positions(longest: int, size: int) -> Float[Tensor, "t e"]:
    """Sines and cosines of each place, of ever longer waves.

    References:
        Thesis, equation 2.28.
    """
    place = torch.arange(longest, dtype=torch.float64).unsqueeze(1)
    wave = 10_000.0 ** (-torch.arange(0, size, 2, dtype=torch.float64) / size)
    found = torch.zeros((longest, size), dtype=torch.float64)
    found[:, 0::2] = torch.sin(place * wave)
    found[:, 1::2] = torch.cos(place * wave[: size // 2])
    return found.float()


def number_rows(rows: Sequence[Sequence[int]]) -> Int[Tensor, "b t"]:
    """Rows of token numbers side by side, the shorter ones filled up with padding."""
    longest = max(len(row) for row in rows)
    found = torch.full((len(rows), longest), PADDING)
    for place, row in enumerate(rows):
        found[place, : len(row)] = torch.tensor(row, dtype=torch.long)
    return found
