"""Which block is in which of the 512 cells, and whether the gripper holds one.

The thesis never tried this intermediate representation. In the compact FusionNet each
cell's front, top and sides are projected into the picture with the estimated camera, the
features there are gathered, and three-dimensional convolutions let cells reason about what
hides what and what must stand below. With what they found a second look is taken: from each
point a ray goes to the camera through the cells that seem to be filled, and what is gathered
counts by how much of the point can be seen.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.backends import mkldnn

from fusionnet.blocks import BLOCK_SIZE, EMPTY, GRID
from fusionnet.errors import InputError
from fusionnet.models.heads._head import Example, Features, Head, Shapes
from fusionnet.models.heads.camera_pose import sample

SLIVER = (12, 250)
"""Pixels of the eye's picture, of 1,500 or so, by which a block is seen that others nearly hide."""

SLIVER_WEIGHT = 4.0
"""How often such a block counts in the loss."""

FIRST_POINTS = ((0.12, 0.5, 0.88), (0.5,), (0.25, 0.75))
"""Where a cell is looked at, in cells: on front and top; on its sides in depth and in height."""

SECOND_POINTS = ((0.05, 0.275, 0.5, 0.725, 0.95), (0.2, 0.8), (0.15, 0.5, 0.85))
"""The same for the second look, which is to find strips two pixels wide."""

RAY = (0.1, 0.35, 24)
"""First step of a ray from a point to the camera, step, and number of them, in cells."""


OFFSET_PIXELS = 30
"""Least visible pixels of a block whose offset is learnt."""

LIKELY = 0.05
"""Least probability of a block in a cell of which an offset is asked."""

TURN = 0.026
"""Unit of a block's turn about the vertical, in radians: what it is off by, as a rule."""


class GridConvolution(nn.Conv3d):
    """A three-dimensional convolution of 3x3x3 cells that takes a third of the time for one grid.

    PyTorch leaves what has few rows to a slow implementation of its own; a batch goes to oneDNN.
    """

    def __init__(self, source: int, target: int, *, bias: bool = True) -> None:
        super().__init__(source, target, 3, padding=1, bias=bias)

    def forward(self, x: Float[Tensor, "b c 8 8 8"]) -> Float[Tensor, "b c2 8 8 8"]:
        """The same, by oneDNN where PyTorch would not use it."""
        one_grid = len(x) == 1 and x.device.type == "cpu" and x.dtype == torch.float32
        other = torch.is_grad_enabled() or torch.is_autocast_enabled("cpu")
        if not one_grid or other or torch.compiler.is_compiling() or not mkldnn.is_available():
            return super().forward(x)
        one = (1, 1, 1)
        return torch.mkldnn_convolution(x, self.weight, self.bias, one, one, one, 1)


class CellOutputs(NamedTuple):
    """What `Occupancy` says.

    Attributes:
        looks: Logits of the 17 classes of each cell after every look; the last one counts.
        held: Logits of a held block.
        offsets: Of each cell's block, if there is a second look: how far from the middle of the
            cell it appears, in pixels of the network's input, and its turn, in units of `TURN`;
            0 where there is hardly one.
    """

    looks: tuple[Float[Tensor, "b 512 17"], ...]
    held: Float[Tensor, " b"]
    offsets: Float[Tensor, "b 512 3"] | None = None

    @property
    def logits(self) -> Float[Tensor, "b 512 17"]:
        """Of the 17 classes of each cell, after the last look."""
        return self.looks[-1]


