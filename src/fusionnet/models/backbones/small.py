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


def _residuals(channels: int, count: int) -> list[Residual]:
    return [Residual(channels) for _ in range(count)]


class Small(nn.Module):
    """Stem of stride 4 and three stages of residual blocks."""

    strides = (4, 8, 16)
    channels: tuple[int, int, int] = (40, 80, 128)
    blocks: tuple[int, int, int] = (1, 2, 2)
    stem_channels = 24
    mean = (0.5, 0.5, 0.5)
    deviation = (0.5, 0.5, 0.5)

    def __init__(self) -> None:
        super().__init__()
        (fine, middle, coarse), (first, second, third) = self.channels, self.blocks
        stem = self.stem_channels
        self.fine = nn.Sequential(_halve(3, stem), _halve(stem, fine), *_residuals(fine, first))
        self.middle = nn.Sequential(_halve(fine, middle), *_residuals(middle, second))
        self.coarse = nn.Sequential(_halve(middle, coarse), *_residuals(coarse, third))

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b _ _ _"]]:
        """Feature maps at strides 4, 8 and 16."""
        return self.after_stem(self.stem(images))

    def stem(self, images: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b c _ _"]:
        """Edges and colours at stride 2."""
        edges: Tensor = self.fine[0](images)
        return edges

    def after_stem(self, stem: Float[Tensor, "b c _ _"]) -> list[Float[Tensor, "b _ _ _"]]:
        """Feature maps at strides 4, 8 and 16 from the one at stride 2."""
        fine = self.fine[1:](stem)
        middle = self.middle(fine)
        return [fine, middle, self.coarse(middle)]


BACKBONE = Small
