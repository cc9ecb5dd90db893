"""Heads: one intermediate representation a file, each owning target, prediction, loss and metric.

- `boxes`: what and where, as RetinaNet (thesis 4.1.1)
- `fusion_nodes`: what the thesis's detector hands on to FusionNet (4.3.1); without a loss
- `camera_pose`: where the eye is, so that cells can be projected into the picture
- `occupancy`: which block is in which of the 512 cells
"""
