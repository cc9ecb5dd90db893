"""What the thesis's FusionNet is made of."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from fusionnet.errors import CheckpointError, InputError
from fusionnet.models import heads
from fusionnet.models.detectors import RetinaNetConfig
from fusionnet.models.target_text import Writes
from fusionnet.models.transformer_network import TransformerConfig, transformer_config

JOINTS = "joints"
THESIS_HEADS = ("boxes", "classes", "tree", JOINTS)


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
        needing = [n for n in self.heads if n not in ("tree", JOINTS)]
        if self.vision == "cnn" and needing:
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
