"""What the blocks are: RetinaNet's classification subnet as a representation of FusionNet.

The subnet, its focal loss and its prediction are the detector's (`heads.boxes`); the thesis
switches it and the regression of boxes on and off separately (7.1).
"""

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from fusionnet.models.heads._head import Example, Features, Head
from fusionnet.models.heads.boxes import Boxes, BoxHead, BoxOutputs, found_boxes


class ClassesHead(Head):
    """Which of 16 classes each anchor holds, if any."""

    columns = ("boxes", "classes")
    needs_pyramid = True
    needs_anchors = True

    @staticmethod
    def target(example: Example) -> Boxes:
        """The true boxes with their classes."""
        return example.boxes

    def forward(self, features: Features) -> BoxOutputs:
        """Logits, offsets and anchors."""
        outputs: BoxOutputs = features.anchors
        return outputs

    def loss(self, output: Any, targets: Sequence[Boxes], features: Features) -> Tensor:
        """Focal loss (thesis 4.1.2)."""
        return features.anchor_losses(targets)["class"]

    def predict(self, output: BoxOutputs) -> list[Boxes]:
        """Blocks of each picture."""
        return found_boxes(output)

    @staticmethod
    def metric(found: Sequence[Boxes], truth: Sequence[Boxes]) -> dict[str, float]:
        """`map_50`: mean average precision at an overlap of 0.5 (thesis, table 7.4)."""
        return {"map_50": float(BoxHead.metric(found, truth)["map_50"] or 0.0)}


HEAD = ClassesHead
