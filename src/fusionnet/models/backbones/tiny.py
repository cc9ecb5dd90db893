"""A backbone of 92,000 parameters for small pictures and many short runs: strides 8, 16 and 32."""

from jaxtyping import Float
from torch import Tensor, nn


def _stage(source: int, target: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(source, target, 3, stride=2, padding=1, bias=False),
        nn.BatchNorm2d(target),
        nn.ReLU(inplace=True),
    )


class Tiny(nn.Module):
    """Convolutions of stride 2, each twice as wide as the one before."""

    strides = (8, 16, 32)
    channels = (48, 64, 64)
    mean = (0.5, 0.5, 0.5)
    deviation = (0.5, 0.5, 0.5)

    def __init__(self) -> None:
        super().__init__()
        fine, middle, coarse = self.channels
        self.fine = nn.Sequential(_stage(3, 16), _stage(16, 32), _stage(32, fine))
        self.middle = _stage(fine, middle)
        self.coarse = _stage(middle, coarse)

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b _ _ _"]]:
        """Feature maps at strides 8, 16 and 32."""
        fine = self.fine(images)
        middle = self.middle(fine)
        return [fine, middle, self.coarse(middle)]


BACKBONE = Tiny
