"""What the detector hands on to FusionNet: a few nodes an anchor (thesis 4.1.1, 4.3.1).

The subnet is built as the classification subnet with D nodes in place of the K classes.
It has no target and no loss of its own: what it learns comes from FusionNet's loss.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fusionnet.models.heads.boxes import BoxConfig, by_anchor, subnet


class FusionNodes(nn.Module):
    """The fusion subnet, shared by all pyramid levels.

    Args:
        channels: Channels of every level.
        boxes: Anchors, depth and width, those of the box head.
        nodes: D, the nodes an anchor (thesis: 4 in most experiments).
    """

    def __init__(self, *, channels: int, boxes: BoxConfig, nodes: int = 4) -> None:
        super().__init__()
        self.nodes = nodes
        self.network = subnet(channels, boxes, boxes.anchors_a_place * nodes)

    def forward(self, levels: Sequence[Float[Tensor, "b c _ _"]]) -> Float[Tensor, "b n d"]:
        """Linear nodes of every anchor of every level, in the order of the box head's."""
        return torch.cat([by_anchor(self.network(level), self.nodes) for level in levels], dim=1)
