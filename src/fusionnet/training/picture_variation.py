"""Each stored picture looks different in every epoch."""

from dataclasses import replace

import cv2
import numpy as np
import torch
from jaxtyping import UInt8

from fusionnet.dataset.pictures import Labels
from fusionnet.models.labelled_boxes import Boxes
from fusionnet.training.placement_pictures import moved
from fusionnet.views import LevelTwo

ZOOM = LevelTwo(rotation=0.0, translation=0.1, shear=0.0, scale=(0.6, 1.9))
"""Of views: blocks from half to twice as large as where the whole grid fits in the picture."""

WIDE = replace(ZOOM, scale=(0.45, 2.6))
"""Of a detector of boxes alone: from a board across the table to one that is held up."""

_MOVED = 0.6
"""Share of the views that are flipped and zoomed."""


def varied(
    image: UInt8[np.ndarray, "h w 3"], labels: Labels, rng: np.random.Generator
) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
    """Another brightness and sensor; views, of which boxes alone are learnt, move besides."""
    if not labels.by_eye and rng.random() < _MOVED:
        image, labels = _moved(image, labels, ZOOM, rng)
    return _developed(image, rng), labels


def varied_view(
    image: UInt8[np.ndarray, "h w 3"],
    labels: Labels,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> tuple[UInt8[np.ndarray, "h2 w2 3"], Labels]:
    """The same of a picture of which boxes alone are learnt: always moved, by `WIDE`.

    Args:
        image: Larger than what is wanted, so that what comes nearer stays sharp.
        labels: Of it.
        size: Width and height that are wanted, in pixels.
        rng: Source of all randomness.
    """
    scale = float(np.exp(rng.uniform(*np.log(WIDE.scale))))
    if scale < 1.0:  # what goes away is averaged
        shrunk = np.array(size) / image.shape[1::-1]
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        labels = replace(labels, boxes=labels.boxes * np.tile(shrunk, 2))
    image, labels = _moved(image, labels, replace(WIDE, scale=(scale, scale)), rng, size)
    return _developed(image, rng), labels


def _developed(
    image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """Of another brightness and another white balance."""
    gain = rng.uniform(0.9, 1.1) * rng.uniform(0.97, 1.03, 3)
    table = np.clip(np.arange(256)[:, None] * gain + rng.uniform(-8, 8), 0, 255).astype(np.uint8)
    developed: np.ndarray = cv2.LUT(image, table[:, None])
    return developed


def _moved(
    image: UInt8[np.ndarray, "h w 3"],
    labels: Labels,
    noise: LevelTwo,
    rng: np.random.Generator,
    size: tuple[int, int] | None = None,
) -> tuple[UInt8[np.ndarray, "h2 w2 3"], Labels]:
    """Mirrored, upside down, nearer or farther."""
    height, width = image.shape[:2]
    boxes = labels.boxes.astype(float)
    if rng.random() < 0.5:
        image = image[:, ::-1]
        boxes = np.column_stack(
            [width - boxes[:, 2], boxes[:, 1], width - boxes[:, 0], boxes[:, 3]]
        )
    if rng.random() < 0.3:
        image = image[::-1]
        boxes = np.column_stack(
            [boxes[:, 0], height - boxes[:, 3], boxes[:, 2], height - boxes[:, 1]]
        )
    whole = Boxes(torch.from_numpy(boxes), torch.from_numpy(labels.classes), torch.ones(len(boxes)))
    image, kept = moved(np.ascontiguousarray(image), whole, noise, rng, size)
    return image, replace(
        labels,
        by_eye=False,
        boxes=kept.xyxy.double().numpy(),
        classes=kept.classes.numpy(),
        hidden=np.zeros(len(kept.classes), dtype=bool),
    )
