"""Take out of each gradient what points against another one."""

from collections.abc import Sequence

from torchjd.aggregation import PCGrad

from fusionnet.training.weightings._weighting import GradientWeighting


def pcgrad(names: Sequence[str]) -> GradientWeighting:
    """Take out of each gradient what points against another one.

    References:
        Yu et al. (2020), Gradient surgery for multi-task learning.
    """
    return GradientWeighting(names, PCGrad())


WEIGHTING = pcgrad
