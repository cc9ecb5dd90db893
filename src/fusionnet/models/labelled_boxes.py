"""Boxes with classes, and how precisely they were found: over all classes and by class (table 6.2).

Metrics are torchmetrics' with faster-coco-eval; a test holds them against pycocotools.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torchmetrics.detection import MeanAveragePrecision

from fusionnet.blocks import CLASS_NAMES

MOST_DETECTIONS = [1, 10, 1000]
"""Detections a picture and class that count at most; the last decides."""


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


class BoxPrecision:
    """Collects pictures, then says how precisely their boxes were found."""

    def __init__(self) -> None:
        # Thresholds in double precision as COCO's; torchmetrics' own are rounded to single, and
        # a recall of 4 in 5 then misses its point.
        self._metric = MeanAveragePrecision(
            backend="faster_coco_eval",
            iou_thresholds=np.linspace(0.5, 0.95, 10).tolist(),
            rec_thresholds=np.linspace(0.0, 1.0, 101).tolist(),
            extended_summary=True,
            max_detection_thresholds=MOST_DETECTIONS,
            sync_on_compute=False,  # of several processes that train, one measures
        )
        self._metric.warn_on_many_detections = False
        self._instances = torch.zeros(len(CLASS_NAMES), dtype=torch.long)

    def update(self, found: Boxes, truth: Boxes, ignored: Bool[Tensor, " n"] | None = None) -> None:
        """Add one picture.

        Args:
            found: Detections.
            truth: What there is.
            ignored: Which of `truth` neither count when missed nor make a detection wrong, as
                COCO's crowds; none by default.
        """
        labels = truth.classes.long().cpu()
        ignored = torch.zeros(len(labels), dtype=torch.bool) if ignored is None else ignored.cpu()
        self._instances += torch.bincount(labels[~ignored], minlength=len(CLASS_NAMES))
        self._metric.update(
            [
                {
                    "boxes": found.xyxy.float().cpu(),
                    "scores": found.scores.float().cpu(),
                    "labels": found.classes.cpu(),
                }
            ],
            [{"boxes": truth.xyxy.float().cpu(), "labels": labels, "iscrowd": ignored.long()}],
        )

    def compute(self) -> dict[str, Any]:
        """Precision of all pictures so far.

        Returns:
            `map_50` and `map_50_95`: means over the classes that occur; `map_50_weighted`: the
            mean by instances (thesis 6.2); `classes`: for each class its `instances`, `ap_50`
            and `ap_50_95`, None where it does not occur.
        """
        classes: dict[str, dict[str, Any]] = {
            name: {"instances": int(count), "ap_50": None, "ap_50_95": None}
            for name, count in zip(CLASS_NAMES, self._instances, strict=True)
        }
        if self._instances.sum() == 0:
            return {"map_50": None, "map_50_95": None, "map_50_weighted": None, "classes": classes}
        measured = self._metric.compute()
        # overlaps, recalls, classes, sizes (the first is all), detections (the last is most)
        precision = measured["precision"][:, :, :, 0, -1]
        for row, kind in enumerate(measured["classes"].flatten().tolist()):
            if self._instances[kind]:
                by_overlap = precision[:, :, row].mean(dim=1)
                classes[CLASS_NAMES[kind]] |= {
                    "ap_50": round(float(by_overlap[0]), 4),
                    "ap_50_95": round(float(by_overlap.mean()), 4),
                }
        there = [c for c in classes.values() if c["instances"]]
        weighted = sum(c["instances"] * c["ap_50"] for c in there)
        return {
            "map_50": round(sum(c["ap_50"] for c in there) / len(there), 4),
            "map_50_95": round(sum(c["ap_50_95"] for c in there) / len(there), 4),
            "map_50_weighted": round(weighted / sum(c["instances"] for c in there), 4),
            "classes": classes,
        }
