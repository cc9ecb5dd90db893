"""The sizes of the thesis's Transformer: tables 5.1 and 7.1."""

from dataclasses import asdict, dataclass
from typing import Any

from fusionnet.errors import CheckpointError


@dataclass(frozen=True, kw_only=True)
class TransformerConfig:
    """The sizes of the network; the defaults are those of table 7.1 (section 5.4).

    Attributes:
        source_words: Numbers in the vocabulary of what is read.
        target_words: Numbers in the vocabulary of what is written.
        embedding_size: d_emb, of both vocabularies; also the width of the network.
        layers: N_m, in the encoder and in the decoder.
        heads: N_h, of every attention.
        attention_size: d_a, of a head's queries, keys and values.
        feed_forward_size: d_ff.
        fusion_nodes: D, nodes of the fusion sublayer for each token written.
        longest: l_seq, tokens of a source and of a target, their marks included.
        dropout: P_drop.
    """

    source_words: int
    target_words: int
    embedding_size: int = 50
    layers: int = 4
    heads: int = 4
    attention_size: int = 12
    feed_forward_size: int = 256
    fusion_nodes: int = 4
    longest: int = 200
    dropout: float = 0.1

    def __post_init__(self) -> None:
        """Refuse sizes that build no network."""
        sizes = {k: v for k, v in asdict(self).items() if k != "dropout"}
        if any(not isinstance(v, int) or not 1 <= v <= 100_000 for v in sizes.values()):
            raise CheckpointError(f"A Transformer's sizes are whole numbers from 1; got {sizes}.")
        if not isinstance(self.dropout, int | float) or not 0 <= self.dropout < 1:
            raise CheckpointError(f"A dropout is at least 0 and below 1; got {self.dropout}.")

    @property
    def model_size(self) -> int:
        """d_model of equation 4.1: the outputs of all heads together."""
        return self.heads * self.attention_size


def base(source_words: int, target_words: int) -> TransformerConfig:
    """The Transformer that the thesis's experiments begin with (table 5.1)."""
    return TransformerConfig(
        source_words=source_words, target_words=target_words, heads=2, feed_forward_size=128
    )


def thesis(source_words: int, target_words: int) -> TransformerConfig:
    """The Transformer that the thesis ends with (table 7.1, section 5.4)."""
    return TransformerConfig(source_words=source_words, target_words=target_words)


def transformer_config(document: Any) -> TransformerConfig:
    """The configuration that a checkpoint's JSON holds.

    Raises:
        CheckpointError: If it holds something else.
    """
    try:
        return TransformerConfig(**document)
    except TypeError as error:
        raise CheckpointError(f"The Transformer's configuration does not fit: {error}.") from error
