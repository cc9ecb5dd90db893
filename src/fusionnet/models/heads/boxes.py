"""What and where: RetinaNet's classification and regression subnets (thesis 4.1.1).

Built on torchvision's parts (anchors, matcher, box coder, focal loss, suppression).
The same two subnets read every pyramid level.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torchvision.models.detection._utils import BoxCoder, Matcher
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.ops import batched_nms, box_iou, clip_boxes_to_image, sigmoid_focal_loss

from fusionnet.blocks import CLASS_NAMES, Shape
from fusionnet.errors import InputError
from fusionnet.models.heads._head import Example, Features, Head
from fusionnet.models.labelled_boxes import Boxes, BoxPrecision

CLASSES = len(CLASS_NAMES)
PRISMS = [i for i, name in enumerate(CLASS_NAMES) if name.startswith(Shape.PRISM)]
CANDIDATES = 1000
SCORE = 0.05
OVERLAP = 0.5
"""Top candidates, least score and greatest overlap a class at inference (thesis 4.1.3)."""

EASY = -6.0
"""Logit (a probability of 0.0025) below which an anchor without a block is left out of the focal
loss, of which a hundred thousand such anchors make less than a thousandth together."""


@dataclass(frozen=True, kw_only=True)
class BoxConfig:
    """Anchors and subnets; the values are those of a compact detector.

    Attributes:
        strides: Of the pyramid levels that are read, in pixels of the input.
        sizes: Square roots of the anchors' areas on each level, in pixels of the input.
        ratios: Heights over widths of the anchors, on every level.
        depth: Convolutions with ReLU in each subnet, before the last one.
        width: Channels of the subnets.
        kernel: Edge of the last convolution's kernel.
        prior: Bias of the last classifying convolution; the logit of the share of anchors
            that are expected to hold a block (thesis 4.1.2: -2).
        prisms: How often an anchor on a prism counts in the loss of the classes: there are few, and
            from above little tells them from cubes.
    """

    strides: tuple[int, ...] = (8,)
    sizes: tuple[tuple[float, ...], ...] = ((10.0, 18.0, 28.0),)
    ratios: tuple[float, ...] = (1.0,)
    depth: int = 1
    width: int = 64
    kernel: int = 1
    prior: float = -math.log(99)
    prisms: float = 1.0

    def __post_init__(self) -> None:
        """Refuse levels that do not fit."""
        counts = {len(level) for level in self.sizes}
        if len(self.sizes) != len(self.strides) or len(counts) != 1:
            raise InputError(
                "Each stride of the box head needs as many anchor sizes as the others; got "
                f"strides {self.strides} and sizes {self.sizes}."
            )

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "BoxConfig":
        """From what JSON makes of its fields."""
        given: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list | tuple) else v for k, v in values.items()
        }
        if "sizes" in given:
            given["sizes"] = tuple(tuple(level) for level in given["sizes"])
        return cls(**given)

    @property
    def anchors_a_place(self) -> int:
        """Anchors at each place of each level."""
        return len(self.sizes[0]) * len(self.ratios)


class BoxOutputs(NamedTuple):
    """What the subnets say of every anchor.

    Attributes:
        classes: Logits of the classes.
        offsets: From the anchor to the box, as torchvision's box coder has them.
        anchors: Left, top, right, bottom, in pixels of the input.
        size: Height and width of the input, in pixels.
    """

    classes: Float[Tensor, "b n k"]
    offsets: Float[Tensor, "b n 4"]
    anchors: Float[Tensor, "n 4"]
    size: tuple[int, int]


class BoxHead(nn.Module):
    """Classify and regress the anchors of the pyramid's levels.

    Args:
        channels: Channels of every level.
        config: Anchors and subnets.
    """

    def __init__(self, *, channels: int, config: BoxConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or BoxConfig()
        levels = len(config.strides)
        self.anchors = AnchorGenerator(sizes=config.sizes, aspect_ratios=(config.ratios,) * levels)
        self.classify = subnet(channels, config, config.anchors_a_place * CLASSES)
        self.regress = subnet(channels, config, config.anchors_a_place * 4)
        self.expect_few()
        self.coder = BoxCoder(weights=(1.0, 1.0, 1.0, 1.0))
        self.matcher = Matcher(0.5, 0.4, allow_low_quality_matches=True)

    def expect_few(self) -> None:
        """Start the classifier from the prior, so that the many empty anchors do not drown it."""
        final = self.classify[-1]
        assert isinstance(final, nn.Conv2d) and final.bias is not None
        nn.init.normal_(final.weight, std=0.01)
        nn.init.constant_(final.bias, self.config.prior)

    def forward(
        self, levels: Sequence[Float[Tensor, "b c _ _"]], size: tuple[int, int]
    ) -> BoxOutputs:
        """Class logits, offsets and the anchors themselves.

        Args:
            levels: One feature map for each stride.
            size: Height and width of the input, in pixels.
        """
        classes = [by_anchor(self.classify(features), CLASSES) for features in levels]
        offsets = [by_anchor(self.regress(features), 4) for features in levels]
        anchors = self._anchors_of(levels)
        return BoxOutputs(torch.cat(classes, dim=1), torch.cat(offsets, dim=1), anchors, size)

    def _anchors_of(self, levels: Sequence[Float[Tensor, "b c _ _"]]) -> Float[Tensor, "n 4"]:
        """All anchors, in pixels of the input, whatever its size is divisible by."""
        device = levels[0].device
        self.anchors.set_cell_anchors(torch.float32, device)
        sizes = [list(features.shape[-2:]) for features in levels]
        strides = [[torch.tensor(s, device=device)] * 2 for s in self.config.strides]
        return torch.cat(self.anchors.grid_anchors(sizes, strides))

    def losses(self, outputs: BoxOutputs, truth: list[Boxes]) -> dict[str, Tensor]:
        """`class`: focal loss (gamma 2, alpha 0.5); `box`: smooth L1 (thesis 4.1.2)."""
        classes, offsets, anchors, _ = outputs
        class_losses, box_losses = [], []
        for logits, offset, boxes in zip(classes, offsets, truth, strict=True):
            if not len(boxes.xyxy):
                hard = logits[logits.detach().amax(dim=1) > EASY]
                class_losses.append(_focal(hard, torch.zeros_like(hard)))
                continue
            wanted = torch.zeros_like(logits)
            matched = self._matched(boxes.xyxy, anchors)
            found = matched >= 0
            wanted[found, boxes.classes[matched[found]]] = 1.0
            hard = found | (logits.detach().amax(dim=1) > EASY)
            considered = hard & (matched != Matcher.BETWEEN_THRESHOLDS)
            count = max(1, int(found.sum()))
            counts = torch.where(wanted[:, PRISMS].any(dim=1), self.config.prisms, 1.0)[considered]
            losses = _focal(logits[considered], wanted[considered], "none").sum(dim=1)
            class_losses.append((counts * losses).sum() / count)
            goal = self.coder.encode_single(boxes.xyxy[matched[found]], anchors[found])
            box_losses.append(
                nn.functional.smooth_l1_loss(offset[found], goal, beta=0.1, reduction="sum") / count
            )
        none = offsets.sum() * 0.0
        return {
            "class": torch.stack(class_losses).mean(),
            "box": torch.stack(box_losses).mean() if box_losses else none,
        }

    def _matched(
        self, boxes: Float[Tensor, "m 4"], anchors: Float[Tensor, "n 4"]
    ) -> Int[Tensor, " n"]:
        """The box of each anchor, or why it has none, as torchvision's matcher says; overlaps are
        computed only where boxes are.
        """
        before, behind = boxes[:, :2].amin(dim=0), boxes[:, 2:].amax(dim=0)
        near = ((anchors[:, 2:] > before) & (anchors[:, :2] < behind)).all(dim=1)
        matched = torch.full_like(near, Matcher.BELOW_LOW_THRESHOLD, dtype=torch.long)
        matched[near] = self.matcher(box_iou(boxes, anchors[near]))
        return matched

    def predict(self, outputs: BoxOutputs) -> list[Boxes]:
        """Boxes above the least score after suppression a class (thesis 4.1.3)."""
        return _found(outputs, self.coder)

    @staticmethod
    def metric(found: Sequence[Boxes], truth: Sequence[Boxes]) -> dict[str, Any]:
        """What `BoxPrecision` says of some pictures."""
        precision = BoxPrecision()
        for seen, right in zip(found, truth, strict=True):
            precision.update(seen, right)
        return precision.compute()


@torch.no_grad()
def _found(outputs: BoxOutputs, coder: BoxCoder) -> list[Boxes]:
    """Boxes above the least score after suppression a class (thesis 4.1.3)."""
    classes, offsets, anchors, size = outputs
    found = []
    for logits, offset in zip(classes, offsets, strict=True):
        scores, flat = logits.float().sigmoid().flatten().topk(min(CANDIDATES, logits.numel()))
        keep = scores > SCORE
        scores, flat = scores[keep], flat[keep]
        which, labels = flat // CLASSES, flat % CLASSES
        boxes = clip_boxes_to_image(
            coder.decode_single(offset[which].float(), anchors[which]), size
        )
        kept = batched_nms(boxes, scores, labels, OVERLAP)
        found.append(Boxes(boxes[kept], labels[kept], scores[kept]))
    return found


def _focal(logits: Tensor, wanted: Tensor, reduction: str = "sum") -> Tensor:
    return sigmoid_focal_loss(logits, wanted, alpha=0.5, gamma=2.0, reduction=reduction)


def by_anchor(output: Float[Tensor, "b _ h w"], values: int) -> Float[Tensor, "b n {values}"]:
    """A convolution's output with one row an anchor: rows, columns, then anchors of a place."""
    return output.permute(0, 2, 3, 1).reshape(len(output), -1, values)


