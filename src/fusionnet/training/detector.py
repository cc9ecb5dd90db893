"""Train the detector: boxes, camera pose and occupancy from pictures of the robot's eye.

`fusionnet train detector` runs this: it renders the pictures that are missing, trains,
measures on pictures of the validation groups' layouts, and writes a checkpoint.
"""

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import tyro

from fusionnet.blocks import Layout
from fusionnet.corpora import load_corpus
from fusionnet.dataset.pictures import (
    EYE_FRAME,
    Labels,
    PicturePlan,
    Pictures,
    build_pictures,
)
from fusionnet.dataset.reader import StoredPictures
from fusionnet.models.detectors import compact
from fusionnet.models.heads.boxes import Boxes
from fusionnet.models.heads.camera_pose import PARAMETERS
from fusionnet.models.retinanet import Batch, RetinaNet
from fusionnet.randomness import generator
from fusionnet.simulation import SceneRenderer
from fusionnet.training.loop import LoopConfig, Progress, fit

log = logging.getLogger(__name__)

AnyPictures = Pictures | StoredPictures

LOSS_WEIGHTS = {"class": 1.0, "box": 1.0, "pose": 0.3, "occupancy": 0.2, "holding": 1.0}
"""Fixed factors that bring the losses to like sizes after the first epoch."""


POSE_ERROR = 0.06
"""Standard deviation of the disturbance of the true camera, in `camera_pose.UNITS`."""


@dataclass(frozen=True, kw_only=True)
class DetectorConfig:
    """How to train the detector.

    Attributes:
        dataset: A data set that `fusionnet dataset build` made, to learn from instead of
            pictures that are rendered for it.
        out: Folder of the checkpoint; pictures, log and resumable state go to `work`.
        work: Folder for everything that is not the checkpoint.
        corpus: Corpus whose training groups' layouts are varied; None invents all layouts.
        data: Folder of the corpus.
        pictures: Pictures to render for training.
        batch: Pictures a step.
        loop: Steps and schedule.
        seed: Source of all randomness.
        workers: Processes that render.
    """

    dataset: tyro.conf.Positional[Path | None] = None
    out: Path = Path("runs/detector/checkpoint")
    work: Path = Path("runs/detector")
    corpus: str | None = None
    data: Path | None = None
    pictures: int = 14_000
    batch: int = 16
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=2600, learning_rate=2e-3, average=0.998, loss_weights=LOSS_WEIGHTS
        )
    )
    seed: int = 0
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)


