"""Learn each loss's weight as the inverse of its homoscedastic uncertainty."""

from collections.abc import Sequence

from torchjd.scalarization import UW

from fusionnet.training.weightings._weighting import ScalarWeighting


def uncertainty(names: Sequence[str]) -> ScalarWeighting:
    """Learn each loss's weight as the inverse of its homoscedastic uncertainty.

    References:
        Kendall et al. (2018), Multi-task learning using uncertainty to weigh losses for scene
        geometry and semantics; named by the thesis in 2.1.12.
    """
    return ScalarWeighting(names, UW(len(names)))


WEIGHTING = uncertainty
