"""Train the detector: boxes, camera pose and occupancy from pictures of a stored data set.

`fusionnet train detector` runs this: it trains on one or several data sets, calibrates and
measures on the validation groups as the robot's eye sees them, and writes a checkpoint. Of
pictures that the eye did not take (environmental views) the boxes alone are learnt; a detector
for such pictures learns nothing else (`layouts`).
"""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro

from fusionnet.blocks import EMPTY, Layout
from fusionnet.dataset.folder import read_plan
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.pictures import EYE_FRAMES
from fusionnet.dataset.reader import StoredPictures
from fusionnet.errors import InputError
from fusionnet.models.checkpoint import check_checkpoint_folder
from fusionnet.models.detectors import compact, views
from fusionnet.models.labelled_boxes import BoxPrecision
from fusionnet.models.retinanet import Batch, RetinaNet
from fusionnet.simulation import SceneRenderer
from fusionnet.training.detector_batches import AnyPictures, JoinedPictures, batches, collate
from fusionnet.training.loop import LoopConfig, Progress, fit, is_first_process
from fusionnet.training.warm_start import start_from
from fusionnet.views import Backdrops

LOSS_WEIGHTS = {
    "class": 1.0,
    "box": 1.0,
    "pose": 0.3,
    "occupancy": 0.2,
    "first_look": 0.05,
    "offset": 1.0,
    "holding": 1.0,
}
"""Fixed factors that bring the losses to like sizes after the first epoch."""

FINER = 2
"""Times the input's size: views of which boxes alone are learnt, before they are moved."""


@dataclass(frozen=True, kw_only=True)
class DetectorConfig:
    """How to train the detector.

    Attributes:
        datasets: Data sets that `fusionnet dataset build` made, to learn from; the first one's
            validation groups through the eye are measured on.
        out: Folder of the checkpoint; the log and the resumable state go to `work`.
        work: Folder for everything that is not the checkpoint.
        start: Folder of a detector whose weights are taken over where names and shapes agree.
        eye: Of the robot: the detector reads layouts through this one alone.
        layouts: Whether the camera and the layout are learnt; without, boxes alone are, in pictures
            from anywhere and of blocks of any size.
        batch: Pictures a step.
        empty: Pictures without blocks in each step besides, drawn while training.
        photographs: Folder of photographs without blocks, of which every other empty picture is a
            part; best of the place where the detector shall look.
        loop: Steps and schedule.
        seed: Source of all randomness.
    """

    datasets: tyro.conf.Positional[tuple[Path, ...]]
    out: Path = Path("runs/detector/checkpoint")
    work: Path = Path("runs/detector")
    start: Path | None = None
    eye: Literal["left_eye", "right_eye"] = "left_eye"
    layouts: bool = True
    batch: int = 16
    empty: int = 1
    photographs: Path | None = None
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=2700,
            learning_rate=1.5e-3,
            average=0.998,
            precision="bf16-mixed",
            loss_weights=LOSS_WEIGHTS,
        )
    )
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what cannot train."""
        if not self.datasets or self.batch < 1 or self.empty < 0:
            raise InputError(
                "At least one data set (fusionnet dataset build), a batch of at least 1 and "
                f"empty of at least 0 are needed; received {len(self.datasets)} data sets, "
                f"{self.batch} and {self.empty}."
            )


def train(config: DetectorConfig, *, progress: Progress | None = None) -> dict[str, Any]:
    """Train, calibrate, measure and save; returns the metrics on the validation pictures.

    Of several processes, one a device, only the first measures and saves; the others return
    nothing.

    Raises:
        OutputError: If the checkpoint cannot be written.
    """
    check_checkpoint_folder(config.out, config.work)
    model = new_detector(config.seed, eye=config.eye, layouts=config.layouts)
    pictures, checked = _pictures(config, model.frame)
    size = None if config.layouts else model.frame.input_size
    backdrops = None if config.photographs is None else Backdrops.of_folder(config.photographs)
    if config.start is not None:
        start_from(model, config.start)
    fit(
        model,
        lambda first: batches(
            pictures, config.batch, config.seed, first, config.empty, size, backdrops
        ),
        lambda wrapped, batch: detector_losses(wrapped, model, batch),
        config.loop,
        folder=config.work,
        settings=config,
        seed=config.seed,
        progress=progress,
    )
    if not is_first_process():
        return {}
    if config.layouts:
        calibrate(model, checked)
    metrics = measure(model, checked) if config.layouts else measure_boxes(model, checked)
    paths = ("datasets", "out", "work", "start", "photographs")
    described = {k: v for k, v in asdict(config).items() if k not in paths}
    described["pictures"], described["warm"] = len(pictures), config.start is not None
    described["backdrops"] = 0 if backdrops is None else len(backdrops)
    described["corpus"] = sorted({read_plan(folder).corpus for folder in config.datasets})
    model.save(config.out, {"training": described, "metrics": metrics})
    return metrics


def _pictures(config: DetectorConfig, frame: PictureFrame) -> tuple[JoinedPictures, StoredPictures]:
    """What is learnt from, and what is measured on."""
    if config.layouts:
        parts = [StoredPictures(folder, "train") for folder in config.datasets]
        checked = StoredPictures(config.datasets[0], "sim_val")
        _check_eyes(config)
        return JoinedPictures(parts), checked
    width, height = frame.input_size
    larger = (FINER * width, FINER * height)
    parts = [StoredPictures(folder, "train", input_size=larger) for folder in config.datasets]
    seen = "val" if read_plan(config.datasets[0]).views[1] else "sim_val"
    checked = StoredPictures(config.datasets[0], seen, input_size=frame.input_size)
    return JoinedPictures(parts), checked


def _check_eyes(config: DetectorConfig) -> None:
    """Refuse data sets in which another eye looks: each has its own nominal camera.

    Raises:
        InputError: If there is one.
    """
    for folder in config.datasets:
        plan = read_plan(folder)
        others = [eye for eye in plan.eyes if eye != config.eye]
        looks = plan.eyes_share > 0.0 or not plan.views[0]
        if others and looks:
            raise InputError(
                f"In {folder} the {others[0]} looks; this detector is one of the {config.eye}. "
                f"Build a data set with --eyes {config.eye}, or train with --eye {others[0]}."
            )


def new_detector(
    seed: int, robot: str = "nico", eye: str = "left_eye", layouts: bool = True
) -> RetinaNet:
    """An untrained detector for one of a robot's eyes, or of boxes alone."""
    frame = EYE_FRAMES[eye]
    config = views(frame)
    if layouts:
        renderer = SceneRenderer(robot, size=frame.eye_size)
        camera = renderer.view(Layout(()), camera=eye, labels=False).camera
        camera_from_board = camera.camera_from_robot @ renderer.robot.robot_from_board
        config = compact(frame, camera.matrix.tolist(), camera_from_board.tolist())
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return RetinaNet(config)


