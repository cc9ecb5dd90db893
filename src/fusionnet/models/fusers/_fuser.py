"""What every fuser of nodes offers."""

from jaxtyping import Float
from torch import Tensor, nn


class Fuser(nn.Module):
    """From the nodes of a picture and of a sentence to one vector.

    Args:
        seen: Nodes of a picture: places (anchors, of RetinaNet), and nodes at each.
        said: Nodes of a sentence: tokens, and nodes at each.

    Attributes:
        width: Length of the vector.
    """

    width: int

    def __init__(self, seen: tuple[int, int], said: tuple[int, int]) -> None:
        super().__init__()
        self.seen = seen
        self.said = said

    def forward(
        self, seen: Float[Tensor, "b n d"], said: Float[Tensor, "b l d"]
    ) -> Float[Tensor, "b f"]:
        """The fused vector of each example."""
        raise NotImplementedError
