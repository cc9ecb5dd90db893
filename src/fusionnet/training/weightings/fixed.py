"""Add the losses up, each with its fixed factor (thesis 7.1 and 7.2)."""

from collections.abc import Sequence

from torchjd.scalarization import Sum

from fusionnet.training.weightings._weighting import ScalarWeighting


def fixed(names: Sequence[str]) -> ScalarWeighting:
    """Add the losses up, each with its fixed factor (thesis 7.1 and 7.2)."""
    return ScalarWeighting(names, Sum())


WEIGHTING = fixed
