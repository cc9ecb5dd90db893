"""Follow the first loss's gradient, as long as every other loss makes some progress."""

from collections.abc import Sequence

from torchjd.aggregation import PCD

from fusionnet.training.weightings._weighting import GradientWeighting


def primary(names: Sequence[str]) -> GradientWeighting:
    """Follow the first loss's gradient, as long as every other loss makes some progress.

    References:
        Priority-constrained descent (TMLR 2026), as implemented in TorchJD.
    """
    return GradientWeighting(names, PCD(), ordered=True)


WEIGHTING = primary
