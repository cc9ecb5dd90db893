"""All nodes of both modalities side by side (thesis 4.3.1).

Read by one layer, the picture and the sentence only add to each other before the sigmoid:
what is said cannot choose among what is seen. The other fusers can.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from fusionnet.models.fusers._fuser import Fuser


class Concatenate(Fuser):
    """All nodes of both modalities, flattened to one layer."""

    def __init__(self, seen: tuple[int, int], said: tuple[int, int]) -> None:
        super().__init__(seen, said)
        self.width = seen[0] * seen[1] + said[0] * said[1]

    def forward(
        self, seen: Float[Tensor, "b n d"], said: Float[Tensor, "b l d"]
    ) -> Float[Tensor, "b f"]:
        """The nodes as they are, the picture's first."""
        return torch.cat([seen.flatten(1), said.flatten(1)], dim=1)


FUSER = Concatenate
