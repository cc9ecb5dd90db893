"""Where the eye was when it took the picture: six degrees of freedom and the focal length.

The head knows the robot's nominal camera and regresses the small deviation from it
in two steps: a coarse one from the whole picture, then one from the fine features
sampled where the coarse pose expects the corners of the checkerboard.
"""

import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fusionnet.blocks import BLOCK_SIZE, GRID

PARAMETERS = 7
"""Rotation vector [0.02 rad], translation [0.01 m], log of the focal length [0.02]."""

UNITS = (0.02, 0.02, 0.02, 0.01, 0.01, 0.01, 0.02)


class CameraPose(nn.Module):
    """Regress the deviation of the camera from its nominal pose.

    Args:
        matrix: Nominal intrinsics (3x3) in pixels of the network's input.
        camera_from_board: Nominal pose (4x4), OpenCV axes.
        input_size: Width and height of the network's input, in pixels.
        fine_channels: Channels of the fine feature map.
        coarse_channels: Channels of the coarse feature map.
        coarse_stride: Pixels of the input a cell of the coarse map.
    """

    def __init__(
        self,
        *,
        matrix: list[list[float]],
        camera_from_board: list[list[float]],
        input_size: tuple[int, int],
        fine_channels: int,
        coarse_channels: int,
        coarse_stride: int,
    ) -> None:
        super().__init__()
        self.register_buffer("matrix", torch.tensor(matrix), persistent=False)
        self.register_buffer("nominal", torch.tensor(camera_from_board), persistent=False)
        self.register_buffer("units", torch.tensor(UNITS), persistent=False)
        self.register_buffer("landmarks", _landmarks(), persistent=False)
        self.register_buffer("corners", _volume_corners(), persistent=False)
        self.input_size = input_size
        width, height = (math.ceil(side / coarse_stride) for side in input_size)
        self.coarse = nn.Sequential(
            nn.Conv2d(coarse_channels, 16, 1),
            nn.ReLU(inplace=True),
            nn.Flatten(),
            nn.Linear(16 * width * height, 128),
            nn.ReLU(inplace=True),
            nn.Linear(128, PARAMETERS),
        )
        self.squeeze = nn.Conv2d(fine_channels, 16, 1)
        self.refine = nn.Sequential(
            nn.Linear(16 * len(self.landmarks) + PARAMETERS, 192),
            nn.ReLU(inplace=True),
            nn.Linear(192, PARAMETERS),
        )

    matrix: Tensor
    nominal: Tensor
    units: Tensor
    landmarks: Tensor
    corners: Tensor

    def forward(
        self, fine: Float[Tensor, "b _ h w"], coarse: Float[Tensor, "b _ h2 w2"]
    ) -> list[Float[Tensor, "b 7"]]:
        """Deviation after the coarse and after the fine step, in `UNITS`.

        In full precision also where the rest is trained in half of it: a thousandth counts.
        """
        with torch.autocast(fine.device.type, enabled=False):
            return self._estimate(fine.float(), coarse.float())

    def _estimate(self, fine: Tensor, coarse: Tensor) -> list[Tensor]:
        first = self.coarse(coarse)
        squeezed = self.squeeze(fine)
        pixels = self.project(first.detach(), self.landmarks)
        sampled = sample(squeezed, pixels, self.input_size)
        second = first.detach() + self.refine(
            torch.cat([sampled.flatten(1), first.detach()], dim=1)
        )
        return [first, second]

    def project(
        self,
        deviation: Float[Tensor, "b 7"],
        points: Float[Tensor, "n 3"] | Float[Tensor, "b n 3"],
    ) -> Float[Tensor, "b n 2"]:
        """Pixels (column, row) of the network's input where points of the board frame appear.

        Points are the same for all pictures, or each picture's own.
        """
        with torch.autocast(deviation.device.type, enabled=False):
            return self._project(deviation.float(), points)

    def _project(self, deviation: Tensor, points: Tensor) -> Tensor:
        scaled = deviation * self.units
        rotation = _rotation(scaled[:, :3])
        nominal = points @ self.nominal[:3, :3].T + self.nominal[:3, 3]
        moved = nominal @ rotation.transpose(1, 2) + scaled[:, None, 3:6]
        ratio = moved[..., :2] / moved[..., 2:].clamp(min=1e-3)
        focal = torch.stack([self.matrix[0, 0], self.matrix[1, 1]]) * scaled[:, None, 6:].exp()
        return ratio * focal + self.matrix[:2, 2]

    def viewpoint(self, deviation: Float[Tensor, "b 7"]) -> Float[Tensor, "b 3"]:
        """Where the camera stands, in the board frame, in metres."""
        scaled = deviation.float() * self.units
        turned = _rotation(scaled[:, :3])
        rotation = turned @ self.nominal[:3, :3]
        moved = turned @ self.nominal[:3, 3] + scaled[:, 3:6]
        return -(rotation.transpose(1, 2) @ moved[..., None])[..., 0]

    def camera(
        self, deviation: Float[Tensor, "1 7"]
    ) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "4 4"]]:
        """Intrinsics for the network's input, and `camera_from_board`, of one deviation."""
        scaled = (deviation.float() * self.units)[0]
        moved = torch.eye(4)
        moved[:3, :3] = _rotation(scaled[None, :3])[0]
        moved[:3, 3] = scaled[3:6]
        matrix = self.matrix.clone()
        matrix[0, 0], matrix[1, 1] = torch.diag(self.matrix)[:2] * scaled[6].exp()
        return matrix.double().numpy(), (moved @ self.nominal).double().numpy()

    def target(
        self, matrix: Float[Tensor, "b 3 3"], camera_from_board: Float[Tensor, "b 4 4"]
    ) -> Float[Tensor, "b 7"]:
        """The deviation, in `UNITS`, that turns the nominal camera into the given one."""
        rotation = camera_from_board[:, :3, :3] @ self.nominal[:3, :3].T
        angle_axis = _rotation_vector(rotation)
        offset = camera_from_board[:, :3, 3] - (rotation @ self.nominal[:3, 3])
        focal = (matrix[:, 0, 0] / self.matrix[0, 0]).log()
        return torch.cat([angle_axis, offset, focal[:, None]], dim=1) / self.units

    def losses(
        self, outputs: list[Float[Tensor, "b 7"]], target: Float[Tensor, "b 7"]
    ) -> dict[str, Tensor]:
        """`pose`: smooth L1 of the reprojected corners of the grid, in pixels, both steps."""
        truth = self.project(target, self.corners)
        errors = [
            nn.functional.smooth_l1_loss(self.project(out, self.corners), truth, beta=2.0)
            for out in outputs
        ]
        return {"pose": torch.stack(errors).sum()}

    @torch.no_grad()
    def metric(
        self, outputs: list[Float[Tensor, "b 7"]], target: Float[Tensor, "b 7"]
    ) -> Float[Tensor, " b"]:
        """Mean distance of the grid's reprojected corners from the truth, in input pixels."""
        truth = self.project(target, self.corners)
        return (self.project(outputs[-1], self.corners) - truth).norm(dim=-1).mean(dim=1)


