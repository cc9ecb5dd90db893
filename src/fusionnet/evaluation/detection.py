"""How well blocks are found, and layouts read, in pictures through a robot's eye or in views.

Pictures are those of a stored data set, or rendered of layouts of one part of a corpus, in
looks that no training picture had. Boxes of blocks of which less than a quarter is visible are
counted in one mean average precision, and in the other left out as COCO leaves out crowds:
neither finding nor missing them counts.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
import tyro
from jaxtyping import Float, UInt8

from fusionnet.blocks import EMPTY
from fusionnet.blocks.voting import likely_layout
from fusionnet.corpora import Part, load_corpus
from fusionnet.dataset.folder import read_plan
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.pictures import EYE_FRAMES, Labels, label
from fusionnet.dataset.plan import SPLITS
from fusionnet.dataset.reader import StoredPictures
from fusionnet.errors import CheckpointError, DataError, InputError
from fusionnet.models.labelled_boxes import Boxes, BoxPrecision
from fusionnet.models.retinanet import RetinaNet, Sight
from fusionnet.policy import detector_folder, view_detector_folder
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.training.placement_pictures import PlacementPictures
from fusionnet.training.thesis_detector import measure

CLEARLY_EMPTY = 0.999
"""Cells that are empty with more than this say nothing of the calibration."""

CLEARLY_VISIBLE = 15
"""Pixels of the eye's picture from which on a block should be read right."""


@dataclass(frozen=True, kw_only=True)
class DetectionEvaluation:
    """What to measure.

    Attributes:
        dataset: A data set that `fusionnet dataset build` made, whose pictures are looked at;
            without, layouts of a corpus are rendered through the detector's eye.
        corpus: Where the layouts come from.
        data: Folder of the corpus's files.
        split: Part of the corpus (train, val or test), or split of the data set.
        checkpoint: A shipped name, a folder that holds the checkpoint `detector`, or a detector's
            own folder.
        pictures: How many at most; a corpus's layouts are shown again, in other looks, if there
            are fewer.
        seed: Of the looks.
    """

    dataset: tyro.conf.Positional[Path | None] = None
    corpus: str = "treebank"
    data: Path | None = None
    split: Literal["train", "val", "test", "sim_val", "sim"] = "test"
    checkpoint: str = "compact"
    pictures: int = 300
    seed: int = 0


def evaluate(
    config: DetectionEvaluation, *, progress: Callable[[int, int], None] | None = None
) -> dict[str, Any]:
    """Mean average precision of the boxes, and how many cells and layouts are read right.

    Layouts are read through the eye that the detector is one of; in environmental views boxes are
    found, by the detector that the policy has for them.

    Raises:
        InputError: If no pictures are asked for, the part has no commands, or in the data set
            another eye looks than the detector's.
        CheckpointError: If the detector is missing or damaged, or reads layouts through no eye
            that we know.
        DataError: If the data set is not finished, damaged, of another schema, or has other
            classes, or if no picture shows a block.
        UnknownNameError: If it has no such split.
    """
    if config.pictures < 1:
        raise InputError(f"At least one picture is needed; received {config.pictures}.")
    model = RetinaNet.from_folder(detector_folder(config.checkpoint))
    if not model.config.reads_layouts:
        if config.dataset is None:
            raise InputError(
                "This detector finds boxes only; it is measured on a data set: fusionnet evaluate "
                "detector DATASET."
            )
        if model.config.pyramid != "small":
            return _thesis_boxes(config, config.dataset, model)
    elsewhere = RetinaNet.from_folder(view_detector_folder(config.checkpoint))
    count, pictures = _pictures(config, model)
    strict, lenient = BoxPrecision(), BoxPrecision()
    counted: dict[str, list[np.ndarray]] = {}
    confidence: list[np.ndarray] = []
    spent: list[float] = []
    for index, (picture, truth) in enumerate(pictures):
        began = time.perf_counter()
        if truth.by_eye and model.config.reads_layouts:
            sight = model.see_prepared(picture)
            found = _in_input(sight.boxes, model.frame)
            for name, values in _cells(sight, truth).items():
                counted.setdefault(name, []).append(values)
            confidence.append(_confidence(sight, truth))
        else:
            found = elsewhere.detect_prepared(picture)
        spent.append(time.perf_counter() - began)
        wanted = Boxes(
            torch.from_numpy(truth.boxes).float(),
            torch.from_numpy(truth.classes),
            torch.ones(len(truth.classes)),
        )
        strict.update(found, wanted)
        lenient.update(found, wanted, torch.from_numpy(truth.hidden))
        if progress is not None:
            progress(index + 1, count)
    joined = {name: np.concatenate(values) for name, values in counted.items()}
    shares = {n: round(float(v.mean()), 4) if len(v) else None for n, v in joined.items()}
    if confidence:
        shares["calibration_error"] = round(calibration_error(np.concatenate(confidence)), 4)
    precise = strict.compute()
    _refuse_without_boxes(precise, config)
    return {
        "corpus": config.corpus if config.dataset is None else str(config.dataset.name),
        "split": config.split,
        "n": count,
        **precise,
        "without_mostly_hidden_blocks": lenient.compute(),
        **shares,
        "milliseconds_a_picture": round(1000 * float(np.median(spent)), 1),
    }


