"""What each part of a command rests on: its words, its cells, and where the picture shows them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import BLOCK_SIZE, GRID, Cell, Layout, Shape
from fusionnet.geometry import PinholeCamera, PointBehindCameraError
from fusionnet.models.fusionnet import FusionAnswer
from fusionnet.models.projected_boxes import convex_hull, covered, far_to_near, outlines
from fusionnet.models.reading import Reading
from fusionnet.models.tree_symbols import owned_symbols
from fusionnet.rcl import Node, describe, events

LEAST_LIT = 0.02
"""Cells with a smaller share of the most attended cell's attention are not lit."""


_SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
"""Corners of a cell's foot, from the cell's own, in cells."""


@dataclass(frozen=True, eq=False)
class Attention:
    """What one part of a command rests on.

    Attributes:
        label: The part in English: "the red pyramid"; "grasp" and "place" at the end.
        words: The sentence's words as the network read them, each with its share of the attention
            of this part; the shares sum to at most 1, the rest went to the gripper's state.
        cells: Share of each cell in what the part was taken to be.
    """

    label: str
    words: tuple[tuple[str, float], ...]
    cells: Float[np.ndarray, "512"]

    @property
    def cell(self) -> Cell:
        """The most attended cell."""
        return Cell.from_index(int(self.cells.argmax()))


def attentions(
    fused: FusionAnswer,
    reading: Reading,
    source: Float[np.ndarray, "512"],
    target: Float[np.ndarray, "512"],
) -> tuple[Attention, ...]:
    """The attention of each entity, landmarks first, then of the grasp and of the place.

    The grasp rests on the words of the first action, the place on those of the last destination,
    or, if there is none, of the last action.

    Args:
        fused: What the network answered.
        reading: The reading that decided.
        source: Probability of each cell to be grasped at.
        target: Probability of each cell to be placed at.
    """
    first, last = events(reading.tree)[0], events(reading.tree)[-1]
    place = next((e.destination for e in reversed(events(reading.tree)) if e.destination), last)
    parts: list[tuple[str, Node, np.ndarray]]
    parts = [(describe(entity), entity, cells) for entity, cells in fused.attention]
    parts += [("grasp", first, source), ("place", place, target)]
    return tuple(
        Attention(label, _words(reading, node), cells / max(float(cells.sum()), 1e-12))
        for label, node, cells in parts
    )


def _words(reading: Reading, node: Node) -> tuple[tuple[str, float], ...]:
    """The words of a reading with their shares of what a node's values looked at."""
    rows = [
        row
        for (owner, symbol), row in zip(owned_symbols(reading.tree), reading.attention, strict=True)
        if owner is node and symbol.is_leaf
    ]
    return tuple(zip(reading.words, np.mean(rows, axis=0).tolist(), strict=True))


def attended_pixels(
    cells: Float[np.ndarray, "512"], layout: Layout, camera: PinholeCamera
) -> Float[np.ndarray, "h w"]:
    """How much of an attention each pixel of the eye's picture has, 1 where there is most.

    Blocks are lit where the others do not hide them, an empty cell on the table as a square of
    the board, one in the air as the cube that would fill it.

    Args:
        cells: Share of each cell.
        layout: The blocks that were seen.
        camera: The eye as it was estimated; the board's frame stands for the robot's.
    """
    picture = np.zeros((camera.height, camera.width), np.float32)
    shares = cells / max(float(cells.max()), 1e-12)
    shapes = {block.cell.index: block.shape for block in layout.blocks}
    drawn = np.array(sorted({*shapes, *np.flatnonzero(shares >= LEAST_LIT).tolist()}))
    order = drawn[far_to_near(drawn, camera.position)].tolist()

    def project(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        return camera.project(points) + 0.5  # outlines speak of edges

    squares = [index for index in order if index not in shapes and index % GRID == 0]
    try:
        for index in squares + [index for index in order if index not in squares]:
            if index in squares:
                corners = (np.array(Cell.from_index(index)) + _SQUARE) * BLOCK_SIZE
                outline = convex_hull(project(corners))
            else:
                shape = shapes.get(index, Shape.CUBE)
                outline = outlines(np.array([index]), shape, project)[0]
            window, inside = covered(outline, (camera.width, camera.height))
            picture[window][inside] = shares[index]
    except PointBehindCameraError:  # a camera estimated where there is no board
        picture[:] = 0.0
    return picture
