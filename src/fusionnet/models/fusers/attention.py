"""The sentence asks, the picture's nodes answer (thesis, chapter 8).

Each head makes a question of the sentence's nodes and attends to the places whose nodes
answer it. What comes back is what is there and, by a learned vector a place, where it is.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fusionnet.models.fusers._fuser import Fuser

HEADS = 4
SIZE = 32
"""Features of each head's question, and of a place."""


class Attention(Fuser):
    """Attention of the sentence to the places of the picture."""

    def __init__(self, seen: tuple[int, int], said: tuple[int, int]) -> None:
        super().__init__(seen, said)
        places, nodes = seen
        tokens = said[0] * said[1]
        self.query = nn.Linear(tokens, HEADS * SIZE)
        self.key = nn.Parameter(torch.randn(HEADS, SIZE, nodes) * nodes**-0.5)
        self.place = nn.Parameter(0.1 * torch.randn(places, SIZE))
        nn.init.xavier_uniform_(self.query.weight)
        nn.init.zeros_(self.query.bias)
        self.width = HEADS * (nodes + SIZE) + tokens

    def forward(
        self, seen: Float[Tensor, "b n d"], said: Float[Tensor, "b l d"]
    ) -> Float[Tensor, "b f"]:
        """What each head found and where, and the sentence's nodes."""
        flat = said.flatten(1)
        weights = self.attended(seen, said)
        content = torch.cat([seen, self.place.expand(len(seen), -1, -1)], dim=-1)
        return torch.cat([(weights @ content).flatten(1), flat], dim=1)

    def attended(
        self, seen: Float[Tensor, "b n d"], said: Float[Tensor, "b l d"]
    ) -> Float[Tensor, "b h n"]:
        """How strongly each head looks at each place; every row sums to 1."""
        query = self.query(said.flatten(1)).unflatten(1, (HEADS, SIZE))
        asked = torch.einsum("bhs,hsd->bhd", query, self.key)  # cheaper than every place's key
        scores = asked @ seen.transpose(1, 2) + query @ self.place.T
        weights: Tensor = torch.softmax(scores * SIZE**-0.5, dim=-1)
        return weights


FUSER = Attention
