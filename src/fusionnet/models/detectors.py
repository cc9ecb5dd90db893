"""The detectors that there are: a configuration, and a function for each preset."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import torch

from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset.frame import PictureFrame
from fusionnet.errors import InputError
from fusionnet.models import backbones
from fusionnet.models.anchors import AnchorShapes, thesis_anchors
from fusionnet.models.heads.boxes import BoxConfig
from fusionnet.models.pyramid import level_strides

Matrix = tuple[tuple[float, ...], ...]

THESIS_FRAME = PictureFrame(eye_size=(990, 540), crop=(0, 0, 990, 540), input_size=(990, 540))
"""The whole picture at the thesis's size (6.1.2, table 7.2)."""


@dataclass(frozen=True, kw_only=True)
class RetinaNetConfig:
    """What a `RetinaNet` is made of.

    Attributes:
        frame: Which part of the eye's picture is seen, at which size.
        backbone: Name in `models.backbones`.
        pyramid: "small" ends with the backbone; "p3-p7" adds two levels, as in the thesis.
        width: Channels of the pyramid.
        boxes: Anchors and subnets of the box head.
        fusion_nodes: Nodes an anchor for FusionNet; 0 for no fusion subnet.
        detail: Channels that the occupancy head gathers at stride 2; 0 for none.
        reasoning: Blocks of three-dimensional convolutions of that head.
        second_look: Such blocks behind its second look; 0 for none.
        temperature: Divides the logits of the cells, so that probabilities are calibrated
            (Guo et al. 2017, On calibration of modern neural networks).
        matrix: Nominal intrinsics of the eye (3x3), in pixels of the eye's picture; without
            them and the pose no layout is read.
        camera_from_board: Nominal pose of the eye (4x4), OpenCV axes.
        gaussian: Whether pyramid and subnets begin as in the thesis (4.1.2).
        frozen: Whether the backbone's normalisation is kept as it is, which one with
            ImageNet weights needs for batches of one picture.
        classes: Names of the classes, in the order of the box head's outputs.
    """

    frame: PictureFrame
    backbone: str = "small"
    pyramid: Literal["small", "p3-p7"] = "small"
    width: int = 48
    boxes: BoxConfig = field(default_factory=BoxConfig)
    fusion_nodes: int = 0
    detail: int = 0
    reasoning: int = 2
    second_look: int = 0
    temperature: float = 1.0
    matrix: Matrix | None = None
    camera_from_board: Matrix | None = None
    gaussian: bool = False
    frozen: bool = False
    classes: tuple[str, ...] = CLASS_NAMES

    def __post_init__(self) -> None:
        """Refuse what cannot be built, and other classes than ours."""
        if tuple(self.classes) != CLASS_NAMES:
            strange = sorted(set(self.classes) ^ set(CLASS_NAMES)) or ["another order"]
            raise InputError(
                f"The classes differ from this release's 16 ({', '.join(strange[:4])}); "
                f"expected {', '.join(CLASS_NAMES)}."
            )
        if self.pyramid == "small" and (self.gaussian or self.fusion_nodes):
            raise InputError(
                "The small pyramid goes with no fusion subnet, nor the thesis's start."
            )
        least = min(self.fusion_nodes, self.detail, self.second_look)
        if least < 0 or min(self.width, self.reasoning) < 1:
            raise InputError(
                f"width and reasoning >= 1, fusion_nodes, detail and second_look >= 0; got {self}"
            )
        if not self.temperature > 0.0:
            raise InputError(f"A temperature is positive; got {self.temperature}.")
        if self.detail and self.pyramid != "small":
            raise InputError("Details at stride 2 go with the small pyramid only.")

    @property
    def reads_layouts(self) -> bool:
        """Whether there are heads for the camera's pose and the cells."""
        return self.matrix is not None and self.camera_from_board is not None

    def as_json(self) -> dict[str, Any]:
        """JSON values that rebuild it."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "RetinaNetConfig":
        """The inverse of `as_json`; what an earlier release did not know gets its default."""
        given = dict(values)
        given["frame"] = PictureFrame.from_dict(given["frame"])
        given["boxes"] = BoxConfig.from_json(given.get("boxes", {}))
        given["classes"] = tuple(given.get("classes", CLASS_NAMES))
        for name in ("matrix", "camera_from_board"):
            if given.get(name) is not None:
                given[name] = _matrix(given[name])
        return cls(**given)


def compact(
    frame: PictureFrame,
    matrix: Sequence[Sequence[float]],
    camera_from_board: Sequence[Sequence[float]],
) -> RetinaNetConfig:
    """What we ship: boxes, the camera's pose and the occupancy of cells, on two CPU cores."""
    return RetinaNetConfig(
        frame=frame,
        boxes=BoxConfig(depth=2, sizes=((14.0, 24.0, 38.0),)),
        detail=16,
        reasoning=4,
        second_look=2,
        matrix=_matrix(matrix),
        camera_from_board=_matrix(camera_from_board),
    )


