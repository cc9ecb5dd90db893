"""One token after the other by the thesis's Transformer, with what came before in a cache.

A network of this size spends most of a step on calling, not on computing, so the same sums as
in `TransformerNetwork.decode` are written with few calls.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fusionnet.models.transformer_layers import NORMALISATION_EPSILON, Layer, Pair

_ROOM = 16
"""Tokens for which a cache has room at first."""

Parameters = tuple[Tensor, Tensor]
"""Weight and bias of a linear layer or a normalisation."""


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


def next_token(
    tokens: Int[Tensor, " b"], cache: TargetCache
) -> tuple[Float[Tensor, "b w"], Float[Tensor, "b h t"], TargetCache]:
    """What `TransformerNetwork.step` does, which says what comes in and goes out."""
    words, places, layers, output = cache.decoder
    _, rows, heads, _, _, size = cache.pairs.shape
    width, here = words.shape[1:], cache.length
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


def prepared(
    layer: Layer, pair: Pair, shown: Float[Tensor, "b ht"], behind: Float[Tensor, " e"]
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
        own=transposed(made, -made @ own.output.bias),
        own_output=own.output.weight.T.contiguous(),
        own_norm=(layer.own_norm.weight, layer.own_norm.bias),
        asked=asked[0] if one else asked,
        shown=shown,
        told=told[0] if one else told,
        source_norm=(layer.source_norm.weight, layer.source_norm.bias + layer.narrow.bias),
        wide=transposed(wide.weight, wide.bias - wide.weight @ layer.narrow.bias),
        narrow=layer.narrow.weight.T.contiguous(),
        wide_norm=(layer.wide_norm.weight, layer.wide_norm.bias + behind),
    )


def transposed(weight: Float[Tensor, "n e"], bias: Float[Tensor, " n"]) -> Parameters:
    """As `addmm` takes them."""
    return weight.T.contiguous(), bias
