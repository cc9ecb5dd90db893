"""Train the compact FusionNet as one network, from pictures and sentences to joint values.

`fusionnet train fusion DATASET --preset end-to-end` runs this: it begins with the parts of a
trained policy and goes on with the losses of what the arm does, through everything. The
intermediate representations (boxes, camera pose, occupancy, tree) keep their own losses or
lose them, as `representations` says; at inference they are there in any case.

References:
    Thesis, 4.3.2 (one loss for each output) and 7.1 (representations on and off).
"""

import logging
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import torch
import tyro
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import binary_cross_entropy, mse_loss

from fusionnet.blocks import EMPTY
from fusionnet.dataset.folder import read_plan
from fusionnet.errors import DataError, InputError
from fusionnet.files import check_folder, check_new_folder, folder_whole
from fusionnet.models.end_to_end import EndToEnd, Taught
from fusionnet.models.fusionnet import FusionNet
from fusionnet.models.policy_folder import OPTIONAL, weights_folder, write_policy_card
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.translator import Translator
from fusionnet.training import detector
from fusionnet.training.eye_commands import EndToEndBatch, EyeCommands
from fusionnet.training.loop import LoopConfig, Progress, fit, is_first_process
from fusionnet.training.translator import symbol_losses

log = logging.getLogger(__name__)

Representation = Literal["boxes", "pose", "occupancy", "tree"]

LOSSES: Mapping[Representation, tuple[str, ...]] = {
    "boxes": ("class", "box"),
    "pose": ("pose",),
    "occupancy": ("occupancy", "first_look", "offset", "holding"),
    "tree": ("symbols", "words"),
}
"""The losses that teach each intermediate representation; of these, those that a detector has."""

LOSS_WEIGHTS = {
    **detector.LOSS_WEIGHTS,
    "symbols": 1.0,
    "words": 0.3,
    "grasp": 1.0,
    "place": 1.0,
    "holds": 0.1,
    "joints": 3.0,
}
"""Fixed factors: those with which the parts were trained apart."""

LEAST = 1e-6
"""Least probability, so that logarithms stay finite."""

SMOOTHING = 0.03
"""Share of probability that the symbols' targets give away, as where the translator is trained."""


@dataclass(frozen=True, kw_only=True)
class EndToEndConfig:
    """How to train the parts of a policy as one network.

    Attributes:
        dataset: A data set of the robot's left eye that `fusionnet dataset build` made.
        start: Policy to begin with: a shipped name, or a folder of checkpoints.
        out: Folder of the new policy; the log and the resumable state go to `work`.
        work: Folder for everything that is not the policy.
        representations: Which intermediate representations keep losses of their own.
        readings: Trees that the translator proposes for each sentence.
        batch: Samples a step.
        checked: Samples of the split `sim_val` that are measured before and after.
        loop: Steps and schedule.
        seed: Source of all randomness.
        threads: Of PyTorch; 0 leaves it as it is.
    """

    dataset: tyro.conf.Positional[Path]
    start: str = "compact"
    out: Path = Path("runs/end-to-end/policy")
    work: Path = Path("runs/end-to-end")
    representations: tuple[Representation, ...] = get_args(Representation)
    readings: int = 4
    batch: int = 8
    checked: int = 200
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=1000,
            learning_rate=1e-4,
            average=0.99,
            precision="bf16-mixed",
            loss_weights=LOSS_WEIGHTS,
        )
    )
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        if min(self.batch, self.readings, self.checked) < 1 or self.threads < 0:
            raise InputError(
                "batch, readings and checked are at least 1, threads at least 0; received "
                f"{self.batch}, {self.readings}, {self.checked}, {self.threads}."
            )
        if self.loop.accelerator != "cpu":  # trees are searched for there
            raise InputError(f"One graph trains on a cpu, not on {self.loop.accelerator!r}.")


def end_to_end_losses(
    wrapped: torch.nn.Module,
    model: EndToEnd,
    batch: EndToEndBatch,
    representations: tuple[Representation, ...] = get_args(Representation),
) -> dict[str, Tensor]:
    """Named losses: what the arm does, and those of the representations asked for.

    - `grasp`, `place`: cross-entropy of the cells
    - `holds`: binary cross-entropy of the block ending held
    - `joints`: mean squared error of the fourteen scaled values (thesis 4.3.2)
    - the others are those of the detector and the translator, see `LOSSES`

    Where the pose is learnt, cells are projected with the true camera, a little disturbed, as
    where the detector is trained alone; where it is not, with the estimated one. Sentences of
    which no reading can be carried out teach nothing about the move.
    """
    deviation = None
    if "pose" in representations:
        truth = model.detector.pose_head.target(batch.seen.matrix, batch.seen.camera_from_board)
        deviation = truth + batch.seen.disturbance
    taught = batch.taught if "tree" in representations else None
    outputs = wrapped(
        batch.seen.images,
        batch.sentences,
        deviation,
        None if taught is None else Taught(taught.sentences, taught.given),
    )
    found: dict[str, Tensor] = model.detector.losses(outputs.seen, batch.seen)
    if taught is not None:
        logits, scores = outputs.written
        found |= symbol_losses(logits, scores, taught, SMOOTHING)
    wanted = {loss for name in representations for loss in LOSSES[name]}
    found = {name: loss for name, loss in found.items() if name in wanted}
    expected = outputs.expected
    rows = expected.answered.nonzero()[:, 0]
    share = len(rows) / len(batch.source)
    told = {
        "grasp": _entropy(expected.source[rows], batch.source[rows]),
        "place": _entropy(expected.target[rows], batch.target[rows]),
        "holds": binary_cross_entropy(expected.ends_held[rows].clamp(0, 1), batch.ends[rows]),
        "joints": mse_loss(expected.joints[rows], batch.joints(model)[rows]),
    }
    nothing = expected.joints.sum() * 0
    return found | {n: share * loss if share else nothing for n, loss in told.items()}


