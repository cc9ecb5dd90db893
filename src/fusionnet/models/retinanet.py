"""RetinaNet: one backbone, a feature pyramid, and the heads that a configuration asks for.

The thesis's has boxes with classes and the nodes for FusionNet (4.1.1). The compact one has
boxes and, in place of the nodes, the camera's pose and the occupancy of the cells; the pose
tells the occupancy head where each cell appears in the picture. The same class is trained
and used; presets are in `models.detectors`.

References:
    Lin et al. (2017), Focal loss for dense object detection; thesis, sections 2.1.10 and 4.1.
"""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from fusionnet.errors import CheckpointError, InputError
from fusionnet.geometry import PinholeCamera
from fusionnet.models import backbones
from fusionnet.models.board_corners import refined_pose
from fusionnet.models.checkpoint import load_checkpoint, restore, save_checkpoint
from fusionnet.models.detectors import RetinaNetConfig
from fusionnet.models.heads.boxes import Boxes, BoxHead
from fusionnet.models.heads.camera_pose import CameraPose
from fusionnet.models.heads.fusion_nodes import FusionNodes
from fusionnet.models.heads.occupancy import TURN, Occupancy
from fusionnet.models.projected_boxes import IN_THE_MIDDLE, projected_boxes, with_leftovers
from fusionnet.models.pyramid import FeaturePyramid, initialise, level_strides
from fusionnet.models.sight import Batch, BoxBatch, Sight

KIND = "retinanet"

__all__ = ["Batch", "BoxBatch", "RetinaNet", "Sight"]


