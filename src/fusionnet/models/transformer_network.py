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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn.functional import (
    layer_norm,
    relu,
    scaled_dot_product_attention,
)

from fusionnet.models.transformer_config import TransformerConfig
from fusionnet.sentences.vocabulary import PADDING

NORMALISATION_EPSILON = 1e-6
"""Added to the deviation in every normalisation (4.2.2)."""

_NOWHERE = -1e9

_ROOM = 16
"""Tokens for which a cache has room at first."""


Parameters = tuple[Tensor, Tensor]
"""Weight and bias of a linear layer or a normalisation."""

Pair = tuple[Float[Tensor, "b h t d"], Float[Tensor, "b h t d"]]
"""Keys and values of an attention."""


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


class PreparedLayer(NamedTuple):
    """What a layer of the decoder multiplies by at every step, made ready once.

    What the source says does not change while a target is written. Queries times keys, and
    values times the last layer, are therefore each one matrix a sentence. Matrices are
    transposed. A bias of what is added to the vector is added already where the vector is
    normalised, and taken off again from what else is made of that vector.

    Attributes:
        own: Makes for every head the query, the key and the value of a token.
        own_output: From what the heads find to what it adds to the vector.
        own_norm: Of that sum.
        asked: For each sentence, from a vector to the scores of all heads at the source.
        shown: Added to these scores: 0, or `_NOWHERE` where the source has no token.
        told: For each sentence, from the attention of all heads to what it adds to the vector.
        source_norm: Of that sum.
        wide: The feed-forward sublayer's first half.
        narrow: From it to what is added to the vector.
        wide_norm: Of that sum.
    """

    own: Parameters
    own_output: Float[Tensor, "hd e"]
    own_norm: Parameters
    asked: Float[Tensor, "b e ht"] | Float[Tensor, "e ht"]
    shown: Float[Tensor, "b ht"]
    told: Float[Tensor, "b ht e"] | Float[Tensor, "ht e"]
    source_norm: Parameters
    wide: Parameters
    narrow: Float[Tensor, "w e"]
    wide_norm: Parameters


class PreparedDecoder(NamedTuple):
    """What the decoder works with at every step, made ready once for some sentences.

    Attributes:
        words: The tokens' vectors.
        places: What is added at each place.
        layers: The layers.
        output: Makes logits.
    """

    words: Float[Tensor, "w e"]
    places: Float[Tensor, "p e"]
    layers: tuple[PreparedLayer, ...]
    output: Parameters


@dataclass(frozen=True)
class TargetCache:
    """What the decoder remembers of the tokens written so far.

    A step writes behind them in place: go on from a cache once, or from copies by `rows`.

    Attributes:
        pairs: For each layer, keys and values of the tokens, and room for more.
        decoder: Made ready for the sentences.
        length: How many tokens.
    """

    pairs: Float[Tensor, "l b h t 2 d"]
    decoder: PreparedDecoder
    length: int = 0

    def rows(self, index: Int[Tensor, " n"]) -> "TargetCache":
        """The hypotheses with these numbers, as many as before; each stays with its sentence."""
        return replace(self, pairs=self.pairs.index_select(1, index))

    def with_room(self) -> Float[Tensor, "l b h t2 2 d"]:
        """`pairs` with room for a token more; doubled where there is none."""
        room = self.pairs.shape[3]
        if self.length < room:
            return self.pairs
        return nn.functional.pad(self.pairs, (0, 0, 0, 0, 0, max(room, _ROOM)))