def subnet(channels: int, config: BoxConfig, outputs: int) -> nn.Sequential:
    """Convolutions with ReLU as the configuration says, and a last linear one."""
    layers: list[nn.Module] = []
    for source in (channels, *(config.width,) * (config.depth - 1))[: config.depth]:
        layers += [nn.Conv2d(source, config.width, 3, padding=1), nn.ReLU(inplace=True)]
    last = config.width if config.depth else channels
    layers.append(nn.Conv2d(last, outputs, config.kernel, padding=config.kernel // 2))
    return nn.Sequential(*layers)


def found_boxes(outputs: BoxOutputs) -> list[Boxes]:
    """Boxes of every picture above the least score, on the CPU, without the network."""
    coder = BoxCoder(weights=(1.0, 1.0, 1.0, 1.0))
    return [Boxes(b.xyxy.cpu(), b.classes.cpu(), b.scores.cpu()) for b in _found(outputs, coder)]


class BoxesHead(Head):
    """Where the blocks are: the regression subnet as a representation of FusionNet (7.1)."""

    columns = ("boxes", "classes")
    needs_pyramid = True
    needs_anchors = True

    @staticmethod
    def target(example: Example) -> Boxes:
        """The true boxes."""
        return example.boxes

    def forward(self, features: Features) -> BoxOutputs:
        """Logits, offsets and anchors."""
        outputs: BoxOutputs = features.anchors
        return outputs

    def loss(self, output: Any, targets: Sequence[Boxes], features: Features) -> Tensor:
        """Smooth L1 of the offsets (thesis 4.1.2)."""
        return features.anchor_losses(targets)["box"]

    def predict(self, output: BoxOutputs) -> list[Boxes]:
        """Blocks of each picture."""
        return found_boxes(output)

    @staticmethod
    def metric(found: Sequence[Boxes], truth: Sequence[Boxes]) -> dict[str, float]:
        """`box_iou`: mean overlap of each true box with the best box that was found."""
        best = [
            box_iou(true.xyxy, seen.xyxy).amax(dim=1) if len(seen.xyxy) else true.scores * 0.0
            for seen, true in zip(found, truth, strict=True)
        ]
        overlaps = torch.cat(best) if best else torch.zeros(0)
        return {"box_iou": float(overlaps.mean()) if len(overlaps) else 0.0}


HEAD = BoxesHead