class Occupancy(nn.Module):
    """Probabilities of 17 classes for every cell, and of a held block.

    Args:
        fine_channels: Channels of the fine feature map.
        coarse_channels: Channels of the coarse feature map.
        input_size: Width and height of the network's input, in pixels.
        gathered: Channels gathered at each projected point.
        width: Channels of the three-dimensional convolutions.
        blocks: Residual blocks of three-dimensional convolutions.
        stem_channels: Channels of the backbone's map at stride 2.
        detail: Channels gathered from that map at each projected point; 0 for none.
        second: Residual blocks of the second look; 0 for none.
    """

    def __init__(
        self,
        *,
        fine_channels: int,
        coarse_channels: int,
        input_size: tuple[int, int],
        gathered: int = 32,
        width: int = 64,
        blocks: int = 2,
        stem_channels: int = 0,
        detail: int = 0,
        second: int = 0,
    ) -> None:
        super().__init__()
        self.input_size = input_size
        points, _ = cell_points(*FIRST_POINTS)
        again, normals = cell_points(*SECOND_POINTS)
        self.first_points, self.second_points = points.shape[1], again.shape[1] if second else 0
        points = torch.cat([points, again], dim=1)[:, : self.first_points + self.second_points]
        self.register_buffer("points", points.reshape(-1, 3), persistent=False)
        self.register_buffer("normals", normals, persistent=False)
        middles = (torch.cartesian_prod(*[torch.arange(GRID)] * 3) + 0.5) * BLOCK_SIZE
        self.register_buffer("middles", middles, persistent=False)
        self.squeeze = nn.Conv2d(fine_channels, gathered, 1)
        self.embed = nn.Linear(gathered * self.first_points, width)
        self.detail = self.embed_detail = None
        if detail:
            self.detail = nn.Conv2d(stem_channels, detail, 1)
            self.embed_detail = nn.Linear(detail * self.first_points, width, bias=False)
            nn.init.zeros_(self.embed_detail.weight)
        self.context = nn.Linear(coarse_channels, width)
        self.position = nn.Parameter(torch.zeros(GRID**3, width))
        self.reason = nn.ModuleList(_reasoning(width) for _ in range(blocks))
        self.look = self.look_more = self.offset = None
        if second:
            seen = ((detail or gathered) + 1) * self.second_points
            self.look = nn.Linear(seen, 2 * width)
            self.look_more = nn.Linear(2 * width, width)
            self.offset = nn.Sequential(
                nn.Linear(gathered * self.first_points + seen + width, 4 * width),
                nn.ReLU(inplace=True),
                nn.Linear(4 * width, 2 * width),
                nn.ReLU(inplace=True),
                nn.Linear(2 * width, 3),
            )
            for last in (self.look_more, self.offset[-1]):
                _silence(last)  # it begins as what the first look found
        self.reason_again = nn.ModuleList(_reasoning(width) for _ in range(second))
        self.classify = nn.Linear(width, EMPTY + 1)
        self.hold = nn.Linear(2 * width, 1)

    points: Tensor
    normals: Tensor
    middles: Tensor

    def forward(
        self,
        fine: Float[Tensor, "b _ h w"],
        coarse: Float[Tensor, "b _ h2 w2"],
        pixels: Float[Tensor, "b n 2"],
        stem: Float[Tensor, "b _ h3 w3"] | None,
        viewpoint: Float[Tensor, "b 3"],
    ) -> "CellOutputs":
        """What is said of each cell.

        Args:
            fine: Fine feature map.
            coarse: Coarse feature map.
            pixels: Where `points` appear in the network's input.
            stem: The map at stride 2, if details are gathered.
            viewpoint: Where the camera stands, in the board frame (metres), for a second look.
        """
        first, again = pixels.unflatten(1, (GRID**3, -1)).tensor_split([self.first_points], dim=2)
        maps = self.squeeze(fine)
        coarsely = self._gather(maps, first).flatten(2)
        cells = self.embed(coarsely)
        if self.detail is not None and self.embed_detail is not None:
            maps = self.detail(stem)
            cells = cells + self.embed_detail(self._gather(maps, first).flatten(2))
        around = self.context(coarse.mean(dim=(2, 3)))
        x = nn.functional.relu(cells + self.position + around[:, None])
        x = _reasoned(x, self.reason)
        looks = [self.classify(x)]
        offsets = None
        if self.look is not None and self.look_more is not None and self.offset is not None:
            filled = 1 - looks[0].detach().float().softmax(-1)[..., EMPTY]
            share = self.visibility(filled, viewpoint)[:, :, None]
            seen = torch.cat([self._gather(maps, again) * share, share], dim=2).flatten(2)
            found = nn.functional.relu(self.look(seen))
            x = _reasoned(x + self.look_more(found), self.reason_again)
            looks.append(self.classify(x))
            likely = looks[1].detach().float().softmax(-1)[..., EMPTY] < 1 - LIKELY
            told = torch.cat([part[likely] for part in (coarsely, seen, x)], dim=1)
            offsets = cells.new_zeros(*likely.shape, 3, dtype=torch.float32)
            offsets[likely] = self.offset(told).float()
        held = self.hold(torch.cat([x.amax(dim=1), around], dim=1))[:, 0]
        return CellOutputs(tuple(looks), held, offsets)

    def _gather(
        self, features: Tensor, pixels: Float[Tensor, "b 512 p 2"]
    ) -> Float[Tensor, "b 512 c p"]:
        """The features at points of each cell."""
        gathered = sample(features, pixels.flatten(1, 2), self.input_size)
        return gathered.unflatten(2, (GRID**3, -1)).transpose(1, 2)

    def visibility(
        self, filled: Float[Tensor, "b 512"], viewpoint: Float[Tensor, "b 3"]
    ) -> Float[Tensor, "b 512 p"]:
        """How much of each point of the second look the camera sees past the other cells.

        Sides that are turned away are not seen.

        Args:
            filled: Probability that a cell holds a block.
            viewpoint: Where the camera stands, in the board frame (metres).
        """
        with torch.autocast(filled.device.type, enabled=False):
            first, step, count = RAY
            points = self.points.unflatten(0, (GRID**3, -1))[:, self.first_points :]
            to = viewpoint.float()[:, None, None] - points
            ray = nn.functional.normalize(to, dim=3)
            start = points / BLOCK_SIZE + 1 + first * ray  # a ring of empty cells around
            grid = filled.unflatten(1, (GRID, GRID, GRID))
            padded = nn.functional.pad(grid, (1,) * 6).flatten(1)
            side, hidden = GRID + 2, filled.new_zeros(len(filled), start[0, ..., 0].numel())
            for number in range(count):
                place = torch.add(start, ray, alpha=number * step).clamp(0, side - 1).long()
                x, y, z = place.flatten(1, 2).unbind(2)
                hidden = torch.maximum(hidden, padded.gather(1, (x * side + y) * side + z))
            facing = (to * self.normals).sum(3) > 0
            return (1 - hidden).view_as(facing) * facing

    def losses(
        self,
        outputs: "CellOutputs",
        cells: Int[Tensor, "b 512"],
        visible: Int[Tensor, "b 512"],
        holding: Float[Tensor, " b"],
        offsets: Float[Tensor, "b 512 3"] | None = None,
    ) -> dict[str, Tensor]:
        """`occupancy`: cross-entropy summed over a picture's cells; `holding`: binary.

        Of two looks the first has a loss of its own, `first_look`, and the second one for the
        offsets, `offset`: smooth L1, a mean over the blocks that can be seen.

        Blocks of which a `SLIVER` peeps out count `SLIVER_WEIGHT` times: they are few, and those
        that are wholly hidden, of which nothing can be learnt, would drown them.
        """
        sliver = (cells != EMPTY) & (visible >= SLIVER[0]) & (visible < SLIVER[1])
        weights = torch.where(sliver, SLIVER_WEIGHT, 1.0)
        losses = {
            name: (
                nn.functional.cross_entropy(logits.transpose(1, 2), cells, reduction="none")
                * weights
            ).sum()
            / len(cells)
            for name, logits in zip(
                ("occupancy", "first_look"), reversed(outputs.looks), strict=False
            )
        }
        losses["holding"] = nn.functional.binary_cross_entropy_with_logits(outputs.held, holding)
        if outputs.offsets is not None and offsets is not None:
            seen = ((cells != EMPTY) & (visible >= OFFSET_PIXELS))[..., None]
            wrong = nn.functional.smooth_l1_loss(outputs.offsets, offsets, reduction="none")
            losses["offset"] = (wrong * seen).sum() / seen.sum().clamp(min=1)
        return losses


