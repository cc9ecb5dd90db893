"""A residual backbone of one million parameters for two CPU cores: strides 4, 8 and 16."""

from jaxtyping import Float
from torch import Tensor, nn


class Residual(nn.Module):
    """Two 3x3 convolutions with batch normalisation, added to their input.

    References:
        He et al. (2016), Deep residual learning for image recognition.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(inplace=True),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """Transform and add."""
        return nn.functional.relu(x + self.body(x))


def _halve(source: int, target: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(source, target, 3, stride=2, padding=1, bias=False),
        nn.BatchNorm2d(target),
        nn.ReLU(inplace=True),
    )


class Small(nn.Module):
    """Stem of stride 4 and three stages of residual blocks."""

    strides = (4, 8, 16)
    channels = (40, 80, 128)
    mean = (0.5, 0.5, 0.5)
    deviation = (0.5, 0.5, 0.5)

    def __init__(self) -> None:
        super().__init__()
        fine, middle, coarse = self.channels
        self.fine = nn.Sequential(_halve(3, 24), _halve(24, fine), Residual(fine))
        self.middle = nn.Sequential(_halve(fine, middle), Residual(middle), Residual(middle))
        self.coarse = nn.Sequential(_halve(middle, coarse), Residual(coarse), Residual(coarse))

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b _ _ _"]]:
        """Feature maps at strides 4, 8 and 16."""
        fine = self.fine(images)
        middle = self.middle(fine)
        return [fine, middle, self.coarse(middle)]


BACKBONE = Small
