"""Backbones: one file each, from a picture to feature maps of rising stride.

A module here offers `BACKBONE`, a function without arguments that returns an
`nn.Module` with `strides` and `channels` of its maps and the `mean` and `deviation`
(of red, green and blue from 0 to 1) that its input is normalised with, whose forward
gives one map a stride; the small pyramid takes three. A detector with `detail` reads
a map at stride 2, too: that needs `stem` (pictures to that map), `stem_channels` and
`after_stem` (that map to the others). One with an attribute `imagenet` has
torchvision's parameter names and can begin with its ImageNet weights.
"""

from fusionnet.catalogue import Catalogue
from fusionnet.models.backbones._weights import (
    IMAGENET,
    RANDOM,
    fill_backbone,
    freeze_normalisation,
)

catalogue = Catalogue("fusionnet.models.backbones", kind="backbone", attribute="BACKBONE")
load = catalogue.load
names = catalogue.names

__all__ = [
    "IMAGENET",
    "RANDOM",
    "catalogue",
    "fill_backbone",
    "freeze_normalisation",
    "load",
    "names",
]
