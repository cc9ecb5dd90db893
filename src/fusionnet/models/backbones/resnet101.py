"""ResNet-101, as in the thesis (table 2.4): strides 8, 16 and 32."""

from functools import partial

from fusionnet.models.backbones._resnet import ResNet

BACKBONE = partial(ResNet, "resnet101")