def _entropy(found: Float[Tensor, "n 512"], cells: Int[Tensor, " n"]) -> Tensor:
    return -found.gather(1, cells[:, None]).clamp(min=LEAST).log().mean()


def train(config: EndToEndConfig, *, progress: Progress | None = None) -> dict[str, Any]:
    """Train, write the policy, and return what it can do before and after.

    Of several processes, one a device, only the first measures and saves; the others return
    nothing.

    Raises:
        DataError: If the data set is not finished, or damaged.
        InputError: If it has pictures of another camera than the left eye.
        CheckpointError: If the policy to begin with, or a state to resume, cannot be used.
        OutputError: If the policy cannot be written.
    """
    check_new_folder(config.out)
    check_folder(config.work)
    learnt, checked = EyeCommands(config.dataset, "train"), EyeCommands(config.dataset, "sim_val")
    model, before, measured = run(config, learnt, checked, progress=progress)
    if not is_first_process():
        return {}
    metrics = {"before": before, "after": measured}
    here = ("out", "work", "dataset")
    described = {k: v for k, v in asdict(config).items() if k not in here}
    described |= {"corpus": read_plan(config.dataset).corpus, "samples": len(learnt)}
    save(model, config, {"training": described, "metrics": metrics})
    return metrics


def run(
    config: EndToEndConfig,
    learnt: EyeCommands,
    checked: EyeCommands,
    *,
    progress: Progress | None = None,
) -> tuple[EndToEnd, dict[str, float], dict[str, float]]:
    """Train without saving: the network, and what was measured before and after."""
    if config.threads:
        torch.set_num_threads(config.threads)
    model = load(config.start, readings=config.readings)
    for commands in (learnt, checked):
        commands.seen_by(model.detector.frame)
    before = measure(model, checked, config.checked) if is_first_process() else {}
    fit(
        model,
        lambda first: learnt.batches(model.translator, config.batch, config.seed, first),
        lambda wrapped, batch: end_to_end_losses(wrapped, model, batch, config.representations),
        config.loop,
        folder=config.work,
        settings=config,
        seed=config.seed,
        progress=progress,
    )
    after = measure(model, checked, config.checked) if is_first_process() else {}
    return model, before, after


def load(start: str | Path, *, readings: int = 4) -> EndToEnd:
    """A policy's detector of the left eye, translator and FusionNet as one network.

    Raises:
        UnknownNameError: If it is no shipped policy, folder or hub name.
        CheckpointError: If a part is missing or damaged.
    """
    folder = weights_folder(start)
    return EndToEnd(
        RetinaNet.from_folder(folder / "detector"),
        Translator.from_folder(folder / "translator"),
        FusionNet.from_folder(folder / "fusion"),
        readings=readings,
    )


@torch.inference_mode()
def measure(model: EndToEnd, commands: EyeCommands, count: int, size: int = 20) -> dict[str, float]:
    """How often cells, layouts and moves are right on pictures and clean sentences.

    Returns:
        `cells_right` (grasp and place), `layouts_right`, `blocks_right` (whose cell has the right
        class), `answered`, and `joint_mse` of the expected scaled values where there is an answer.
    """
    model.eval()
    count = min(count, len(commands))
    if not count:
        raise DataError(f"The data set {commands.pictures.samples.folder} has no such samples.")
    right, layouts, answered, errors = 0, 0, 0, 0.0
    found, blocks = 0, 0
    for first in range(0, count, size):
        batch = commands.batch(list(range(first, min(first + size, count))), model.translator)
        outputs = model(batch.seen.images, batch.sentences)
        expected = outputs.expected
        hits = (expected.source.argmax(1) == batch.source) & (
            expected.target.argmax(1) == batch.target
        )
        right += int((hits & expected.answered).sum())
        read = outputs.seen["cells"].logits.argmax(-1)
        true = read == batch.seen.cells
        layouts += int(true.all(1).sum())
        filled = batch.seen.cells != EMPTY
        found, blocks = found + int(true[filled].sum()), blocks + int(filled.sum())
        answered += int(expected.answered.sum())
        squared = ((expected.joints - batch.joints(model)) ** 2).mean(1)
        errors += float(squared[expected.answered].sum())
    return {
        "cells_right": right / count,
        "layouts_right": layouts / count,
        "blocks_right": found / max(blocks, 1),
        "answered": answered / count,
        "joint_mse": errors / max(answered, 1),
        "samples": float(count),
    }


def save(model: EndToEnd, config: EndToEndConfig, metadata: dict[str, Any]) -> None:
    """Write the policy's folder whole: the trained parts, and the right eye's as it was.

    Raises:
        OutputError: If it cannot be written.
    """
    with folder_whole(config.out) as aside:
        model.detector.save(aside / "detector", metadata)
        model.translator.save(aside / "translator", metadata=metadata, half=True)
        model.fusion.save(aside / "fusion", metadata)
        for part in OPTIONAL:
            if (kept := weights_folder(config.start) / part).is_dir():
                shutil.copytree(kept, aside / part)
        write_policy_card(aside, config.out.name)
