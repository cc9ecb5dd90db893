"""What the thesis's FusionNet is made of."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from fusionnet import robots
from fusionnet.dataset.frame import PictureFrame
from fusionnet.errors import CheckpointError, InputError
from fusionnet.models import backbones, detectors, heads
from fusionnet.models.anchors import AnchorShapes, thesis_anchors
from fusionnet.models.detectors import RetinaNetConfig
from fusionnet.models.target_text import Writes
from fusionnet.models.transformer_config import TransformerConfig, transformer_config

JOINTS = "joints"
THESIS_HEADS = ("boxes", "classes", "tree", JOINTS)


@dataclass(frozen=True, kw_only=True)
class NetworkSizes:
    """Sizes of both networks; the values are those of tables 7.1 to 7.3.

    Attributes:
        backbone: Name in `models.backbones`.
        backbone_weights: "imagenet", "random", or a safetensors file with torchvision's names.
        input_size: Width and height that pictures are fitted into, in pixels.
        anchors: Sizes of the five levels, ratios and scales.
        pyramid_width: Channels of the pyramid and the subnets.
        subnet_depth: Convolutions of each subnet before its last one.
        gaussian: Whether pyramid and subnets begin as in the thesis (4.1.2).
        nodes: N_n, nodes an anchor and a token.
        longest: l_seq, tokens of a sentence and of a target, marks included.
        embedding_size, layers, heads, attention_size, feed_forward_size, dropout: Of the
            Transformer.
    """

    backbone: str = "resnet152"
    backbone_weights: str = backbones.IMAGENET
    input_size: tuple[int, int] = (990, 540)
    anchors: AnchorShapes = field(default_factory=thesis_anchors)
    pyramid_width: int = 256
    subnet_depth: int = 4
    gaussian: bool = True
    nodes: int = 4
    longest: int = 200
    embedding_size: int = 50
    layers: int = 4
    heads: int = 4
    attention_size: int = 12
    feed_forward_size: int = 256
    dropout: float = 0.15


@dataclass(frozen=True, kw_only=True)
class ThesisFusionNetConfig:
    """What a `ThesisFusionNet` is made of.

    Attributes:
        robot: Name of the robot whose values it answers.
        joint_names: Its arm's joints.
        joint_limits: Least and greatest of each of the fourteen values in the data set that was
            learnt from: radians, and the gripper's states (equation 4.2).
        detector: RetinaNet and its frame; also the frame of the plain vision.
        crop: Whether pictures are cropped to where the grid appears before they are fitted (6.1).
        vision: `retinanet`, or `cnn` (7.3).
        transformer: Sizes of the language module.
        source: Tokens that are read.
        target: Tokens that are written.
        writes: Tree's text, its short form, or the sentence itself (7.3).
        fuser: Name in `models.fusers`.
        heads: Names in `models.heads`; always with `joints`.
    """

    robot: str
    joint_names: tuple[str, ...]
    joint_limits: tuple[tuple[float, float], ...]
    detector: RetinaNetConfig
    crop: bool = True
    vision: Literal["retinanet", "cnn"] = "retinanet"
    transformer: TransformerConfig
    source: tuple[str, ...]
    target: tuple[str, ...]
    writes: Writes = "rcl"
    fuser: str = "concatenate"
    heads: tuple[str, ...] = THESIS_HEADS

    def __post_init__(self) -> None:
        """Refuse what does not go together."""
        if JOINTS not in self.heads or len(set(self.heads)) != len(self.heads):
            raise InputError(
                f"A FusionNet has the head {JOINTS!r} and every other once; received "
                f"{', '.join(self.heads) or 'none'}. There are {', '.join(heads.names())}."
            )
        if len(self.joint_limits) != 2 * (len(self.joint_names) + 1):
            raise InputError(
                f"{len(self.joint_names)} joints have {2 * len(self.joint_names) + 2} values; "
                f"received {len(self.joint_limits)} pairs of limits."
            )
        if self.vision == "cnn":
            needing = [name for name in self.heads if heads.load(name).needs_pyramid]
            if needing:
                raise InputError(f"The plain vision has no {' or '.join(needing)}; leave it out.")

    def as_json(self) -> dict[str, Any]:
        """JSON values that rebuild it."""
        return asdict(self) | {"detector": self.detector.as_json()}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "ThesisFusionNetConfig":
        """The inverse of `as_json`.

        Raises:
            CheckpointError: If the values are not those of a FusionNet.
        """
        try:
            given = dict(values)
            given["detector"] = RetinaNetConfig.from_json(given["detector"])
            given["transformer"] = transformer_config(given["transformer"])
            for name in ("joint_names", "source", "target", "heads"):
                given[name] = tuple(map(str, given[name]))
            given["joint_limits"] = tuple((float(a), float(b)) for a, b in given["joint_limits"])
            return cls(**given)
        except (TypeError, KeyError, ValueError, AttributeError) as error:
            raise CheckpointError(f"This is no configuration of a FusionNet: {error}") from error


def thesis(
    robot: str,
    joint_limits: Sequence[tuple[float, float]],
    source: Sequence[str],
    target: Sequence[str],
    *,
    sizes: NetworkSizes | None = None,
    **chosen: Any,
) -> ThesisFusionNetConfig:
    """The thesis's FusionNet: RetinaNet upon ResNet-152 and the optimised Transformer, four nodes.

    Args:
        robot: Name of a robot of the catalogue.
        joint_limits: Least and greatest of the fourteen values of the data set.
        source: Tokens that are read.
        target: Tokens that are written.
        sizes: Of both networks (thesis: tables 7.1 to 7.3, the default).
        chosen: Other fields of `ThesisFusionNetConfig` that differ from the base model's: vision,
            writes, fuser, heads (7.1, 7.3).

    References:
        Thesis, 4.3 and tables 7.1 to 7.3.
    """
    sizes = sizes or NetworkSizes()
    size = sizes.input_size
    detector = replace(
        detectors.thesis(
            sizes.backbone,
            frame=PictureFrame(eye_size=size, crop=(0, 0, *size), input_size=size),
            fusion_nodes=sizes.nodes,
        ),
        width=sizes.pyramid_width,
        gaussian=sizes.gaussian,
        frozen=sizes.backbone_weights != backbones.RANDOM,
        boxes=detectors.pyramid_boxes(
            sizes.anchors,
            strides=detectors.five_strides(sizes.backbone),
            depth=sizes.subnet_depth,
            width=sizes.pyramid_width,
        ),
    )
    transformer = TransformerConfig(
        source_words=len(source) + 2,
        target_words=len(target) + 2,
        embedding_size=sizes.embedding_size,
        layers=sizes.layers,
        heads=sizes.heads,
        attention_size=sizes.attention_size,
        feed_forward_size=sizes.feed_forward_size,
        fusion_nodes=sizes.nodes,
        longest=sizes.longest,
        dropout=sizes.dropout,
    )
    return ThesisFusionNetConfig(
        robot=robot,
        joint_names=tuple(robots.load(robot).joint_names),
        joint_limits=tuple(joint_limits),
        detector=detector,
        transformer=transformer,
        source=tuple(source),
        target=tuple(target),
        **chosen,
    )