class RetinaNet(nn.Module):
    """Backbone, pyramid and heads; the same class for training and for inference.

    Args:
        config: What it is made of; presets are in `models.detectors`.

    Raises:
        InputError: If the backbone lacks what the configuration asks of it.
    """

    def __init__(self, config: RetinaNetConfig) -> None:
        super().__init__()
        self.config = config
        self.frame = config.frame
        self.backbone = backbones.load(config.backbone)()
        _check_backbone(self.backbone, config)
        channels, strides, width = self.backbone.channels, self.backbone.strides, config.width
        if config.pyramid == "small":
            self.strides = tuple(strides)
            self.lateral = nn.ModuleList(nn.Conv2d(c, width, 1) for c in channels)
            self.smooth = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for _ in range(2))
        else:
            self.strides = level_strides(strides)
            self.pyramid = FeaturePyramid(channels, width)
        missing = sorted(set(config.boxes.strides) - set(self.strides))
        if missing:
            raise InputError(
                f"The backbone {config.backbone!r} with the pyramid {config.pyramid!r} has levels "
                f"of strides {self.strides}; the box head asks for {missing}."
            )
        self.box_head = BoxHead(channels=width, config=config.boxes)
        self.fusion_head = None
        if config.fusion_nodes:
            self.fusion_head = FusionNodes(
                channels=width, boxes=config.boxes, nodes=config.fusion_nodes
            )
        self.pose_head: CameraPose = None  # type: ignore[assignment]
        self.occupancy_head: Occupancy = None  # type: ignore[assignment]
        if config.reads_layouts:
            self._add_layout_heads(channels[-1], strides[-1])
        if config.gaussian:
            for part in (self.pyramid, self.box_head, self.fusion_head):
                if part is not None:
                    initialise(part)
            self.box_head.expect_few()
        if config.frozen:
            backbones.freeze_normalisation(self.backbone)

    def _add_layout_heads(self, channels: int, stride: int) -> None:
        config, size = self.config, self.config.frame.input_size
        matrix, pose = config.matrix, config.camera_from_board
        assert matrix is not None and pose is not None
        self.pose_head = CameraPose(
            matrix=config.frame.matrix(np.array(matrix)).tolist(),
            camera_from_board=[list(row) for row in pose],
            input_size=size,
            fine_channels=config.width,
            coarse_channels=channels,
            coarse_stride=stride,
        )
        self.occupancy_head = Occupancy(
            fine_channels=config.width,
            coarse_channels=channels,
            input_size=size,
            blocks=config.reasoning,
            stem_channels=self.backbone.stem_channels if config.detail else 0,
            detail=config.detail,
            second=config.second_look,
        )

    def train(self, mode: bool = True) -> "RetinaNet":
        """Change to training; a pretrained backbone keeps its normalisation as it is."""
        super().train(mode)
        if self.config.frozen:
            backbones.freeze_normalisation(self.backbone)
        return self

    def forward(
        self,
        images: UInt8[Tensor, "b h w 3"],
        deviation: Float[Tensor, "n 7"] | None = None,
        *,
        fusion: bool = True,
        refine: bool = False,
    ) -> dict[str, Any]:
        """Raw outputs of the heads that there are: `boxes`, `fusion`, `pose`, `cells`, and the pose
        by which these were looked at, `used_pose`.

        Args:
            images: Network inputs, 0 to 255.
            deviation: Camera poses to project cells with, instead of the estimated ones; of
                fewer than all pictures if only the layouts of the first ones are to be read.
            fusion: Whether the nodes for FusionNet are wanted.
            refine: Whether the estimated pose is put right by the board's corners before cells are
                looked at, as at inference (pictures on the CPU; there is no gradient through it).
        """
        levels, coarse, stem = self._features(images)
        outputs: dict[str, Any] = {"boxes": self._boxes(images, levels)}
        if fusion and self.fusion_head is not None:
            outputs["fusion"] = self.fusion_head([levels[s] for s in self.config.boxes.strides])
        count = len(images) if deviation is None else len(deviation)
        if self.config.reads_layouts and count:
            fine, coarse = levels[self.strides[0]][:count], coarse[:count]
            stem = None if stem is None else stem[:count]
            outputs["pose"] = pose = self.pose_head(fine, coarse)
            used = pose[-1] if deviation is None else deviation
            if refine and deviation is None:
                seen = zip(used.split(1), images.numpy(), strict=True)
                used = torch.cat([refined_pose(self.pose_head, one, image) for one, image in seen])
            pixels = self.pose_head.project(used, self.occupancy_head.points)
            viewpoint = self.pose_head.viewpoint(used)
            outputs["cells"] = self.occupancy_head(fine, coarse, pixels, stem, viewpoint)
            outputs["used_pose"] = used
        return outputs

    def levels(self, images: UInt8[Tensor, "b h w 3"]) -> list[Float[Tensor, "b c _ _"]]:
        """The pyramid's levels that the box head reads, finest first."""
        levels, _, _ = self._features(images)
        return [levels[stride] for stride in self.config.boxes.strides]

    def _features(
        self, images: UInt8[Tensor, "b h w 3"]
    ) -> tuple[dict[int, Tensor], Tensor, Tensor | None]:
        """The pyramid's levels by stride, the backbone's last map, and that at stride 2."""
        mean, deviation = (images.new_tensor(v, dtype=torch.float32) for v in self._normalisation())
        x = ((images.float() - mean) / deviation).permute(0, 3, 1, 2)
        x, stem = x.contiguous(memory_format=torch.channels_last), None
        if self.config.detail:
            stem = self.backbone.stem(x)
        maps = self.backbone(x) if stem is None else self.backbone.after_stem(stem)
        if self.config.pyramid != "small":
            return dict(zip(self.strides, self.pyramid(maps), strict=True)), maps[-1], None
        fine, middle, coarse = maps
        top = self.lateral[2](coarse)
        middle = self.smooth[1](self.lateral[1](middle) + _grow(top, middle))
        fine = self.smooth[0](self.lateral[0](fine) + _grow(middle, fine))
        return dict(zip(self.strides, (fine, middle, top), strict=True)), coarse, stem

    def _normalisation(self) -> tuple[list[float], list[float]]:
        """Mean and deviation of red, green and blue, from 0 to 255."""
        return [255 * v for v in self.backbone.mean], [255 * v for v in self.backbone.deviation]

    def _boxes(self, images: Tensor, levels: Mapping[int, Tensor]) -> Any:
        read = [levels[stride] for stride in self.config.boxes.strides]
        return self.box_head(read, (images.shape[1], images.shape[2]))

    def losses(self, outputs: Mapping[str, Any], batch: BoxBatch) -> dict[str, Tensor]:
        """The heads' named losses: class, box and, of layouts, pose, occupancy, holding.

        A reader that looks twice adds those of `Occupancy.losses`: first_look and offset.
        """
        losses: dict[str, Tensor] = dict(self.box_head.losses(outputs["boxes"], batch.boxes))
        if "pose" in outputs:
            assert isinstance(batch, Batch)
            target = self.pose_head.target(batch.matrix, batch.camera_from_board)
            losses |= self.pose_head.losses(outputs["pose"], target)
            losses |= self.occupancy_head.losses(
                outputs["cells"],
                batch.cells,
                batch.visible,
                batch.holding,
                self.offsets(target, outputs["used_pose"], batch),
            )
        return losses

    def offsets(
        self, truth: Float[Tensor, "b 7"], used: Float[Tensor, "b 7"], batch: Batch
    ) -> Float[Tensor, "b 512 3"]:
        """Where the blocks are, from where the camera that was used shows their cells."""
        middles = self.occupancy_head.middles
        shifts = nn.functional.pad(batch.offsets[..., :2], (0, 1))
        seen = self.pose_head.project(truth, middles + shifts)
        pixels = seen - self.pose_head.project(used.detach(), middles)
        return torch.cat([pixels, batch.offsets[..., 2:] / TURN], dim=2)

    def see(self, image: UInt8[np.ndarray, "h w 3"]) -> Sight:
        """Everything that the network reads from one picture of the eye, of any size."""
        return self.see_prepared(self.frame.prepare(image))

    @torch.inference_mode()
    def see_prepared(self, picture: UInt8[np.ndarray, "h w 3"]) -> Sight:
        """The same from a picture that is cropped and sized as the network's input.

        Convolutions are in half precision (bfloat16), as in training, where the processor has
        instructions for it.

        Raises:
            CheckpointError: If this detector finds boxes only.
        """
        if not self.config.reads_layouts:
            raise CheckpointError(
                "This detector finds boxes only and reads no layout; use one of the preset compact."
            )
        with torch.autocast("cpu", torch.bfloat16, enabled=_half_is_fast()):
            outputs = self(torch.from_numpy(picture)[None], refine=True)
        found = self.box_head.predict(outputs["boxes"])[0]
        xyxy = torch.from_numpy(self.frame.to_eye(found.xyxy.double().numpy()))
        detected = Boxes(xyxy, found.classes, found.scores)
        read = outputs["cells"]
        cells = (read.logits[0].double() / self.config.temperature).softmax(-1).numpy()
        pose, head = outputs["used_pose"], self.pose_head
        corners = head.project(pose, head.landmarks)[0]
        scale, offset = self.frame.scale, np.array(self.frame.crop[:2])
        explained = self.explained(cells, pose, read.offsets)
        return Sight(
            boxes=with_leftovers(explained, detected),
            detected=detected,
            cells=cells.reshape(8, 8, 8, -1),
            holding=float(read.held[0].sigmoid()),
            corners=corners.double().numpy() / scale + offset,
            camera=self._eye(pose),
        )

    def explained(
        self,
        cells: Float[np.ndarray, "512 17"],
        pose: Float[Tensor, "1 7"],
        offsets: Float[Tensor, "1 512 3"] | None = None,
    ) -> Boxes:
        """`projected_boxes` of a picture, in pixels of the eye's.

        Args:
            cells: Probabilities of the classes of every cell.
            pose: The camera, as the pose head says it.
            offsets: Of the blocks, as the occupancy head says them; by default none stands
                beside the middle of its cell.
        """
        scale, head = self.frame.scale, self.pose_head

        def project(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
            pixels = head.project(pose, torch.from_numpy(points).float())[0]
            return pixels.double().numpy() / scale

        left, top, right, bottom = self.frame.crop
        size, viewpoint = (right - left, bottom - top), head.viewpoint(pose)[0].numpy()
        beside = IN_THE_MIDDLE
        if offsets is not None:
            beside = offsets[0].double().numpy() * [*(1 / scale), TURN]
        boxes = projected_boxes(cells, project, viewpoint, size, beside)
        boxes.xyxy += torch.tensor([left, top, left, top])
        return boxes

    def _eye(self, pose: Float[Tensor, "1 7"]) -> PinholeCamera:
        """The eye's own camera, whole numbers at the centres of its pixels."""
        matrix, camera_from_board = self.pose_head.camera(pose)
        return PinholeCamera(*self.frame.eye_size, self.frame.eye_matrix(matrix), camera_from_board)

    @torch.inference_mode()
    def detect(self, image: UInt8[np.ndarray, "h w 3"]) -> Boxes:
        """Boxes, in pixels of a picture of any size and aspect (thesis 4.1.3).

        All of the picture is seen, also what the frame would crop away: it is brought into the
        eye's size without stretching it, at the frame's scale.
        """
        size = np.array(image.shape[1::-1])
        share = (np.array(self.frame.eye_size) / size).min() * self.frame.scale
        wanted = np.maximum(np.rint(size * share), 1).astype(int)
        resized = cv2.resize(image, wanted.tolist(), interpolation=cv2.INTER_AREA)
        found = self.detect_prepared(resized)
        xyxy = found.xyxy.double().numpy() * np.tile(size / wanted, 2)
        xyxy = torch.from_numpy(xyxy.clip(0, np.tile(size, 2)))
        return Boxes(xyxy, found.classes, found.scores)

    @torch.inference_mode()
    def detect_prepared(self, picture: UInt8[np.ndarray, "h w 3"]) -> Boxes:
        """What the box head finds, in pixels of a picture at the scale of the network's input.

        Convolutions are in half precision, as in `see_prepared`.
        """
        prepared = torch.from_numpy(picture)[None]
        with torch.autocast("cpu", torch.bfloat16, enabled=_half_is_fast()):
            levels, _, _ = self._features(prepared)
            outputs = self._boxes(prepared, levels)
        return self.box_head.predict(outputs)[0]

    def save(self, folder: Path, metadata: Mapping[str, Any], *, half: bool = True) -> None:
        """Write a checkpoint folder."""
        tensors, config = self.state_dict(), self.config.as_json()
        save_checkpoint(
            folder, kind=KIND, config=config, tensors=tensors, metadata=metadata, half=half
        )

    @classmethod
    def from_folder(cls, folder: Path) -> "RetinaNet":
        """Read a checkpoint folder.

        Raises:
            CheckpointError: If it is missing, damaged, or of another kind or version, or has
                other classes than `blocks.CLASS_NAMES`.
        """
        checkpoint = load_checkpoint(folder, KIND)
        try:
            model = cls(RetinaNetConfig.from_json(checkpoint.config))
        except (TypeError, ValueError, LookupError, AttributeError, RuntimeError) as error:
            raise CheckpointError(
                f"The detector in {folder} has a configuration that cannot be used: {error}"
            ) from error
        restore(model, checkpoint.tensors, folder)
        return model.eval()


def _check_backbone(backbone: Any, config: RetinaNetConfig) -> None:
    """Refuse a backbone without the small pyramid's three maps, or the stem of details."""
    count = len(backbone.strides)
    if config.pyramid == "small" and count != 3:
        raise InputError(
            f"The small pyramid takes three maps; the backbone {config.backbone!r} has {count}."
        )
    lacking = [n for n in ("stem", "stem_channels", "after_stem") if not hasattr(backbone, n)]
    if config.detail and lacking:
        raise InputError(
            f"Details at stride 2 need a backbone with {' and '.join(lacking)}, which"
            f" {config.backbone!r} lacks; set detail to 0, or name another."
        )


@functools.cache
def _half_is_fast() -> bool:
    """Whether the processor multiplies in bfloat16, which other processors only emulate."""
    has: dict[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(has.get("avx512_bf16") or has.get("amx_bf16"))


def _grow(features: Tensor, like: Tensor) -> Tensor:
    return nn.functional.interpolate(features, size=like.shape[-2:], mode="nearest")