def _reasoning(width: int) -> nn.Sequential:
    """A residual block of three-dimensional convolutions that begins as the identity."""
    block = nn.Sequential(
        GridConvolution(width, width, bias=False),
        nn.BatchNorm3d(width),
        nn.ReLU(inplace=True),
        GridConvolution(width, width),
    )
    _silence(block[-1])
    return block


def _silence(layer: nn.Module) -> None:
    """Let a layer begin with zeros everywhere."""
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)


def _reasoned(x: Float[Tensor, "b 512 c"], blocks: nn.ModuleList) -> Float[Tensor, "b 512 c"]:
    """What cells make of one another."""
    x = x.transpose(1, 2).unflatten(2, (GRID, GRID, GRID))
    for block in blocks:
        x = nn.functional.relu(x + block(x))
    return x.flatten(2).transpose(1, 2)


def cell_points(
    across: Sequence[float], depths: Sequence[float], heights: Sequence[float]
) -> tuple[Float[Tensor, "512 p 3"], Float[Tensor, "p 3"]]:
    """Points of the board frame [m] on each cell, and which way its surface is turned there.

    Args:
        across: Where they lie on front and top, in both directions, in cells.
        depths: Where on each of the two sides, from the front.
        heights: Where on each side, from below.
    """
    one, two = torch.cartesian_prod(*[torch.tensor(across)] * 2).unbind(1)
    front = torch.stack([torch.zeros_like(one), one, two], dim=1)
    top = torch.stack([one, two, torch.ones_like(one)], dim=1)
    places = [torch.tensor(v) for v in (depths, (0.0, 1.0), heights)]
    sides = torch.cartesian_prod(*places)
    normals = torch.cat(
        [
            torch.tensor([-1.0, 0.0, 0.0]).expand_as(front),
            torch.tensor([0.0, 0.0, 1.0]).expand_as(top),
            torch.tensor([0.0, 2.0, 0.0]) * (sides - 0.5),
        ]
    )
    offsets = torch.cat([front, top, sides])
    axis = torch.arange(GRID)
    corner = torch.cartesian_prod(axis, axis, axis)
    return (corner[:, None] + offsets[None]) * BLOCK_SIZE, normals


