"""Detectors of the thesis's structure as the experiments 6.2 and 6.3 train them, at three sizes."""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from safetensors.torch import save

from fusionnet.experiments._experiment import Outcome, Scale, Trial
from fusionnet.experiments._vision import CHECKED, pictures_for
from fusionnet.files import write_whole
from fusionnet.models.anchors import AnchorShapes
from fusionnet.models.detectors import THESIS_FRAME
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import weights_folder
from fusionnet.training.journal import read_lines
from fusionnet.training.loop import LoopConfig
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.thesis_detector import ThesisDetectorConfig, thesis_loop, train

COMPACT = "compact"


@dataclass(frozen=True, kw_only=True)
class Size:
    """How large a detector's training is.

    Attributes:
        train, checked: Pictures to learn from and to measure.
        stored: Width and height of the stored pictures, in pixels.
        input: Width and height of the network's input, in pixels.
        width, depth: Of the subnets.
        batch, steps: Pictures a step, and steps.
    """

    train: int
    checked: int
    stored: tuple[int, int]
    input: tuple[int, int]
    width: int = 64
    depth: int = 2
    batch: int = 4
    steps: int


def loop_of(scale: Scale, size: Size) -> LoopConfig:
    """The thesis's recipe; at smaller scales AdamW, one cycle and bfloat16, for want of time."""
    if scale == "thesis":
        return replace(thesis_loop(), steps=size.steps)
    return LoopConfig(
        steps=size.steps,
        learning_rate=1e-3,
        optimizer=OptimizerConfig(kind="adamw", weight_decay=1e-4),
        clip=10.0,
        precision="bf16-mixed",
        channels_last=True,
        log_every=max(1, size.steps // 20),
        save_every=25,
        tensorboard=False,
    )


def trained(
    trial: Trial, size: Size, *, backbone: str, weights: str, anchors: AnchorShapes
) -> Outcome:
    """Train on the scale's pictures, and measure on layouts and looks that were not learnt from.

    Args:
        trial: With its seed; a killed one goes on from its state.
        size: How large.
        backbone: Name in `models.backbones`.
        weights: What the backbone begins with; `COMPACT` is what the shipped detector's learnt.
        anchors: For pictures of 990 x 540; scaled to the input.
    """
    if trial.scale != "thesis":
        torch.set_num_threads(1)
    views = "rooms" if trial.scale == "thesis" else None
    folder = pictures_for(trial, size.train, size.checked, size.stored, views=views)
    if weights == COMPACT:
        weights = str(_compact_backbone(trial.work))
    scale = size.input[0] / THESIS_FRAME.input_size[0]
    config = ThesisDetectorConfig(
        dataset=folder,
        out=trial.state / "checkpoint",
        work=trial.state,
        backbone=backbone,
        backbone_weights=weights,
        input_size=size.input,
        anchors=replace(anchors, sizes=tuple(scale * side for side in anchors.sizes)),
        fusion_nodes=0,
        width=size.width,
        depth=size.depth,
        check="val" if trial.scale == "thesis" else CHECKED,
        checked=size.checked,
        batch=size.batch,
        loop=loop_of(trial.scale, size),
        seed=trial.seed,
    )
    measured = train(config, progress=trial.progress)
    lines = read_lines(trial.state, size.steps)
    classes = measured.pop("classes")
    weights_said = measured.pop("backbone_weights")
    last = measured.pop("loss")
    precise = {f"ap_50_{name}": c["ap_50"] for name, c in classes.items() if c["instances"]}
    return Outcome(
        metrics={k: float(v) for k, v in (measured | {"training_loss": last} | precise).items()},
        configuration={
            "backbone": backbone,
            "backbone_weights": weights_said,
            "train": size.train,
            "input": size.input,
            "anchors": list(config.anchors.sizes),
            "ratios": list(config.anchors.ratios),
            "width": size.width,
            "depth": size.depth,
            "batch": size.batch,
            "steps": size.steps,
            "optimizer": config.loop.optimizer.kind,
            "learning_rate": config.loop.learning_rate,
            "precision": config.loop.precision,
            "checked": config.check,
        },
        curves={name: [float(line[name]) for line in lines] for name in ("step", "class", "box")},
        details={"classes": classes},
    )


def _compact_backbone(work: Path) -> Path:
    """The backbone of the shipped detector in a file of its own."""
    shipped = RetinaNet.from_folder(weights_folder("compact") / "detector")
    write_whole(work / "compact-backbone.safetensors", save(shipped.backbone.state_dict()))
    return work / "compact-backbone.safetensors"