def detector_losses(
    wrapped: torch.nn.Module, model: RetinaNet, batch: Batch
) -> dict[str, torch.Tensor]:
    """Losses of one batch; cells are projected with the true camera, a little disturbed.

    So the occupancy head learns from the first step on, and learns to bear the errors
    that the estimated pose, used at inference, will have (about a pixel).
    """
    if not model.config.reads_layouts:
        return model.losses(wrapped(batch.images), batch)
    truth = model.pose_head.target(batch.matrix, batch.camera_from_board)
    outputs = wrapped(batch.images, truth + batch.disturbance)
    return model.losses(outputs, batch)


@torch.inference_mode()
def calibrate(model: RetinaNet, pictures: AnyPictures, most: int = 400) -> float:
    """Set and return the temperature under which the cells' probabilities fit best.

    Args:
        model: A trained detector; its configuration gets the temperature.
        pictures: Of layouts that it was not trained on.
        most: Pictures that are looked at.

    References:
        Guo et al. (2017), On calibration of modern neural networks.
    """
    logits, cells = [], []
    for start in range(0, min(len(pictures), most), 20):
        stop = min(start + 20, len(pictures), most)
        batch = collate([pictures[i] for i in range(start, stop)])
        found = model(batch.images, refine=True)["cells"].logits.flatten(0, 1)
        unsure = found.softmax(-1).amax(-1) < 1 - 1e-4  # the others say nothing of it
        logits.append(found[unsure])
        cells.append(batch.cells.flatten()[unsure])
    outputs, truth = torch.cat(logits), torch.cat(cells)
    tried = torch.linspace(0.6, 2.5, 77)
    losses = [float(torch.nn.functional.cross_entropy(outputs / t, truth)) for t in tried]
    temperature = round(float(tried[int(np.argmin(losses))]), 3) if len(truth) else 1.0
    model.config = replace(model.config, temperature=temperature)
    return temperature


@torch.inference_mode()
def measure(model: RetinaNet, pictures: AnyPictures, size: int = 25) -> dict[str, float]:
    """How well cells, poses and held blocks are read, with the estimated pose."""
    sums: dict[str, list[np.ndarray]] = {}
    for start in range(0, len(pictures), size):
        samples = [pictures[i] for i in range(start, min(start + size, len(pictures)))]
        batch = collate(samples)
        outputs = model(batch.images, refine=True)
        read = outputs["cells"]
        guess, truth = read.logits.argmax(-1).numpy(), batch.cells.numpy()
        visible = np.stack([labels.visible for _, labels in samples])
        block, right = truth != EMPTY, guess == truth
        target = model.pose_head.target(batch.matrix, batch.camera_from_board)
        found = {
            "blocks_right": right[block],
            "blocks_right_15_pixels": right[block & (visible >= 15)],
            "layout_right": right.all(axis=1),
            "phantoms": ((guess != EMPTY) & ~block).sum(axis=1),
            "pose_pixels": model.pose_head.metric([outputs["used_pose"]], target).numpy(),
            "holding_right": (read.held.numpy() > 0) == (batch.holding.numpy() > 0.5),
        }
        for name, values in found.items():
            sums.setdefault(name, []).append(np.asarray(values, dtype=float))
    return {name: float(np.concatenate(values).mean()) for name, values in sums.items()}


def measure_boxes(model: RetinaNet, pictures: AnyPictures) -> dict[str, float]:
    """How precisely a detector of boxes alone finds them."""
    precision = BoxPrecision()
    for picture, truth in (pictures[i] for i in range(len(pictures))):
        precision.update(model.detect_prepared(picture), collate([(picture, truth)]).boxes[0])
    measured = precision.compute()
    return {name: measured[name] for name in ("map_50", "map_50_95")}
