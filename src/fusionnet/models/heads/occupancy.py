"""Which block is in which of the 512 cells, and whether the gripper holds one.

The thesis never tried this intermediate representation. In the compact FusionNet each
cell's front, top and sides are projected into the picture with the estimated camera, the
features there are gathered, and three-dimensional convolutions let cells reason about what
hides what and what must stand below.
"""

from collections.abc import Sequence

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
    ) -> None:
        super().__init__()
        self.input_size = input_size
        points = cell_points()
        self.points_a_cell = points.shape[1]
        self.register_buffer("points", points.reshape(-1, 3), persistent=False)
        self.squeeze = nn.Conv2d(fine_channels, gathered, 1)
        self.embed = nn.Linear(gathered * self.points_a_cell, width)
        self.detail = self.embed_detail = None
        if detail:
            self.detail = nn.Conv2d(stem_channels, detail, 1)
            self.embed_detail = nn.Linear(detail * self.points_a_cell, width, bias=False)
            nn.init.zeros_(self.embed_detail.weight)
        self.context = nn.Linear(coarse_channels, width)
        self.position = nn.Parameter(torch.zeros(GRID**3, width))
        self.reason = nn.ModuleList(
            nn.Sequential(
                GridConvolution(width, width, bias=False),
                nn.BatchNorm3d(width),
                nn.ReLU(inplace=True),
                GridConvolution(width, width),
            )
            for _ in range(blocks)
        )
        for block in self.reason:  # each begins as the identity
            assert isinstance(block, nn.Sequential)
            for parameter in block[-1].parameters():
                nn.init.zeros_(parameter)
        self.classify = nn.Linear(width, EMPTY + 1)
        self.hold = nn.Linear(2 * width, 1)

    points: Tensor

    def forward(
        self,
        fine: Float[Tensor, "b _ h w"],
        coarse: Float[Tensor, "b _ h2 w2"],
        pixels: Float[Tensor, "b n 2"],
        stem: Float[Tensor, "b _ h3 w3"] | None = None,
    ) -> tuple[Float[Tensor, "b 512 17"], Float[Tensor, " b"]]:
        """Logits of the classes a cell, and of a held block.

        Args:
            fine: Fine feature map.
            coarse: Coarse feature map.
            pixels: Where `points` appear in the network's input.
            stem: The map at stride 2, if details are gathered.
        """
        batch = len(fine)
        cells = self.embed(self._gather(self.squeeze(fine), pixels))
        if self.detail is not None and self.embed_detail is not None:
            cells = cells + self.embed_detail(self._gather(self.detail(stem), pixels))
        around = self.context(coarse.mean(dim=(2, 3)))
        x = nn.functional.relu(cells + self.position + around[:, None])
        x = x.transpose(1, 2).reshape(batch, -1, GRID, GRID, GRID)
        for block in self.reason:
            x = nn.functional.relu(x + block(x))
        x = x.flatten(2).transpose(1, 2)
        held = self.hold(torch.cat([x.amax(dim=1), around], dim=1))[:, 0]
        return self.classify(x), held

    def _gather(self, features: Tensor, pixels: Tensor) -> Float[Tensor, "b 512 _"]:
        """The features at all points of each cell."""
        gathered = sample(features, pixels, self.input_size)
        cells = gathered.view(*gathered.shape[:2], GRID**3, self.points_a_cell)
        return cells.permute(0, 2, 1, 3).flatten(2)

    def losses(
        self,
        outputs: tuple[Float[Tensor, "b 512 17"], Float[Tensor, " b"]],
        cells: Int[Tensor, "b 512"],
        visible: Int[Tensor, "b 512"],
        holding: Float[Tensor, " b"],
    ) -> dict[str, Tensor]:
        """`occupancy`: cross-entropy summed over a picture's cells; `holding`: binary.

        Blocks of which a `SLIVER` peeps out count `SLIVER_WEIGHT` times: they are few, and those
        that are wholly hidden, of which nothing can be learnt, would drown them.
        """
        logits, held = outputs
        entropy = nn.functional.cross_entropy(
            logits.flatten(0, 1), cells.flatten(), reduction="none"
        )
        sliver = (cells != EMPTY) & (visible >= SLIVER[0]) & (visible < SLIVER[1])
        weighted = entropy * torch.where(sliver.flatten(), SLIVER_WEIGHT, 1.0)
        return {
            "occupancy": weighted.sum() / len(cells),
            "holding": nn.functional.binary_cross_entropy_with_logits(held, holding),
        }


def cell_points() -> Float[Tensor, "512 22 3"]:
    """Points of the board frame [m] on each cell: 3x3 on front and top, 2 on each side."""
    low, middle, high = 0.12, 0.5, 0.88
    steps = torch.tensor([low, middle, high])
    one, two = torch.cartesian_prod(steps, steps).unbind(1)
    front = torch.stack([torch.zeros(9), one, two], dim=1)
    top = torch.stack([one, two, torch.ones(9)], dim=1)
    sides = torch.tensor([[middle, side, height] for side in (0.0, 1.0) for height in (0.25, 0.75)])
    offsets = torch.cat([front, top, sides])
    axis = torch.arange(GRID)
    corner = torch.cartesian_prod(axis, axis, axis)
    return (corner[:, None] + offsets[None]) * BLOCK_SIZE


class OccupancyHead(Head):
    """The occupancy as a representation of the thesis's FusionNet, which never tried it.

    A level of the pyramid is brought to 8x8 places, one for each column of the grid as it
    lies in the picture; convolutions move what they know to where it belongs.
    """

    columns = ("block_cells", "block_classes")

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
