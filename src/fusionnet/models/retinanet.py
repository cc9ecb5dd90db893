"""RetinaNet with two more heads: boxes and classes, the camera's pose, the occupancy of cells.

One backbone feeds a small feature pyramid; every head reads from it. The pose head
tells the occupancy head where each cell appears in the picture.

References:
    Lin et al. (2017), Focal loss for dense object detection; thesis, section 4.1.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor, nn

from fusionnet.dataset.frame import PictureFrame
from fusionnet.models import backbones
from fusionnet.models.checkpoint import load_checkpoint, restore, save_checkpoint
from fusionnet.models.heads.boxes import BoxConfig, Boxes, BoxHead
from fusionnet.models.heads.camera_pose import CameraPose
from fusionnet.models.heads.occupancy import Occupancy

KIND = "retinanet"


@dataclass  # not frozen: Fabric moves its tensors between devices
class Batch:
    """Pictures and everything that the heads learn from them.

    Attributes:
        images: Network inputs, 0 to 255.
        boxes: Ground truth of each picture, in pixels of the input.
        cells: Class of each of the 512 cells (16 is empty).
        holding: 1 where the gripper holds a block.
        matrix: Intrinsics for the input.
        camera_from_board: Pose of the camera.
        disturbance: Added to the true deviation when cells are projected while training.
    """

    images: UInt8[Tensor, "b h w 3"]
    boxes: list[Boxes]
    cells: Int[Tensor, "b 512"]
    holding: Float[Tensor, " b"]
    matrix: Float[Tensor, "b 3 3"]
    camera_from_board: Float[Tensor, "b 4 4"]
    disturbance: Float[Tensor, "b 7"]


@dataclass(frozen=True)
class Sight:
    """What the network sees in one picture.

    Attributes:
        boxes: Detections, in pixels of the eye's picture.
        cells: Probabilities of the 17 classes for each cell of the grid.
        holding: Probability that the gripper holds a block.
        corners: Where the corners of the checkerboard appear, in pixels of the eye's picture.
    """

    boxes: Boxes
    cells: Float[np.ndarray, "8 8 8 17"]
    holding: float
    corners: Float[np.ndarray, "81 2"]


class RetinaNet(nn.Module):
    """Backbone, pyramid and heads; the same class for training and for inference.

    Args:
        frame: Which part of the eye's picture is seen, at which size.
        matrix: Nominal intrinsics of the eye (3x3), in pixels of the eye's picture.
        camera_from_board: Nominal pose of the eye (4x4), OpenCV axes.
        backbone: Name in `models.backbones`.
        width: Channels of the pyramid.
        boxes: Anchors and subnets of the box head, as JSON has them.
    """

    def __init__(
        self,
        *,
        frame: PictureFrame,
        matrix: list[list[float]],
        camera_from_board: list[list[float]],
        backbone: str = "small",
        width: int = 48,
        boxes: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.frame = frame
        box_config = BoxConfig(**(boxes or {}))
        self.config: dict[str, Any] = {
            "frame": frame.as_dict(),
            "matrix": matrix,
            "camera_from_board": camera_from_board,
            "backbone": backbone,
            "width": width,
            "boxes": asdict(box_config),
        }
        self.backbone = backbones.load(backbone)()
        fine, middle, coarse = self.backbone.channels
        self.lateral = nn.ModuleList(nn.Conv2d(c, width, 1) for c in (fine, middle, coarse))
        self.smooth = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for _ in range(2))
        size = frame.input_size
        self.box_head = BoxHead(channels=width, config=box_config)
        self.pose_head = CameraPose(
            matrix=frame.matrix(np.array(matrix)).tolist(),
            camera_from_board=camera_from_board,
            input_size=size,
            fine_channels=width,
            coarse_channels=coarse,
            coarse_stride=self.backbone.strides[-1],
        )
        self.occupancy_head = Occupancy(
            fine_channels=width, coarse_channels=coarse, input_size=size
        )

    def forward(
        self,
        images: UInt8[Tensor, "b h w 3"],
        deviation: Float[Tensor, "b 7"] | None = None,
    ) -> dict[str, Any]:
        """Raw outputs of the heads: `boxes`, `pose`, `occupancy`.

        Args:
            images: Network inputs, 0 to 255.
            deviation: Camera poses to project cells with, instead of the estimated ones.
        """
        x = images.permute(0, 3, 1, 2).float().div(127.5).sub(1.0)
        x = x.contiguous(memory_format=torch.channels_last)
        fine, middle, coarse = self.backbone(x)
        top = self.lateral[2](coarse)
        middle = self.smooth[1](self.lateral[1](middle) + _grow(top, middle))
        fine = self.smooth[0](self.lateral[0](fine) + _grow(middle, fine))
        levels = {4: fine, 8: middle, 16: top}
        pose = self.pose_head(fine, coarse)
        used = pose[-1].detach() if deviation is None else deviation
        pixels = self.pose_head.project(used, self.occupancy_head.points)
        return {
            "boxes": self.box_head(
                [levels[stride] for stride in self.box_head.config.strides],
                (images.shape[1], images.shape[2]),
            ),
            "pose": pose,
            "occupancy": self.occupancy_head(fine, coarse, pixels),
        }

    def losses(self, outputs: Mapping[str, Any], batch: Batch) -> dict[str, Tensor]:
        """The heads' named losses: class, box, pose, occupancy, holding."""
        target = self.pose_head.target(batch.matrix, batch.camera_from_board)
        return {
            **self.box_head.losses(outputs["boxes"], batch.boxes),
            **self.pose_head.losses(outputs["pose"], target),
            **self.occupancy_head.losses(outputs["occupancy"], batch.cells, batch.holding),
        }

    def see(self, image: UInt8[np.ndarray, "h w 3"]) -> Sight:
        """Everything that the network reads from one picture of the eye, of any size."""
        return self.see_prepared(self.frame.prepare(image))

    @torch.inference_mode()
    def see_prepared(self, picture: UInt8[np.ndarray, "h w 3"]) -> Sight:
        """The same from a picture that is cropped and sized as the network's input."""
        outputs = self(torch.from_numpy(picture)[None])
        boxes = self.box_head.predict(outputs["boxes"])[0]
        xyxy = self.frame.to_eye(boxes.xyxy.double().numpy())
        logits, held = outputs["occupancy"]
        corners = self.pose_head.project(outputs["pose"][-1], self.pose_head.landmarks)[0]
        scale, offset = self.frame.scale, np.array(self.frame.crop[:2])
        return Sight(
            boxes=Boxes(torch.from_numpy(xyxy), boxes.classes, boxes.scores),
            cells=logits[0].softmax(-1).double().numpy().reshape(8, 8, 8, -1),
            holding=float(held[0].sigmoid()),
            corners=corners.double().numpy() / scale + offset,
        )

    def save(self, folder: Path, metadata: Mapping[str, Any], *, half: bool = True) -> None:
        """Write a checkpoint folder."""
        tensors = self.state_dict()
        save_checkpoint(
            folder, kind=KIND, config=self.config, tensors=tensors, metadata=metadata, half=half
        )

    @classmethod
    def from_folder(cls, folder: Path) -> "RetinaNet":
        """Read a checkpoint folder.

        Raises:
            CheckpointError: If it is missing, damaged, or of another kind or version.
        """
        checkpoint = load_checkpoint(folder, KIND)
        config = dict(checkpoint.config)
        model = cls(frame=PictureFrame.from_dict(config.pop("frame")), **config)
        restore(model, checkpoint.tensors, folder)
        return model.eval()


def _grow(features: Tensor, like: Tensor) -> Tensor:
    return nn.functional.interpolate(features, size=like.shape[-2:], mode="nearest")
