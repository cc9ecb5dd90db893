"""What every head of FusionNet offers: one intermediate representation, or the joints."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float, UInt8
from torch import Tensor, nn

if TYPE_CHECKING:
    from fusionnet.models.heads.boxes import Boxes


@dataclass
class Example:
    """One stored sample as FusionNet learns from it.

    Attributes:
        picture: The network's input, 0 to 255.
        boxes: Blocks in it, in its pixels.
        source: Numbers of the sentence's tokens, their marks included.
        target: Numbers of the tokens to write, their marks included.
        joints: The fourteen values, scaled to 0 ... 1 (thesis, equation 4.2).
        sample: The stored columns that the heads ask for.
    """

    picture: UInt8[np.ndarray, "h w 3"]
    boxes: "Boxes"
    source: tuple[int, ...]
    target: tuple[int, ...]
    joints: Float[np.ndarray, " k"]
    sample: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Shapes:
    """Sizes that a head may need when it is made.

    Attributes:
        channels: Of every level of the pyramid; 0 if the vision has none.
        strides: Of the levels, in pixels of the input.
        fused: Length of the fused vector.
        joints: Values to be answered (fourteen).
    """

    channels: int
    strides: tuple[int, ...]
    fused: int
    joints: int


@dataclass
class Features:
    """What the networks below the heads say of a batch.

    Attributes:
        levels: The pyramid's levels, finest first; none if the vision has no pyramid.
        anchors: What RetinaNet's subnets say of every anchor, if they were asked.
        anchor_losses: Losses of the anchors given the true boxes; both box heads share them.
        tokens: Logits of the token behind every place of the target.
        fused: The fused vector.
    """

    levels: Sequence[Float[Tensor, "b c _ _"]]
    anchors: Any
    anchor_losses: Callable[[Sequence["Boxes"]], Mapping[str, Tensor]]
    tokens: Float[Tensor, "b s w"]
    fused: Float[Tensor, "b f"]


class Head(nn.Module):
    """One output of FusionNet: its target in a sample, its prediction, its loss and its metric.

    A file of `models.heads` offers a subclass as `HEAD`; its name there is the name of its
    loss. A head needs nothing else to be trained, weighted, measured and switched off.

    Args:
        shapes: Sizes of what there is to read.

    Attributes:
        columns: Columns of a stored sample that its target is made of.
        needs_pyramid: Whether it reads RetinaNet, its levels or its subnets, which the plain
            vision has not.
        needs_anchors: Whether it reads RetinaNet's subnets, which cost time.
    """

    columns: ClassVar[tuple[str, ...]] = ()
    needs_pyramid: ClassVar[bool] = False
    needs_anchors: ClassVar[bool] = False

    def __init__(self, shapes: Shapes) -> None:
        super().__init__()
        self.shapes = shapes

    @staticmethod
    def target(example: Example) -> Any:
        """What is true of an example; tensors, or dataclasses of them."""
        raise NotImplementedError

    def forward(self, features: Features) -> Any:
        """The raw output of a batch."""
        raise NotImplementedError

    def loss(self, output: Any, targets: Sequence[Any], features: Features) -> Tensor:
        """One scalar of a batch."""
        raise NotImplementedError

    def predict(self, output: Any) -> list[Any]:
        """The output as people read it, one entry an example, on the CPU."""
        raise NotImplementedError

    @staticmethod
    def metric(found: Sequence[Any], truth: Sequence[Any]) -> dict[str, float]:
        """What is measured of predictions on data that was not learnt from."""
        raise NotImplementedError
