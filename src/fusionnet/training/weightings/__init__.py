"""Weightings: one way of making one gradient of several named losses a file.

A module here offers `WEIGHTING`, a function from the names of the losses (the most
important first) to a `Weighting`. The fixed one adds the losses up (thesis 7.1, 7.2);
others learn their weights, or look at how the losses' gradients lie to each other.
"""

from fusionnet.catalogue import Catalogue
from fusionnet.training.weightings._weighting import (
    GradientWeighting,
    ScalarWeighting,
    Weighting,
)

catalogue = Catalogue("fusionnet.training.weightings", kind="weighting", attribute="WEIGHTING")
load = catalogue.load
names = catalogue.names

__all__ = ["GradientWeighting", "ScalarWeighting", "Weighting", "load", "names"]