class OccupancyHead(Head):
    """The occupancy as a representation of the thesis's FusionNet, which never tried it.

    A level of the pyramid is brought to 8x8 places, one for each column of the grid as it
    lies in the picture; convolutions move what they know to where it belongs.
    """

    columns = ("block_cells", "block_classes")
    needs_pyramid = True

    def __init__(self, shapes: Shapes) -> None:
        super().__init__(shapes)
        if not shapes.channels:
            raise InputError("The occupancy is read from a pyramid; this vision has none.")
        self.level = min(1, len(shapes.strides) - 1)
        width = shapes.channels
        self.columns_of = nn.Sequential(
            nn.AdaptiveAvgPool2d(2 * GRID),
            nn.Conv2d(width, width, 3, padding=1, stride=2),
            nn.ReLU(inplace=True),
            nn.Conv2d(width, width, 3, padding=1),
            nn.ReLU(inplace=True),
        )
        self.place = nn.Parameter(torch.zeros(width, GRID, GRID))
        self.classify = nn.Conv2d(width, GRID * (EMPTY + 1), 1)

    @staticmethod
    def target(example: Example) -> Int[Tensor, " 512"]:
        """The class in each cell; `EMPTY` where none is."""
        cells = torch.full((GRID**3,), EMPTY)
        cells[torch.tensor(example.sample["block_cells"], dtype=torch.long)] = torch.tensor(
            example.sample["block_classes"], dtype=torch.long
        )
        return cells

    def forward(self, features: Features) -> Float[Tensor, "b 512 17"]:
        """Logits of the classes a cell."""
        # the lower right of the picture is cell (0, 0), where x and y are least
        columns = self.columns_of(features.levels[self.level]).flip(2, 3) + self.place
        logits = self.classify(columns).unflatten(1, (GRID, EMPTY + 1))
        return logits.permute(0, 3, 4, 1, 2).flatten(1, 3)

    def loss(
        self,
        output: Float[Tensor, "b 512 17"],
        targets: Sequence[Int[Tensor, " 512"]],
        features: Features,
    ) -> Tensor:
        """Cross-entropy, a mean over the cells."""
        wanted = torch.stack(list(targets))
        return nn.functional.cross_entropy(output.flatten(0, 1).float(), wanted.flatten())

    def predict(self, output: Float[Tensor, "b 512 17"]) -> list[Int[Tensor, " 512"]]:
        """The likeliest class of each cell."""
        return list(output.argmax(dim=-1).cpu())

    @staticmethod
    def metric(
        found: Sequence[Int[Tensor, " 512"]], truth: Sequence[Int[Tensor, " 512"]]
    ) -> dict[str, float]:
        """`blocks_right`: share of the blocks whose cell holds the right class."""
        seen, true = torch.stack(list(found)), torch.stack(list(truth))
        blocks = true != EMPTY
        return {"blocks_right": float((seen == true)[blocks].float().mean())}


HEAD = OccupancyHead