class Attention(nn.Module):
    """Multi-head attention whose heads have a size of their own.

    Args:
        size: Of what comes in and goes out.
        heads: How many.
        head_size: Of each head's queries, keys and values.

    References:
        Thesis, equation 2.27 and figure 2.8.
    """

    def __init__(self, size: int, heads: int, head_size: int) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(size, heads * head_size, bias=False)
        self.key = nn.Linear(size, heads * head_size, bias=False)
        self.value = nn.Linear(size, heads * head_size, bias=False)
        self.output = nn.Linear(heads * head_size, size)

    def pair(self, given: Float[Tensor, "b t e"]) -> Pair:
        """Keys and values of what is looked at."""
        return self._split(self.key(given)), self._split(self.value(given))

    def forward(
        self,
        asking: Float[Tensor, "b s e"],
        pair: Pair,
        mask: Bool[Tensor, "b 1 1 t"] | None = None,
        causal: bool = False,
    ) -> Float[Tensor, "b s e"]:
        """What each place finds where it looks."""
        query = self._split(self.query(asking))
        found = scaled_dot_product_attention(query, *pair, attn_mask=mask, is_causal=causal)
        return self.output(found.transpose(1, 2).flatten(2))

    def _split(self, vectors: Float[Tensor, "b t hd"]) -> Float[Tensor, "b h t d"]:
        rows, places, _ = vectors.shape
        return vectors.view(rows, places, self.heads, -1).transpose(1, 2)


class _Layer(nn.Module):
    """A layer of the encoder, or with `crossed` one of the decoder."""

    def __init__(self, config: TransformerConfig, *, crossed: bool) -> None:
        super().__init__()
        size = config.embedding_size
        sizes = (size, config.heads, config.attention_size)
        self.own = Attention(*sizes)
        self.own_norm = nn.LayerNorm(size, eps=NORMALISATION_EPSILON)
        if crossed:
            self.source = Attention(*sizes)
            self.source_norm = nn.LayerNorm(size, eps=NORMALISATION_EPSILON)
        self.wide = nn.Linear(size, config.feed_forward_size)
        self.narrow = nn.Linear(config.feed_forward_size, size)
        self.wide_norm = nn.LayerNorm(size, eps=NORMALISATION_EPSILON)
        self.dropout = nn.Dropout(config.dropout)

    def added(
        self, x: Float[Tensor, "b t e"], more: Float[Tensor, "b t e"], norm: nn.LayerNorm
    ) -> Float[Tensor, "b t e"]:
        """Dropout, addition, normalisation."""
        if self.training:
            more = self.dropout(more)
        return layer_norm(x + more, norm.normalized_shape, norm.weight, norm.bias, norm.eps)

    def fed_forward(self, x: Float[Tensor, "b t e"]) -> Float[Tensor, "b t e"]:
        """The feed-forward sublayer."""
        return self.added(x, self.narrow(relu(self.wide(x))), self.wide_norm)


class _Stack(nn.ModuleList):
    """Layers, the first one first."""

    def __iter__(self) -> Iterator[_Layer]:
        return super().__iter__()  # type: ignore[return-value]


