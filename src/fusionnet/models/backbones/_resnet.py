"""What the three residual networks of the thesis have in common: torchvision's stages 2 to 4.

References:
    He et al. (2016), Deep residual learning for image recognition; thesis, table 2.4.
"""

import torchvision.models
from jaxtyping import Float
from torch import Tensor, nn


class ResNet(nn.Module):
    """Feature maps at strides 8, 16 and 32 of one of torchvision's residual networks.

    Parameters have torchvision's names, so that its ImageNet weights fit.

    Args:
        name: Of torchvision's function: resnet50, resnet101, resnet152.
    """

    strides = (8, 16, 32)
    channels = (512, 1024, 2048)
    mean = (0.485, 0.456, 0.406)
    deviation = (0.229, 0.224, 0.225)

    def __init__(self, name: str) -> None:
        super().__init__()
        self.imagenet = name
        whole = getattr(torchvision.models, name)(weights=None)
        self.conv1, self.bn1, self.relu = whole.conv1, whole.bn1, whole.relu
        self.maxpool, self.layer1 = whole.maxpool, whole.layer1
        self.layer2, self.layer3, self.layer4 = whole.layer2, whole.layer3, whole.layer4

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b _ _ _"]]:
        """The last maps of conv3_x, conv4_x and conv5_x."""
        x = self.layer1(self.maxpool(self.relu(self.bn1(self.conv1(images)))))
        fine = self.layer2(x)
        middle = self.layer3(fine)
        return [fine, middle, self.layer4(middle)]
