"""Train the thesis's RetinaNet on a data set, as tables 6.1 and 7.2 say.

`fusionnet train detector DATASET --preset thesis` runs this. Experiments call `train` with a
configuration of their own and take its metrics.
"""

import logging
import statistics
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
import tyro

from fusionnet.dataset.folder import read_plan
from fusionnet.errors import DataError, InputError
from fusionnet.models import backbones, detectors
from fusionnet.models.anchors import AnchorShapes, thesis_anchors
from fusionnet.models.checkpoint import check_checkpoint_folder
from fusionnet.models.labelled_boxes import BoxPrecision
from fusionnet.models.retinanet import BoxBatch, RetinaNet
from fusionnet.randomness import derived_seed, generator
from fusionnet.training.loop import LoopConfig, Progress, fit, is_first_process
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.placement_pictures import PlacementPictures, collate, moved
from fusionnet.training.schedules import ScheduleConfig
from fusionnet.views import LevelTwo

log = logging.getLogger(__name__)


def thesis_loop() -> LoopConfig:
    """SGD with momentum for 50,000 steps (4.1.2, table 6.1).

    The gradient's norm is bounded, which the thesis does not mention: a picture without
    blocks would otherwise undo what was learnt.
    """
    return LoopConfig(
        steps=50_000,
        learning_rate=0.01,
        schedule=ScheduleConfig(kind="steps", milestones=(60_000, 80_000)),
        optimizer=OptimizerConfig(kind="sgd", momentum=0.9, weight_decay=1e-4),
        clip=10.0,
        accelerator="auto",
        precision="auto",
        channels_last=True,
        log_every=100,
        save_every=1000,
    )


@dataclass(frozen=True, kw_only=True)
class ThesisDetectorConfig:
    """How to train the thesis's detector; the values are those of tables 6.1 and 7.2.

    Attributes:
        dataset: A data set that `fusionnet dataset build` made.
        out: Folder of the checkpoint; the log and the resumable state go to `work`.
        work: Folder for everything that is not the checkpoint.
        backbone: resnet50, resnet101, resnet152, or another of our backbones.
        backbone_weights: "imagenet" (torchvision's, where a network offers them), "random",
            or a safetensors file with torchvision's names.
        input_size: Width and height that pictures are fitted into, in pixels.
        anchors: Sizes of the five levels, ratios and scales.
        fusion_nodes: Nodes an anchor for FusionNet.
        width: Channels of the pyramid and of the subnets.
        depth: Convolutions of each subnet before its last.
        check: Split that is measured at the end.
        checked: Pictures of it that are measured at most.
        batch: Pictures a step.
        crop: Whether pictures are cropped to the placement region.
        noise: Whether training pictures are moved by level-2 noise.
        loop: Steps, optimiser and schedule.
        seed: Source of all randomness.
    """

    dataset: tyro.conf.Positional[Path]
    out: Path = Path("runs/thesis-detector/checkpoint")
    work: Path = Path("runs/thesis-detector")
    backbone: str = "resnet50"
    backbone_weights: str = backbones.IMAGENET
    input_size: tuple[int, int] = (990, 540)
    anchors: AnchorShapes = field(default_factory=thesis_anchors)
    fusion_nodes: int = 4
    width: int = 256
    depth: int = 4
    check: str = "val"
    checked: int = 500
    batch: int = 1
    crop: bool = True
    noise: bool = True
    loop: LoopConfig = field(default_factory=thesis_loop)
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        counts = (self.batch, self.checked, self.width, *self.input_size)
        if min(*counts, self.fusion_nodes + 1, self.depth + 1) < 1:
            raise InputError(
                "batch, checked, width and both sides of input_size >= 1, fusion_nodes and "
                f"depth >= 0; got {counts}, {self.fusion_nodes}, {self.depth}"
            )


