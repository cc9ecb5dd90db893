"""Project each loss's gradient so that no other loss rises, and add them up."""

from collections.abc import Sequence

from torchjd.aggregation import UPGrad

from fusionnet.training.weightings._weighting import GradientWeighting


def upgrad(names: Sequence[str]) -> GradientWeighting:
    """Project each loss's gradient so that no other loss rises, and add them up.

    References:
        Quinton and Rey (2024), Jacobian descent for multi-objective optimization.
    """
    return GradientWeighting(names, UPGrad())


WEIGHTING = upgrad
