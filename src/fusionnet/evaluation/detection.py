"""How well blocks are found, and layouts read, in pictures through the robot's eye.

Pictures are rendered of layouts of one part of a corpus, in looks that no training
picture had.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torchmetrics.detection import MeanAveragePrecision

from fusionnet.blocks import CLASS_NAMES
from fusionnet.corpora import load_corpus
from fusionnet.dataset.pictures import EMPTY, Labels, label
from fusionnet.errors import InputError
from fusionnet.models.retinanet import RetinaNet, Sight
from fusionnet.policy import weights_folder
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer

CLEARLY_VISIBLE = 15
"""Pixels of the eye's picture from which on a block should be read right."""


@dataclass(frozen=True, kw_only=True)
class DetectionEvaluation:
    """What to measure.

    Attributes:
        corpus: Where the layouts come from.
        data: Folder of the corpus's files.
        split: Part of the corpus: train, val or test.
        checkpoint: A shipped name, or a folder that holds the checkpoint `detector`.
        pictures: How many; layouts are shown again, in other looks, if there are fewer.
        seed: Of the looks.
    """

    corpus: str = "treebank"
    data: Path | None = None
    split: Literal["train", "val", "test"] = "test"
    checkpoint: str = "compact"
    pictures: int = 300
    seed: int = 0


def evaluate(
    config: DetectionEvaluation, *, progress: Callable[[int, int], None] | None = None
) -> dict[str, Any]:
    """Mean average precision of the boxes, and how many cells and layouts are read right.

    Raises:
        InputError: If no pictures are asked for, or the part has no commands.
    """
    if config.pictures < 1:
        raise InputError(f"At least one picture is needed; received {config.pictures}.")
    scenes = [c.scene for c in load_corpus(config.corpus, config.data).split(config.split)]
    layouts = list({id(layout): layout for s in scenes for layout in (s.before, s.after)}.values())
    if not layouts:
        raise InputError(f"The corpus {config.corpus!r} has no commands in {config.split!r}.")
    model = RetinaNet.from_folder(weights_folder(config.checkpoint) / "detector")
    renderer = SceneRenderer("nico", size=model.frame.eye_size)
    precision = MeanAveragePrecision(backend="faster_coco_eval", class_metrics=True)
    precision.warn_on_many_detections = False
    counted: dict[str, list[np.ndarray]] = {}
    for index in range(config.pictures):
        layout = layouts[index % len(layouts)]
        look = Appearance.sample(generator(config.seed, "detection", config.split, index))
        picture, truth = label(renderer, layout, look, model.frame)
        sight = model.see_prepared(picture)
        precision.update([_predicted(sight)], [_wanted(truth, model)])
        for name, values in _cells(sight, truth).items():
            counted.setdefault(name, []).append(values)
        if progress is not None:
            progress(index + 1, config.pictures)
    shares = {n: round(float(np.concatenate(v).mean()), 4) for n, v in counted.items()}
    found = precision.compute()
    kinds = np.atleast_1d(found["classes"].numpy())
    return {
        "corpus": config.corpus,
        "split": config.split,
        "n": config.pictures,
        "map_50": round(float(found["map_50"]), 4),
        "map_50_95": round(float(found["map"]), 4),
        "map_50_95_by_class": {
            CLASS_NAMES[int(kind)]: round(float(value), 4)
            for kind, value in zip(kinds, np.atleast_1d(found["map_per_class"]), strict=True)
        },
        **shares,
    }


def _predicted(sight: Sight) -> dict[str, torch.Tensor]:
    boxes = sight.boxes
    return {"boxes": boxes.xyxy.float(), "scores": boxes.scores, "labels": boxes.classes}


def _wanted(truth: Labels, model: RetinaNet) -> dict[str, torch.Tensor]:
    boxes = model.frame.to_eye(truth.boxes.astype(float))
    return {"boxes": torch.from_numpy(boxes).float(), "labels": torch.from_numpy(truth.classes)}


def _cells(sight: Sight, truth: Labels) -> dict[str, np.ndarray]:
    guess = sight.cells.reshape(512, -1).argmax(1)
    block = truth.cells != EMPTY
    clear = block & (truth.visible >= CLEARLY_VISIBLE)
    right = guess == truth.cells
    return {
        "blocks_right": right[block],
        "clearly_visible_blocks_right": right[clear],
        "phantoms_a_picture": np.array([float(((guess != EMPTY) & ~block).sum())]),
        "layouts_right": np.array([float(right.all())]),
        "layouts_right_if_all_clear": np.full(int((clear == block).all()), float(right.all())),
        "holding_right": np.array([float((sight.holding > 0.5) == truth.holding)]),
    }
