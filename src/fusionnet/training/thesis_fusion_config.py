"""How to train the thesis's FusionNet: table 7.3, and the same architecture for a CPU."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import tyro

from fusionnet.errors import InputError
from fusionnet.models import backbones, heads
from fusionnet.models.anchors import AnchorShapes
from fusionnet.models.target_text import Writes
from fusionnet.models.thesis_fusion_config import THESIS_HEADS, NetworkSizes
from fusionnet.training.loop import LoopConfig
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.schedules import ScheduleConfig


def thesis_loop() -> LoopConfig:
    """Adam and the plateau of table 7.3; the losses of all heads with the factor 1 (7.1)."""
    return LoopConfig(
        steps=32_000,
        learning_rate=1e-5,
        schedule=ScheduleConfig(
            kind="plateau", factor=0.1, check_every=1000, patience=2, monitor="joints"
        ),
        optimizer=OptimizerConfig(
            kind="adam", beta_1=0.9, beta_2=0.999, epsilon=1e-9, weight_decay=0.0
        ),
        clip=10.0,
        loss_weights=dict.fromkeys(heads.names(), 1.0),
        accelerator="auto",
        log_every=100,
        save_every=1000,
    )


def small_loop() -> LoopConfig:
    """Like `thesis_loop`, with a rate that gets somewhere in thousands of steps, not millions."""
    thesis = thesis_loop()
    return replace(
        thesis,
        steps=3000,
        learning_rate=1e-3,
        schedule=replace(thesis.schedule, check_every=300),
        accelerator="cpu",
    )


def small_sizes() -> NetworkSizes:
    """The same architecture for minutes on a CPU: pictures of 160 x 88, a tiny backbone."""
    return NetworkSizes(
        backbone="tiny",
        backbone_weights=backbones.RANDOM,
        input_size=(160, 88),
        anchors=AnchorShapes(sizes=(7.0, 9.0, 14.0, 18.0, 24.0), ratios=(17 / 20, 1.0, 11 / 10)),
        pyramid_width=32,
        subnet_depth=2,
        gaussian=False,
        longest=48,
        layers=2,
        heads=2,
        feed_forward_size=128,
        dropout=0.1,
    )


@dataclass(frozen=True, kw_only=True)
class ThesisFusionConfig:
    """How to train the thesis's FusionNet; the values are those of table 7.3.

    Attributes:
        dataset: A data set that `fusionnet dataset build` made.
        out: Folder of the checkpoint; the log and the resumable state go to `work`.
        work: Folder for everything that is not the checkpoint.
        sizes: Of both networks.
        vision: `retinanet`, or the thesis's plain `cnn` (7.3).
        writes: What the Transformer writes: the tree's text, its short form, or `english` (7.3).
        fuser: Name in `models.fusers`.
        outputs: Names in `models.heads`; what is left out has no loss and costs no time (7.1).
        detector: Checkpoint of a trained RetinaNet to begin with (7.5).
        translator: Checkpoint of a trained Transformer to begin with, with its vocabularies.
        check: Splits that are measured at the end.
        checked: Samples of each that are measured at most.
        episodes: Samples of each split of `check` but train that are executed in the simulator.
        batch: Samples a step.
        crop: Whether pictures are cropped to the placement region.
        noised_pictures: Whether three of four training pictures are moved by level-two noise, their
            boxes with them, or none (figure 4.5).
        noised_sentences: Whether one of four sentences is drawn, or always the clean one.
        keep: Whether pictures stay in memory once they are read.
        loop: Steps, optimiser, schedule, and the factor of each loss.
        seed: Source of all randomness.
        threads: Of PyTorch; 0 leaves it as it is.
    """

    dataset: tyro.conf.Positional[Path]
    out: Path = Path("runs/thesis-fusion/checkpoint")
    work: Path | None = Path("runs/thesis-fusion")
    sizes: NetworkSizes = field(default_factory=NetworkSizes)
    vision: Literal["retinanet", "cnn"] = "retinanet"
    writes: Writes = "rcl"
    fuser: str = "concatenate"
    outputs: tuple[str, ...] = THESIS_HEADS
    detector: Path | None = None
    translator: Path | None = None
    check: tuple[str, ...] = ("train", "sim_val", "sim")
    checked: int = 500
    episodes: int = 0
    batch: int = 1
    crop: bool = True
    noised_pictures: bool = True
    noised_sentences: bool = True
    keep: bool = False
    loop: LoopConfig = field(default_factory=thesis_loop)
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        if self.batch < 1 or self.checked < 1 or self.episodes < 0 or self.threads < 0:
            raise InputError(
                "batch and checked are at least 1, episodes and threads at least 0; received "
                f"{self.batch}, {self.checked}, {self.episodes}, {self.threads}."
            )


@dataclass(frozen=True, kw_only=True)
class SmallThesisFusionConfig(ThesisFusionConfig):
    """The same for a CPU: small pictures and networks, and a tree's values instead of its text."""

    sizes: NetworkSizes = field(default_factory=small_sizes)
    writes: Writes = "short"
    batch: int = 16
    keep: bool = True
    loop: LoopConfig = field(default_factory=small_loop)
