"""The command, token by token: the Transformer's output layer as a representation (thesis 4.2).

What is written is the tree's text, or whatever else the network was asked to translate to
(thesis 7.3: the sentence itself).
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

from fusionnet.models.heads._head import Example, Features, Head

IGNORED = -100


class TreeHead(Head):
    """The token behind every place of the target."""

    columns = ("tree",)

    @staticmethod
    def target(example: Example) -> Int[Tensor, " s"]:
        """The tokens to write, without the first mark."""
        return torch.tensor(example.target[1:], dtype=torch.long)

    def forward(self, features: Features) -> Float[Tensor, "b s w"]:
        """Logits of every token."""
        return features.tokens

    def loss(
        self,
        output: Float[Tensor, "b s w"],
        targets: Sequence[Int[Tensor, " _"]],
        features: Features,
    ) -> Tensor:
        """Cross-entropy, a mean over the tokens (thesis 4.2.2)."""
        wanted = pad_sequence(list(targets), batch_first=True, padding_value=IGNORED)
        return nn.functional.cross_entropy(
            output[:, : wanted.shape[1]].transpose(1, 2).float(), wanted, ignore_index=IGNORED
        )

    def predict(self, output: Float[Tensor, "b s w"]) -> list[Int[Tensor, " _"]]:
        """The likeliest token at every place, given the true ones before it."""
        return list(output.argmax(dim=-1).cpu())

    @staticmethod
    def metric(
        found: Sequence[Int[Tensor, " _"]], truth: Sequence[Int[Tensor, " _"]]
    ) -> dict[str, float]:
        """`token_accuracy`: share of tokens right, given the true ones before (table 7.4)."""
        right = [
            (given[: len(true)] == true).float() for given, true in zip(found, truth, strict=True)
        ]
        return {"token_accuracy": float(torch.cat(right).mean())}


HEAD = TreeHead
