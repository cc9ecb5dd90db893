"""Fusers: one way of bringing together what was seen and what was said a file.

A module here offers `FUSER`, a `Fuser`: from the nodes of a picture and those of a sentence
to one vector, from which the joints are read.

- `concatenate`: both side by side, as in the thesis (4.3.1)
- `kronecker`: every seen feature times every said one
- `attention`: the sentence asks, the picture's nodes answer (thesis, chapter 8)

`tree_executor` is the compact FusionNet's own: it carries the tree out, entity by entity, on
the soft layout that was seen, and knows neither nodes nor vectors.
"""

from fusionnet.catalogue import Catalogue
from fusionnet.models.fusers._fuser import Fuser

catalogue = Catalogue(
    "fusionnet.models.fusers", kind="fuser", attribute="FUSER", parts=("tree_executor",)
)
load = catalogue.load
names = catalogue.names

__all__ = ["Fuser", "catalogue", "load", "names"]