class TransformerNetwork(nn.Module):
    """Encoder and decoder; see the module's docstring."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        self.config = c = config
        self.source_words = nn.Embedding(c.source_words, c.embedding_size, padding_idx=PADDING)
        self.target_words = nn.Embedding(c.target_words, c.embedding_size, padding_idx=PADDING)
        self.encoder = _Stack(_Layer(c, crossed=False) for _ in range(c.layers))
        self.decoder = _Stack(_Layer(c, crossed=True) for _ in range(c.layers))
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
        prepared = tuple(_prepared(layer, pair, shown, bias) for layer, pair, bias in layers)
        output = _transposed(self.output.weight, self.output.bias)
        decoder = PreparedDecoder(self.target_words.weight, self.places + ahead, prepared, output)
        return TargetCache(empty, decoder)

    def step(
        self, tokens: Int[Tensor, " b"], cache: TargetCache, memory: SourceMemory
    ) -> tuple[Float[Tensor, "b w"], Float[Tensor, "b h t"], TargetCache]:
        """Take one token more; what came before is read from the cache.

        A network of this size spends most of a step on calling, not on computing, so the
        same sums as in `decode` are written with few calls.

        Returns:
            Logits of the next token, scores of the last layer's heads at the source
            (logarithms of their attention, up to a constant), and the longer cache.
        """
        rows, heads, size = len(tokens), self.config.heads, self.config.attention_size
        width, here = (self.config.embedding_size,), cache.length
        words, places, layers, output = cache.decoder
        added = torch.addmm if rows == 1 else _each_added
        buffer = cache.with_room()
        flat = buffer.flatten(1, 2)
        slots = flat.select(2, here).unbind()
        keys, values = flat.narrow(2, 0, here + 1).unbind(3)
        known = zip(layers, slots, keys.transpose(2, 3).unbind(), values.unbind(), strict=True)
        x = words.index_select(0, tokens) + places[here]
        made, looked, scores = (rows * heads, 3, size), (rows, heads, -1), x
        for layer, slot, key, value in known:
            own = torch.addmm(layer.own[1], x, layer.own[0]).view(made)
            slot.copy_(own.narrow(1, 1, 2))
            asked = torch.bmm(own.narrow(1, 0, 1), key)
            found = torch.bmm(torch.softmax(asked, -1), value).view(rows, -1)
            x = torch.addmm(x, found, layer.own_output)
            x = torch.layer_norm(x, width, *layer.own_norm, NORMALISATION_EPSILON)
            scores = added(layer.shown, x, layer.asked)
            attention = torch.softmax(scores.view(looked), -1).view(scores.shape)
            x = added(x, attention, layer.told)
            x = torch.layer_norm(x, width, *layer.source_norm, NORMALISATION_EPSILON)
            x = torch.addmm(x, torch.addmm(layer.wide[1], x, layer.wide[0]).relu_(), layer.narrow)
            x = torch.layer_norm(x, width, *layer.wide_norm, NORMALISATION_EPSILON)
        logits = torch.addmm(output[1], x, output[0])
        return logits, scores.view(looked), TargetCache(buffer, cache.decoder, here + 1)


def _each_added(
    to: Float[Tensor, "b m"], rows: Float[Tensor, "b n"], matrices: Float[Tensor, "b n m"]
) -> Float[Tensor, "b m"]:
    """As `addmm`, each row times a matrix of its own."""
    return torch.baddbmm(to.unsqueeze(1), rows.unsqueeze(1), matrices).squeeze(1)


def _prepared(
    layer: _Layer, pair: Pair, shown: Float[Tensor, "b ht"], behind: Float[Tensor, " e"]
) -> PreparedLayer:
    """A layer, given the bias of the next one's output of its look at the target."""
    own, source, wide = layer.own, layer.source, layer.wide
    keys, values = pair
    heads, size = keys.shape[1], keys.shape[3]
    queries = source.query.weight.view(heads, size, -1).transpose(1, 2)
    outputs = source.output.weight.view(-1, heads, size).permute(1, 2, 0)
    asked = (queries @ keys.transpose(2, 3) * size**-0.5).transpose(1, 2).flatten(2)
    told = values @ outputs
    told[:, 0] += source.output.bias  # a head's attention sums to 1
    told = told.flatten(1, 2)
    three = torch.stack([own.query.weight * size**-0.5, own.key.weight, own.value.weight])
    made = three.unflatten(1, (heads, size)).transpose(0, 1).flatten(0, 2)
    one = len(shown) == 1  # one matrix for the only sentence
    return PreparedLayer(
        own=_transposed(made, -made @ own.output.bias),
        own_output=own.output.weight.T.contiguous(),
        own_norm=(layer.own_norm.weight, layer.own_norm.bias),
        asked=asked[0] if one else asked,
        shown=shown,
        told=told[0] if one else told,
        source_norm=(layer.source_norm.weight, layer.source_norm.bias + layer.narrow.bias),
        wide=_transposed(wide.weight, wide.bias - wide.weight @ layer.narrow.bias),
        narrow=layer.narrow.weight.T.contiguous(),
        wide_norm=(layer.wide_norm.weight, layer.wide_norm.bias + behind),
    )


def _transposed(weight: Float[Tensor, "n e"], bias: Float[Tensor, " n"]) -> Parameters:
    """As `addmm` takes them."""
    return weight.T.contiguous(), bias


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