def train(
    config: DetectorConfig,
    *,
    progress: Progress | None = None,
    rendering: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Render, train, measure and save; returns the metrics on the validation pictures."""
    pictures, checked = _pictures(config, rendering)
    model = new_detector(config.seed)
    fit(
        model,
        lambda first: batches(pictures, config.batch, config.seed, first),
        lambda wrapped, batch: detector_losses(wrapped, model, batch),
        config.loop,
        folder=config.work,
        progress=progress,
    )
    metrics = measure(model, checked)
    described = {
        k: v for k, v in asdict(config).items() if k not in ("dataset", "out", "work", "data")
    }
    model.save(config.out, {"training": described, "metrics": metrics})
    return metrics


def _pictures(
    config: DetectorConfig, rendering: Callable[[int, int], None] | None
) -> tuple[AnyPictures, AnyPictures]:
    """Pictures to learn from and to measure on: stored ones, or rendered where missing."""
    if config.dataset is not None:
        return StoredPictures(config.dataset, "train"), StoredPictures(config.dataset, "sim_val")
    real, held_out = layouts_of(config.corpus, config.data)
    plan = PicturePlan(count=config.pictures, seed=config.seed)
    folders = {part: config.work / "pictures" / part for part in ("train", "val")}
    build_pictures(folders["train"], plan, real, workers=config.workers, progress=rendering)
    check = PicturePlan(count=500, seed=config.seed, part="val", invented=0.0)
    build_pictures(folders["val"], check, held_out, workers=config.workers, progress=rendering)
    return Pictures(folders["train"]), Pictures(folders["val"])


def layouts_of(corpus: str | None, data: Path | None) -> tuple[list[Layout], list[Layout]]:
    """Layouts of a corpus's training and validation groups, without repetition."""
    if corpus is None:
        return [], []
    loaded = load_corpus(corpus, data)
    parts: list[list[Layout]] = []
    for part in ("train", "val"):
        scenes = [command.scene for command in loaded.split(part)]
        unique = {id(layout): layout for s in scenes for layout in (s.before, s.after)}
        parts.append(sorted(unique.values(), key=lambda layout: layout.id or 0))
    return parts[0], parts[1]


def new_detector(seed: int, robot: str = "nico") -> RetinaNet:
    """An untrained detector for a robot's left eye."""
    renderer = SceneRenderer(robot, size=EYE_FRAME.eye_size)
    camera = renderer.view(Layout(()), camera="left_eye", labels=False).camera
    camera_from_board = camera.camera_from_robot @ renderer.robot.robot_from_board
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return RetinaNet(compact(EYE_FRAME, camera.matrix.tolist(), camera_from_board.tolist()))


def collate(
    samples: Sequence[tuple[np.ndarray, Labels]], rng: np.random.Generator | None = None
) -> Batch:
    """Pictures and labels as tensors; camera disturbances are drawn if there is a generator."""
    noise = np.zeros((len(samples), PARAMETERS))
    if rng is not None:
        noise = rng.normal(0.0, POSE_ERROR, noise.shape)
    images, labels = zip(*samples, strict=True)
    return Batch(
        images=torch.from_numpy(np.stack(images)),
        boxes=[
            Boxes(
                torch.from_numpy(t.boxes).float(),
                torch.from_numpy(t.classes),
                torch.ones(len(t.boxes)),
            )
            for t in labels
        ],
        cells=torch.from_numpy(np.stack([t.cells for t in labels])),
        holding=torch.tensor([float(t.holding) for t in labels]),
        matrix=torch.from_numpy(np.stack([t.matrix for t in labels])).float(),
        camera_from_board=torch.from_numpy(np.stack([t.camera_from_board for t in labels])).float(),
        disturbance=torch.from_numpy(noise).float(),
    )


def batches(pictures: AnyPictures, size: int, seed: int, first: int) -> Iterator[Batch]:
    """Endless shuffled batches from step `first` on; the same for a resumed run."""
    size = min(size, len(pictures))
    a_epoch = len(pictures) // size
    step = first
    while True:
        epoch, row = divmod(step, a_epoch)
        order = pictures.order(seed, epoch)
        for start in range(row * size, a_epoch * size, size):
            rng = generator(seed, "augment", step)
            chosen = [pictures[int(i)] for i in order[start : start + size]]
            yield collate([(_vary(image, rng), labels) for image, labels in chosen], rng)
            step += 1


def _vary(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Small changes of brightness and of the sensor, anew in every epoch."""
    gain = rng.uniform(0.9, 1.1) * rng.uniform(0.97, 1.03, 3)
    table = np.clip(np.arange(256)[:, None] * gain + rng.uniform(-8, 8), 0, 255).astype(np.uint8)
    return cv2.LUT(image, table[:, None])


def detector_losses(
    wrapped: torch.nn.Module, model: RetinaNet, batch: Batch
) -> dict[str, torch.Tensor]:
    """Losses of one batch; cells are projected with the true camera, a little disturbed.

    So the occupancy head learns from the first step on, and learns to bear the errors
    that the estimated pose, used at inference, will have (about a pixel).
    """
    truth = model.pose_head.target(batch.matrix, batch.camera_from_board)
    outputs = wrapped(batch.images, truth + batch.disturbance)
    return model.losses(outputs, batch)


@torch.inference_mode()
def measure(model: RetinaNet, pictures: AnyPictures, size: int = 25) -> dict[str, float]:
    """How well cells, poses and held blocks are read, with the estimated pose."""
    sums: dict[str, list[np.ndarray]] = {}
    for start in range(0, len(pictures), size):
        samples = [pictures[i] for i in range(start, min(start + size, len(pictures)))]
        batch = collate(samples)
        outputs = model(batch.images)
        logits, held = outputs["occupancy"]
        guess, truth = logits.argmax(-1).numpy(), batch.cells.numpy()
        visible = np.stack([labels.visible for _, labels in samples])
        block, right = truth != model.occupancy_head.empty, guess == truth
        target = model.pose_head.target(batch.matrix, batch.camera_from_board)
        found = {
            "blocks_right": right[block],
            "blocks_right_15_pixels": right[block & (visible >= 15)],
            "layout_right": right.all(axis=1),
            "phantoms": ((guess != model.occupancy_head.empty) & ~block).sum(axis=1),
            "pose_pixels": model.pose_head.metric(outputs["pose"], target).numpy(),
            "holding_right": (held.numpy() > 0) == (batch.holding.numpy() > 0.5),
        }
        for name, values in found.items():
            sums.setdefault(name, []).append(np.asarray(values, dtype=float))
    return {name: float(np.concatenate(values).mean()) for name, values in sums.items()}
