"""Backbones: one file each, from a picture to feature maps of rising stride.

A module here offers `BACKBONE`, a function without arguments that returns an
`nn.Module` with `strides` and `channels`, whose forward gives one map a stride.
"""

from fusionnet.catalogue import Catalogue

catalogue = Catalogue("fusionnet.models.backbones", kind="backbone", attribute="BACKBONE")
load = catalogue.load
names = catalogue.names
