"""Attention and the layers that the thesis's Transformer is made of.

References:
    Thesis, sections 2.1.11 and 4.2.1. Vaswani et al. (2017), Attention Is All You Need.
"""

from collections.abc import Iterator
from typing import cast

from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn.functional import layer_norm, relu, scaled_dot_product_attention

from fusionnet.models.transformer_config import TransformerConfig

NORMALISATION_EPSILON = 1e-6
"""Added to the deviation in every normalisation (4.2.2)."""

Pair = tuple[Float[Tensor, "b h t d"], Float[Tensor, "b h t d"]]
"""Keys and values of an attention."""


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


class Layer(nn.Module):
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


class Stack(nn.ModuleList):
    """Layers, the first one first."""

    def __iter__(self) -> Iterator[Layer]:
        return cast(Iterator[Layer], super().__iter__())
