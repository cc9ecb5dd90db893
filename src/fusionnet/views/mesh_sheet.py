"""Views side by side with the mesh of the grasping region drawn on them (figure 3.3 c)."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from fusionnet.views.pose import draw_region
from fusionnet.views.view import EnvironmentalView

WIDTH = 480
"""Of one picture, in pixels."""


def mesh_sheet(
    views: Sequence[EnvironmentalView], levels: int = 8, columns: int = 3
) -> UInt8[np.ndarray, "h w 3"]:
    """All views in rows; below each its name, and whether it trains or validates.

    Args:
        views: At least one.
        levels: Of the grasping region that are drawn.
        columns: Pictures a row.
    """
    tiles = []
    for view in views:
        drawn = draw_region(view.image, view.camera, levels)
        height = WIDTH * drawn.shape[0] // drawn.shape[1]
        tile = cv2.resize(drawn, (WIDTH, height), interpolation=cv2.INTER_AREA)
        words = f"{view.name} ({view.part})"
        cv2.rectangle(tile, (0, height - 20), (9 * len(words), height), (255, 255, 255), -1)
        cv2.putText(
            tile, words, (4, height - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA
        )
        tiles.append(tile)
    tall = max(tile.shape[0] for tile in tiles)
    tiles = [cv2.copyMakeBorder(t, 0, tall - t.shape[0], 0, 0, cv2.BORDER_CONSTANT) for t in tiles]
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    sheet: np.ndarray = np.vstack(rows)
    return sheet
