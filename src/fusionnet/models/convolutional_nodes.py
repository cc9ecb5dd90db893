"""The thesis's plain vision: two convolutions in place of RetinaNet (7.3).

References:
    Thesis 7.3, after Kerzel and Wermter (2017), Neural end-to-end self-learning of visuomotor
    skills by environment interaction.
"""

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

FILTERS = 16


class ConvolutionalNodes(nn.Module):
    """Sixteen filters of 3x3, sixteen of 4x4, each with ReLU and pooling; no heads.

    Args:
        input_size: Width and height of the network's input, in pixels.
        nodes: D; the output is reshaped to places of so many.
    """

    def __init__(self, input_size: tuple[int, int], nodes: int) -> None:
        super().__init__()
        self.network = nn.Sequential(
            nn.Conv2d(3, FILTERS, 3),
            nn.ReLU(inplace=True),
            nn.MaxPool2d(2),
            nn.Conv2d(FILTERS, FILTERS, 4),
            nn.ReLU(inplace=True),
            nn.MaxPool2d(2),
        )
        for module in self.network:
            if isinstance(module, nn.Conv2d) and module.bias is not None:
                nn.init.xavier_uniform_(module.weight)
                nn.init.zeros_(module.bias)
        self.nodes = nodes
        width, height = (((side - 2) // 2 - 3) // 2 for side in input_size)
        self.places = -(-FILTERS * width * height // nodes)

    def forward(self, images: UInt8[Tensor, "b h w 3"]) -> Float[Tensor, "b n d"]:
        """The filters' answers as nodes; the last place is filled up with zeros."""
        x = (images.permute(0, 3, 1, 2).float() / 127.5 - 1.0).contiguous(
            memory_format=torch.channels_last
        )
        flat = self.network(x).flatten(1)
        missing = self.places * self.nodes - flat.shape[1]
        return nn.functional.pad(flat, (0, missing)).unflatten(1, (self.places, self.nodes))