def train(config: ThesisDetectorConfig, *, progress: Progress | None = None) -> dict[str, Any]:
    """Train, measure on the split that is checked, and save; returns the metrics.

    Of several processes, one a device, only the first measures and saves; the others return
    nothing.

    Raises:
        DataError: If the data set is not finished, is damaged, or shows no block.
        UnknownNameError: If there is no such backbone or split.
        CheckpointError: If the backbone's weights or a state to resume cannot be used.
        OutputError: If the checkpoint cannot be written.
    """
    check_checkpoint_folder(config.out, config.work)
    model, weights = new_detector(config)
    frame = model.frame
    pictures = PlacementPictures(config.dataset, "train", frame, crop=config.crop)
    checked = PlacementPictures(config.dataset, config.check, frame, crop=config.crop)
    if not any(len(pictures.boxes(index).classes) for index in range(len(pictures))):
        raise DataError(f"No picture to learn from in {config.dataset} shows a block.")
    if model.fusion_head is not None:  # it learns from FusionNet's loss alone
        model.fusion_head.requires_grad_(False)
    history = fit(
        model,
        lambda first: batches(pictures, config, first),
        box_losses,
        config.loop,
        folder=config.work,
        settings=config,
        seed=config.seed,
        progress=progress,
    )
    if not is_first_process():
        return {}
    metrics: dict[str, Any] = measure(model, checked, config.checked)
    metrics |= {"backbone_weights": weights, "loss": history[-1]["loss"] if history else None}
    described = {k: v for k, v in asdict(config).items() if k not in ("out", "work", "dataset")}
    described["corpus"] = read_plan(config.dataset).corpus
    model.save(config.out, {"training": described, "metrics": metrics}, half=False)
    return metrics


def new_detector(config: ThesisDetectorConfig) -> tuple[RetinaNet, str]:
    """An untrained detector, and where its backbone's weights came from, in words."""
    size = config.input_size
    frame = replace(detectors.THESIS_FRAME, eye_size=size, crop=(0, 0, *size), input_size=size)
    made = detectors.thesis(
        config.backbone,
        frame=frame,
        anchors=config.anchors,
        fusion_nodes=config.fusion_nodes,
        width=config.width,
        depth=config.depth,
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derived_seed(config.seed, "detector", "weights"))
        model = RetinaNet(made)
    said = backbones.fill_backbone(model.backbone, config.backbone_weights)
    if not said.startswith(backbones.RANDOM):
        filled = RetinaNet(replace(made, frozen=True))
        filled.load_state_dict(model.state_dict())
        model = filled
    return model, said


def box_losses(wrapped: torch.nn.Module, batch: BoxBatch) -> dict[str, torch.Tensor]:
    """Class and box losses of a batch, through the module that Fabric wraps."""
    inner: Any = getattr(wrapped, "module", wrapped)
    losses: dict[str, torch.Tensor] = inner.losses(wrapped(batch.images, fusion=False), batch)
    return losses


def batches(
    pictures: PlacementPictures, config: ThesisDetectorConfig, first: int
) -> Iterator[BoxBatch]:
    """Endless shuffled batches from step `first` on; the same for a resumed run.

    Raises:
        DataError: If the data set has fewer pictures than a batch.
    """
    size = min(config.batch, len(pictures))
    an_epoch = len(pictures) // size
    noise = LevelTwo()
    step = first
    while True:
        epoch, row = divmod(step, an_epoch)
        order = pictures.samples.order(config.seed, epoch)
        for start in range(row * size, an_epoch * size, size):
            rng = generator(config.seed, "level two", step)
            chosen = [pictures[int(i)] for i in order[start : start + size]]
            if config.noise:
                chosen = [moved(picture, boxes, noise, rng) for picture, boxes in chosen]
            yield collate(chosen)
            step += 1


@torch.inference_mode()
def measure(model: RetinaNet, pictures: PlacementPictures, count: int) -> dict[str, Any]:
    """Average precision (by class: table 6.2), loss and time on the first pictures of a split."""
    precision, losses, spent = BoxPrecision(), [], []
    device = next(model.parameters()).device
    for index in range(min(count, len(pictures))):
        picture, truth = pictures[index]
        images = torch.from_numpy(picture)[None].to(device)
        began = time.perf_counter()
        outputs = model(images, fusion=False)
        found = model.box_head.predict(outputs["boxes"])[0]
        spent.append(time.perf_counter() - began)
        there = replace(truth, **{k: v.to(device) for k, v in vars(truth).items()})
        named = model.losses(outputs, BoxBatch(images, [there]))
        losses.append(float(torch.stack(list(named.values())).sum()))
        precision.update(found, truth)
    return {
        "pictures": len(losses),
        "validation_loss": sum(losses) / len(losses),
        "milliseconds_a_picture": round(1000 * statistics.median(spent), 1),
        **precision.compute(),
    }
