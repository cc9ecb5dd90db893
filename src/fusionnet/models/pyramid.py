"""The feature pyramid of the thesis: five levels of 256 channels from three maps of a backbone.

The compact detector has a smaller one of its own, inside `RetinaNet`.

References:
    Lin et al. (2017), Feature pyramid networks for object detection; thesis, 2.1.10 and 4.1.1.
"""

from collections import OrderedDict
from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor, nn
from torchvision.ops.feature_pyramid_network import FeaturePyramidNetwork, LastLevelP6P7


class FeaturePyramid(nn.Module):
    """P3 to P5 with lateral connections, P6 and P7 by strided convolutions upon the last map.

    Args:
        channels: Of the backbone's maps, finest first.
        width: Channels of every level.
    """

    def __init__(self, channels: Sequence[int], width: int = 256) -> None:
        super().__init__()
        top = LastLevelP6P7(channels[-1], width)
        self.network = FeaturePyramidNetwork(list(channels), width, extra_blocks=top)

    def forward(self, maps: Sequence[Float[Tensor, "b _ _ _"]]) -> list[Float[Tensor, "b c _ _"]]:
        """The levels, finest first; each has half the resolution of the one before."""
        named = OrderedDict((str(i), features) for i, features in enumerate(maps))
        return list(self.network(named).values())


def level_strides(strides: Sequence[int]) -> tuple[int, ...]:
    """Strides of the five levels upon a backbone's three."""
    return (*strides, 2 * strides[-1], 4 * strides[-1])


def initialise(part: nn.Module, deviation: float = 0.01) -> None:
    """Gaussian weights and biases of zero in every convolution (thesis 4.1.2)."""
    for module in part.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.normal_(module.weight, std=deviation)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