def _thesis_boxes(config: DetectionEvaluation, dataset: Path, model: RetinaNet) -> dict[str, Any]:
    """What is said of the thesis's detector, whose pictures are cropped as the thesis's were."""
    pictures = PlacementPictures(dataset, config.split, model.frame)
    measured = measure(model, pictures, config.pictures)
    _refuse_without_boxes(measured, config)
    about = {"corpus": str(dataset.name), "split": config.split}
    return about | {"n": measured.pop("pictures")} | measured


def _refuse_without_boxes(measured: dict[str, Any], config: DetectionEvaluation) -> None:
    if measured["map_50"] is None:
        where = config.corpus if config.dataset is None else config.dataset
        raise DataError(
            f"The pictures of {config.split!r} in {where} show no block: there are no boxes to "
            "measure against."
        )


def _pictures(
    config: DetectionEvaluation, model: RetinaNet
) -> tuple[int, Iterator[tuple[UInt8[np.ndarray, "h w 3"], Labels]]]:
    """How many pictures there are to look at, and the pictures."""
    if config.dataset is not None:
        if model.config.reads_layouts:
            _check_eye(config.dataset, config.split, _eye(model))
        size = model.frame.input_size
        stored = StoredPictures(config.dataset, config.split, input_size=size)
        count = min(config.pictures, len(stored))
        return count, (stored[i] for i in range(count))
    if config.split not in get_args(Part):
        raise InputError(f"The split {config.split!r} is one of data sets: name a data set.")
    scenes = [c.scene for c in load_corpus(config.corpus, config.data).split(config.split)]
    layouts = list({id(layout): layout for s in scenes for layout in (s.before, s.after)}.values())
    if not layouts:
        raise InputError(f"The corpus {config.corpus!r} has no commands in {config.split!r}.")
    renderer, eye = SceneRenderer("nico", size=model.frame.eye_size), _eye(model)
    looks = (
        Appearance.sample(generator(config.seed, "detection", config.split, index))
        for index in range(config.pictures)
    )
    return config.pictures, (
        label(renderer, layouts[index % len(layouts)], look, model.frame, eye)
        for index, look in enumerate(looks)
    )


def _eye(model: RetinaNet) -> str:
    """The robot's eye through which a detector reads layouts: the one that its crop is of."""
    for eye, frame in EYE_FRAMES.items():
        if model.frame.crop == frame.crop:
            return eye
    known = ", ".join(f"{frame.crop} ({eye})" for eye, frame in EYE_FRAMES.items())
    raise CheckpointError(
        f"This detector looks at the part {model.frame.crop} of a picture, which is no eye's; "
        f"known are {known}. Train one with fusionnet train detector."
    )


def _check_eye(dataset: Path, split: str, eye: str) -> None:
    """Refuse a split in which another eye looks: each has its own nominal camera."""
    plan = read_plan(dataset)
    others = [other for other in plan.eyes if other != eye]
    in_views = plan.views[0] and SPLITS[split][1] != "eyes"
    if others and not (in_views and (split != "train" or plan.eyes_share == 0.0)):
        raise InputError(
            f"In {dataset} the {others[0]} looks; this detector is one of the {eye}. Build a data "
            f"set with --eyes {eye}, or measure a detector of the {others[0]} (--checkpoint)."
        )


def _in_input(boxes: Boxes, frame: PictureFrame) -> Boxes:
    """Boxes of the eye's picture in pixels of the network's input."""
    xyxy = torch.from_numpy(frame.to_input(boxes.xyxy.double().numpy()))
    return Boxes(xyxy, boxes.classes, boxes.scores)


def calibration_error(confidence: Float[np.ndarray, "n 2"], bins: int = 10) -> float:
    """Expected calibration error: how far probabilities are from the share that is right.

    Args:
        confidence: Probability of the chosen class, and 1 where it is right, of each cell.
        bins: Of equal width.

    References:
        Naeini et al. (2015), Obtaining well calibrated probabilities using Bayesian binning.
    """
    chosen = np.minimum((confidence[:, 0] * bins).astype(int), bins - 1)
    gaps = [
        np.abs((confidence[chosen == b, 0] - confidence[chosen == b, 1]).sum()) for b in range(bins)
    ]
    return float(sum(gaps) / max(len(confidence), 1))


def _confidence(sight: Sight, truth: Labels) -> Float[np.ndarray, "n 2"]:
    """Probability and truth of each cell that holds a block or may: not of the clearly empty."""
    cells = sight.cells.reshape(512, -1)
    guess = cells.argmax(1)
    asked = (truth.cells != EMPTY) | (cells[:, EMPTY] < CLEARLY_EMPTY)
    return np.column_stack([cells.max(1), guess == truth.cells])[asked]


def _cells(sight: Sight, truth: Labels) -> dict[str, np.ndarray]:
    """What is right of the likeliest layout that can stand, which is the one that is answered."""
    guess = likely_layout(sight.cells, sight.holding).cell_classes.reshape(512)
    block = truth.cells != EMPTY
    clear = block & (truth.visible >= CLEARLY_VISIBLE)
    right = guess == truth.cells
    return {
        "blocks_right": right[block],
        "clearly_visible_blocks_right": right[clear],
        "phantoms_a_picture": np.array([float(((guess != EMPTY) & ~block).sum())]),
        "layouts_right": np.array([float(right.all())]),
        "layouts_all_clear": np.array([float((clear == block).all())]),
        "layouts_right_if_all_clear": np.full(int((clear == block).all()), float(right.all())),
        "holding_right": np.array([float((sight.holding > 0.5) == truth.holding)]),
    }
