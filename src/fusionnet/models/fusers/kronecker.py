"""Every seen feature times every said one: the product of two short summaries.

The product of all nodes would have millions of entries, so each modality is summarised
first. A one is put beside each summary, so that the product holds the summaries as well.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fusionnet.models.fusers._fuser import Fuser

SUMMARY = 32
"""Features of each modality's summary."""


class Kronecker(Fuser):
    """The Kronecker product of two summaries.

    References:
        Zadeh et al. (2017), Tensor fusion network for multimodal sentiment analysis.
    """

    def __init__(self, seen: tuple[int, int], said: tuple[int, int]) -> None:
        super().__init__(seen, said)
        self.see = nn.Linear(seen[0] * seen[1], SUMMARY)
        self.hear = nn.Linear(said[0] * said[1], SUMMARY)
        for layer in (self.see, self.hear):
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)
        self.width = (SUMMARY + 1) ** 2

    def forward(
        self, seen: Float[Tensor, "b n d"], said: Float[Tensor, "b l d"]
    ) -> Float[Tensor, "b f"]:
        """Products of all pairs of features, the summaries themselves among them."""
        one = _with_one(torch.tanh(self.see(seen.flatten(1))))
        other = _with_one(torch.tanh(self.hear(said.flatten(1))))
        return torch.einsum("bi,bj->bij", one, other).flatten(1)


def _with_one(features: Float[Tensor, "b f"]) -> Float[Tensor, "b g"]:
    return torch.cat([features, features.new_ones(len(features), 1)], dim=1)


FUSER = Kronecker
