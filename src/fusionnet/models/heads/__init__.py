"""Heads: one intermediate representation a file, each owning target, prediction, loss and metric.

A module here offers `HEAD`, a `Head` of FusionNet; its name is the name of its loss
([adding one](../../../../docs/add-a-head.md)):

- `boxes`: where the blocks are, as RetinaNet's regression subnet says (thesis 4.1.1)
- `classes`: what they are, as its classification subnet says
- `tree`: the command, token by token (4.2)
- `joints`: the fourteen values (4.3); what all others are there for
- `occupancy`: which block is in which of the 512 cells; the thesis never tried it

Parts of detectors that have no loss of their own in FusionNet live here as well:

- `fusion_nodes`: what the thesis's detector hands on to FusionNet (4.3.1); without a loss
- `camera_pose`: where the eye is, so that cells can be projected into the picture
"""

from fusionnet.catalogue import Catalogue
from fusionnet.models.heads._head import Example, Features, Head, Shapes

catalogue = Catalogue(
    "fusionnet.models.heads", kind="head", attribute="HEAD", parts=("fusion_nodes", "camera_pose")
)
load = catalogue.load
names = catalogue.names

__all__ = ["Example", "Features", "Head", "Shapes", "catalogue", "load", "names"]
