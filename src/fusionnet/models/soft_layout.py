"""What must be physically true of a layout that was read with doubt.

A reader gives each cell its own probabilities; real columns of blocks stand on the
table without gaps, a prism carries nothing, and at most one block hangs in the air,
which is the held one. Bayes' rule over the possible heights of a column turns the
reader's independent cells into columns that obey this. There is nothing to learn
here; everything is differentiable.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fusionnet.blocks.grid import CLASS_NAMES, GRID

CELLS = GRID**3
COLUMNS = GRID**2
CLASSES = len(CLASS_NAMES)
COLORS = CLASSES // 2
FLOOR = 1e-4
"""Least probability of anything, so that logarithms and quotients stay finite."""


@dataclass(frozen=True)
class SoftLayout:
    """Probabilities of standing and held blocks; cells are numbered as `Cell.index`.

    Attributes:
        heights: Of each number of standing blocks (0 to 8) in each column (8 x + y).
        classes: Of the 16 classes, given that the cell is filled.
        held: Of the held block being in the cell; sums up to the probability of holding.
        holding: Of a block being held.
    """

    heights: Float[Tensor, "b 64 9"]
    classes: Float[Tensor, "b 512 16"]
    held: Float[Tensor, "b 512"]
    holding: Float[Tensor, " b"]

    @property
    def standing(self) -> Float[Tensor, "b 512"]:
        """Whether a cell is filled by a standing block."""
        above = self.heights.flip(2).cumsum(2).flip(2)[:, :, 1:]
        return above.flatten(1).clamp(0, 1)

    @property
    def top(self) -> Float[Tensor, "b 512"]:
        """Whether a cell holds the uppermost standing block of its column."""
        return self.heights[:, :, 1:].flatten(1)

    @property
    def landing(self) -> Float[Tensor, "b 512"]:
        """Whether a cell is where a block put into its column can rest: not on a prism."""
        prism = self.classes[:, :, COLORS:].sum(2).unflatten(1, (COLUMNS, GRID))
        flat = 1 - torch.nn.functional.pad(prism, (1, 0))[:, :, :GRID]
        return (self.heights[:, :, :GRID] * flat).flatten(1)

    def select(self, rows: Tensor) -> "SoftLayout":
        """The layouts of some rows of the batch, in their order."""
        return SoftLayout(
            self.heights[rows], self.classes[rows], self.held[rows], self.holding[rows]
        )


def soft_layout(occupancy: Float[Tensor, "b 8 8 8 17"], holding: Float[Tensor, " b"]) -> SoftLayout:
    """The most plausible soft layout behind a reader's probabilities.

    For a column with filling probabilities f, height h has the weight
    prod_{z<h} f_z prod_{z>=h} (1 - f_z); with a held block at z >= h the factor
    1 - f_z becomes f_z. If a block is held, it hangs in exactly one column.

    Args:
        occupancy: Probabilities of the 16 classes of `CLASS_NAMES` and of emptiness.
        holding: Probability that the gripper holds a block.
    """
    cells = occupancy.reshape(-1, COLUMNS, GRID, CLASSES + 1)
    filled = (1 - cells[..., CLASSES]).clamp(FLOOR, 1 - FLOOR)
    log_filled, log_empty = filled.log(), (-filled).log1p()
    zero = torch.zeros_like(filled[:, :, :1])
    below = torch.cat([zero, log_filled.cumsum(2)], dim=2)
    above = torch.cat([log_empty.flip(2).cumsum(2).flip(2), zero], dim=2)
    weights = below + above
    hanging = weights[..., None] + (log_filled - log_empty)[:, :, None]
    height, level = torch.arange(GRID + 1), torch.arange(GRID)
    impossible = (level[None] < height[:, None]).to(filled.device)
    hanging = hanging.masked_fill(impossible, -1e4)
    odds = hanging.flatten(2).logsumexp(2) - weights.logsumexp(2)
    column = odds.softmax(1) * holding[:, None]
    joint = hanging.flatten(2).softmax(2).view_as(hanging)
    held = column[..., None] * joint.sum(2)
    heights = (1 - column)[..., None] * weights.softmax(2) + column[..., None] * joint.sum(3)
    return SoftLayout(
        heights=heights,
        classes=_classes(cells[..., :CLASSES], heights).flatten(1, 2),
        held=held.flatten(1),
        holding=holding,
    )


def _classes(
    masses: Float[Tensor, "b 64 8 16"], heights: Float[Tensor, "b 64 9"]
) -> Float[Tensor, "b 64 8 16"]:
    """Classes of filled cells, knowing that a prism is never covered by a standing block."""
    above = heights.flip(2).cumsum(2).flip(2)
    standing, higher = above[:, :, 1:], torch.nn.functional.pad(above[:, :, 2:], (0, 1))
    covered = (higher / standing.clamp(min=FLOOR)).clamp(0, 1 - FLOOR)
    cubes, prisms = masses.split(COLORS, dim=3)
    # A cell read as a prism though covered is more likely a cube of the same colour.
    moved = prisms * covered[..., None]
    likely = torch.cat([cubes + moved, prisms - moved], dim=3) + FLOOR / CLASSES
    return likely / likely.sum(3, keepdim=True)
