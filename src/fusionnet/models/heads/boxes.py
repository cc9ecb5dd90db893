"""What and where: RetinaNet's classification and regression subnets (thesis 4.1.1).

Built on torchvision's parts (anchors, matcher, box coder, focal loss, suppression).
The subnets are shallow and read one pyramid level, since blocks have one size.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torchvision.models.detection._utils import BoxCoder, Matcher
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.image_list import ImageList
from torchvision.ops import batched_nms, box_iou, clip_boxes_to_image, sigmoid_focal_loss

from fusionnet.blocks import CLASS_NAMES

CLASSES = len(CLASS_NAMES)
CANDIDATES = 1000
SCORE = 0.05
OVERLAP = 0.5
"""Top candidates, least score and greatest overlap a class at inference (thesis 4.1.3)."""


@dataclass  # not frozen: Fabric moves its tensors between devices
class Boxes:
    """Boxes of one picture.

    Attributes:
        xyxy: Left, top, right, bottom, in pixels of the network's input.
        classes: Index into `CLASS_NAMES`.
        scores: Probability of the class; 1 for ground truth.
    """

    xyxy: Float[Tensor, "n 4"]
    classes: Int[Tensor, " n"]
    scores: Float[Tensor, " n"]


class BoxHead(nn.Module):
    """Classify and regress the anchors of one feature map.

    Args:
        channels: Channels of the feature map.
        input_size: Width and height of the network's input, in pixels.
        sizes: Square roots of the anchors' areas, in pixels of the input.
        ratios: Heights over widths of the anchors.
        width: Channels of the subnets.
    """

    def __init__(
        self,
        *,
        channels: int,
        input_size: tuple[int, int],
        sizes: tuple[float, ...] = (10.0, 18.0, 28.0),
        ratios: tuple[float, ...] = (1.0,),
        width: int = 64,
    ) -> None:
        super().__init__()
        self.input_size = input_size
        self.anchors = AnchorGenerator(sizes=(sizes,), aspect_ratios=(ratios,))
        count = len(sizes) * len(ratios)
        self.classify = _subnet(channels, width, count * CLASSES)
        self.regress = _subnet(channels, width, count * 4)
        prior = 0.01
        final = self.classify[-1]
        assert isinstance(final, nn.Conv2d) and final.bias is not None
        nn.init.normal_(final.weight, std=0.01)
        nn.init.constant_(final.bias, -math.log((1 - prior) / prior))
        self.coder = BoxCoder(weights=(1.0, 1.0, 1.0, 1.0))
        self.matcher = Matcher(0.5, 0.4, allow_low_quality_matches=True)

    def forward(
        self, features: Float[Tensor, "b c h w"]
    ) -> tuple[Float[Tensor, "b n k"], Float[Tensor, "b n 4"], Float[Tensor, "n 4"]]:
        """Class logits, offsets and the anchors themselves."""
        batch = len(features)
        classes = self.classify(features).permute(0, 2, 3, 1).reshape(batch, -1, CLASSES)
        offsets = self.regress(features).permute(0, 2, 3, 1).reshape(batch, -1, 4)
        width, height = self.input_size
        blank = torch.empty((1, 3, height, width), device="meta")
        images = ImageList(blank, [(height, width)])
        anchors = self.anchors(images, [features[:1]])[0]
        return classes, offsets, anchors

    def losses(
        self,
        outputs: tuple[Float[Tensor, "b n k"], Float[Tensor, "b n 4"], Float[Tensor, "n 4"]],
        truth: list[Boxes],
    ) -> dict[str, Tensor]:
        """`class`: focal loss (gamma 2, alpha 0.5); `box`: smooth L1 (thesis 4.1.2)."""
        classes, offsets, anchors = outputs
        class_losses, box_losses = [], []
        for logits, offset, boxes in zip(classes, offsets, truth, strict=True):
            wanted = torch.zeros_like(logits)
            if not len(boxes.xyxy):
                class_losses.append(_focal(logits, wanted))
                continue
            matched = self.matcher(box_iou(boxes.xyxy, anchors))
            found = matched >= 0
            wanted[found, boxes.classes[matched[found]]] = 1.0
            considered = matched != Matcher.BETWEEN_THRESHOLDS
            count = max(1, int(found.sum()))
            class_losses.append(_focal(logits[considered], wanted[considered]) / count)
            goal = self.coder.encode_single(boxes.xyxy[matched[found]], anchors[found])
            box_losses.append(
                nn.functional.smooth_l1_loss(offset[found], goal, beta=0.1, reduction="sum") / count
            )
        none = offsets.sum() * 0.0
        return {
            "class": torch.stack(class_losses).mean(),
            "box": torch.stack(box_losses).mean() if box_losses else none,
        }

    @torch.no_grad()
    def predict(
        self,
        outputs: tuple[Float[Tensor, "b n k"], Float[Tensor, "b n 4"], Float[Tensor, "n 4"]],
    ) -> list[Boxes]:
        """Boxes above the least score after suppression a class (thesis 4.1.3)."""
        classes, offsets, anchors = outputs
        found = []
        for logits, offset in zip(classes, offsets, strict=True):
            scores, flat = logits.sigmoid().flatten().topk(min(CANDIDATES, logits.numel()))
            keep = scores > SCORE
            scores, flat = scores[keep], flat[keep]
            which, labels = flat // CLASSES, flat % CLASSES
            boxes = self.coder.decode_single(offset[which], anchors[which])
            width, height = self.input_size
            boxes = clip_boxes_to_image(boxes, (height, width))
            kept = batched_nms(boxes, scores, labels, OVERLAP)
            found.append(Boxes(boxes[kept], labels[kept], scores[kept]))
        return found


def _focal(logits: Tensor, wanted: Tensor) -> Tensor:
    return sigmoid_focal_loss(logits, wanted, alpha=0.5, gamma=2.0, reduction="sum")


def _subnet(channels: int, width: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, width, 3, padding=1),
        nn.ReLU(inplace=True),
        nn.Conv2d(width, outputs, 1),
    )
