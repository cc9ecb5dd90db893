"""Pictures without blocks: boards of any kind and size, from any side, among clutter.

A detector that has only seen our board takes the pale squares of another for blocks. These are
drawn while it trains, and there is nothing to be found in them.
"""

import numpy as np
from jaxtyping import UInt8

from fusionnet.blocks import EMPTY
from fusionnet.dataset.pictures import Labels
from fusionnet.views import drawn_view


def empty_picture(
    rng: np.random.Generator, size: tuple[int, int]
) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
    """A picture without blocks, and labels that say so.

    Args:
        rng: Source of all randomness.
        size: Width and height in pixels.
    """
    return drawn_view(rng, size).image, _nothing()


def _nothing() -> Labels:
    return Labels(
        boxes=np.zeros((0, 4)),
        classes=np.zeros(0, dtype=int),
        hidden=np.zeros(0, dtype=bool),
        cells=np.full(512, EMPTY),
        visible=np.zeros(512, dtype=int),
        offsets=np.zeros((512, 3)),
        holding=False,
        matrix=np.eye(3),
        camera_from_board=np.eye(4),
        by_eye=False,
    )
