"""The small backbone with twice the channels and more blocks, for pictures of any place."""

from torch import nn

from fusionnet.models.backbones.small import Residual, Small


class Wide(Small):
    """Stem of stride 4 and three stages of residual blocks, each of which begins as identity.

    So it can begin with what a smaller one has learnt, as `training.warm_start` does.

    References:
        Goyal et al. (2017), Accurate, large minibatch SGD, section 5.1 (the last scale is zero).
    """

    channels = (64, 128, 256)
    blocks = (2, 3, 3)
    stem_channels = 32

    def __init__(self) -> None:
        super().__init__()
        for module in self.modules():
            if isinstance(module, Residual):
                last = module.body[-1]
                assert isinstance(last, nn.BatchNorm2d)
                nn.init.zeros_(last.weight)


BACKBONE = Wide