def views(frame: PictureFrame) -> RetinaNetConfig:
    """Boxes alone, of blocks of any size: what we ship for pictures that no eye of ours took.

    Of what another block hides a strip may be left, flat or upright.
    """
    boxes = BoxConfig(
        depth=2,
        width=96,
        strides=(4, 8, 16),
        sizes=((8.5, 13.0), (20.0, 31.0), (48.0, 75.0)),
        ratios=(0.4, 1.0, 2.5),
        prisms=2.0,
    )
    return RetinaNetConfig(frame=frame, backbone="wide", width=96, boxes=boxes)


def thesis(
    backbone: str = "resnet50",
    *,
    frame: PictureFrame = THESIS_FRAME,
    anchors: AnchorShapes | None = None,
    fusion_nodes: int = 4,
    width: int = 256,
    depth: int = 4,
) -> RetinaNetConfig:
    """The thesis's RetinaNet: five levels of 256 channels, nine anchors, the fusion subnet.

    Args:
        backbone: Name in `models.backbones` (thesis: ResNet-50 by default, 152 in table 7.2).
        frame: Which part of pictures is seen, at which size (thesis: all of it, 990 x 540).
        anchors: Of five levels (thesis: table 7.2).
        fusion_nodes: Nodes an anchor for FusionNet (thesis: 4, or 16 in 7.4.2).
        width: Channels of the pyramid and of the subnets (thesis: 256).
        depth: Convolutions of each subnet before its last (thesis: 4).

    References:
        Thesis 2.1.10, 4.1 and tables 6.1 and 7.2.
    """
    return RetinaNetConfig(
        frame=frame,
        backbone=backbone,
        pyramid="p3-p7",
        width=width,
        boxes=pyramid_boxes(
            anchors or thesis_anchors(),
            strides=five_strides(backbone),
            depth=depth,
            width=width,
        ),
        fusion_nodes=fusion_nodes,
        gaussian=True,
    )


def pyramid_boxes(
    anchors: AnchorShapes,
    *,
    strides: tuple[int, ...] = (8, 16, 32, 64, 128),
    depth: int = 4,
    width: int = 256,
) -> BoxConfig:
    """Subnets of four convolutions with 256 channels as in the thesis (or others), and a
    classifier that begins at -2 (4.1.2).
    """
    sizes = tuple(tuple(size * scale for scale in anchors.scales) for size in anchors.sizes)
    return BoxConfig(
        strides=strides,
        sizes=sizes,
        ratios=anchors.ratios,
        depth=depth,
        width=width,
        kernel=3,
        prior=-2.0,
    )


def five_strides(backbone: str) -> tuple[int, ...]:
    """Strides of the five levels upon a backbone, in pixels of the input."""
    with torch.device("meta"):
        made = backbones.load(backbone)()
    return level_strides(made.strides)


def _matrix(rows: Sequence[Sequence[float]]) -> Matrix:
    return tuple(tuple(float(value) for value in row) for row in rows)