def sample(
    features: Float[Tensor, "b c h w"],
    pixels: Float[Tensor, "b n 2"],
    input_size: tuple[int, int],
) -> Float[Tensor, "b c n"]:
    """Features at pixels of the input, bilinear, zero outside of the picture.

    In full precision: half of it would displace the pixels.
    """
    size = torch.tensor(input_size, dtype=torch.float32, device=features.device)
    grid = (pixels.float() / size * 2 - 1)[:, None]
    return nn.functional.grid_sample(features.float(), grid, align_corners=False)[:, :, 0]


def _landmarks() -> Float[Tensor, "n 3"]:
    """The 81 corners of the checkerboard's squares, in the board frame, in metres."""
    steps = torch.arange(GRID + 1) * BLOCK_SIZE
    plane = torch.cartesian_prod(steps, steps)
    return torch.cat([plane, torch.zeros(len(plane), 1)], dim=1)


def _volume_corners() -> Float[Tensor, "8 3"]:
    """The corners of the lower half of the grid's volume, where most blocks are."""
    ends = torch.tensor([0.0, GRID * BLOCK_SIZE])
    return torch.cartesian_prod(ends, ends, ends / 2)


def _rotation(vector: Float[Tensor, "b 3"]) -> Float[Tensor, "b 3 3"]:
    """The rotations about `vector` by its length (Rodrigues' formula), smooth also at zero."""
    angle = (vector.square().sum(dim=1) + 1e-12).sqrt()[:, None, None] / torch.pi
    cross = _cross_matrix(vector)
    unit = torch.eye(3, device=vector.device, dtype=vector.dtype)
    return unit + torch.sinc(angle) * cross + 0.5 * torch.sinc(angle / 2) ** 2 * cross @ cross


def _cross_matrix(vector: Float[Tensor, "b 3"]) -> Float[Tensor, "b 3 3"]:
    x, y, z = vector.unbind(1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).view(-1, 3, 3)


def _rotation_vector(rotation: Float[Tensor, "b 3 3"]) -> Float[Tensor, "b 3"]:
    """Logarithm of small rotations (well below half a turn)."""
    skew = torch.stack(
        [
            rotation[:, 2, 1] - rotation[:, 1, 2],
            rotation[:, 0, 2] - rotation[:, 2, 0],
            rotation[:, 1, 0] - rotation[:, 0, 1],
        ],
        dim=1,
    )
    sine = skew.norm(dim=1, keepdim=True) / 2
    factor = torch.where(sine > 1e-6, torch.asin(sine.clamp(max=1.0)) / sine.clamp(min=1e-6), 1.0)
    return skew / 2 * factor
