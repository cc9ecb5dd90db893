"""Train the thesis's FusionNet on a data set, as table 7.3 says.

`fusionnet train fusion DATASET --preset thesis` runs this; `--preset thesis-small` is the same
architecture with small pictures and small networks. Experiments call `train` with a
configuration of their own and take its metrics.
"""

import logging
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import torch

from fusionnet.dataset.folder import read_plan
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.reader import StoredSamples
from fusionnet.errors import DataError
from fusionnet.models import backbones
from fusionnet.models.checkpoint import check_checkpoint_folder
from fusionnet.models.target_text import Writes
from fusionnet.models.thesis_fusion_config import thesis
from fusionnet.models.thesis_fusionnet import FusionBatch, ThesisFusionNet
from fusionnet.randomness import derived_seed
from fusionnet.training.fusion_examples import FusionExamples, joint_limits, vocabularies
from fusionnet.training.journal import LogLine
from fusionnet.training.loop import Progress, fit, is_first_process
from fusionnet.training.thesis_fusion_config import ThesisFusionConfig
from fusionnet.training.thesis_measures import measure
from fusionnet.training.transfer import transfer_detector, transfer_transformer

log = logging.getLogger(__name__)


def train(config: ThesisFusionConfig, *, progress: Progress | None = None) -> dict[str, Any]:
    """Train, measure, and save; returns the metrics by split.

    Of several processes, one a device, only the first measures and saves; the others return
    nothing.

    Raises:
        DataError: If the data set is not finished, or damaged.
        UnknownNameError: If there is no such split, backbone, fuser or head.
        CheckpointError: If weights to begin with, or a state to resume, cannot be used.
        OutputError: If the checkpoint cannot be written.
    """
    check_checkpoint_folder(config.out, config.work)
    model, history, measured = run(config, progress=progress)
    if not is_first_process():
        return {}
    metrics = {"loss": history[-1]["loss"] if history else None, **measured}
    here = ("out", "work", "dataset", "detector", "translator")
    described = {k: v for k, v in asdict(config).items() if k not in here}
    described["corpus"] = read_plan(config.dataset).corpus
    model.save(config.out, {"training": described, "metrics": metrics})
    return metrics


def run(
    config: ThesisFusionConfig, *, progress: Progress | None = None
) -> tuple[ThesisFusionNet, list[LogLine], dict[str, Any]]:
    """Train and measure without a checkpoint: the model, its log, the metrics by split.

    Of several processes, one a device, only the first measures.
    """
    if config.threads:
        torch.set_num_threads(config.threads)
    model = new_model(config)
    learnt = examples_of(config, "train", model.config.detector.frame)
    checked = {s: examples_of(config, s, model.config.detector.frame) for s in config.check}

    def batches(first: int) -> Iterator[FusionBatch]:
        drawn = learnt.batches(
            model,
            config.batch,
            first,
            config.seed,
            sentences=config.noised_sentences,
            pictures=config.noised_pictures,
        )
        return (model.batch_of(examples) for examples in drawn)

    _freeze_unused(model, config, next(batches(0)))
    weights = {n: config.loop.loss_weights.get(n, 1.0) for n in model.config.heads}
    loop = replace(config.loop, loss_weights=weights)
    history = fit(
        model,
        batches,
        lambda network, batch: cast(Any, network).losses(batch),
        loop,
        folder=config.work,
        settings=config,
        seed=config.seed,
        progress=progress,
    )
    if not is_first_process():
        return model, history, {}
    measured = {}
    for split, examples in checked.items():
        episodes = 0 if split == "train" else config.episodes
        measured[split] = measure(model, examples, config.checked, episodes=episodes)
    return model, history, measured


def examples_of(config: ThesisFusionConfig, split: str, frame: PictureFrame) -> FusionExamples:
    """The samples of a split; runs that keep them in memory share them."""
    make = _shared if config.keep else _shared.__wrapped__
    return make(config.dataset, split, frame, config.crop, config.keep)


@lru_cache(maxsize=4)
def _shared(
    dataset: Path, split: str, frame: PictureFrame, crop: bool, keep: bool
) -> FusionExamples:
    return FusionExamples(dataset, split, frame, crop=crop, keep=keep)


@lru_cache(maxsize=4)
def _scanned(
    dataset: Path, writes: Writes
) -> tuple[tuple[tuple[float, float], ...], tuple[str, ...], tuple[str, ...], str]:
    """Joint limits, tokens read and written, and the robot of a data set."""
    known = dict(StoredSamples(dataset, "train", ("id",)).plan.counts)
    splits = [s for s in ("train", "val", "sim_val") if known.get(s)]
    robot = StoredSamples(dataset, "train", ("id",)).plan.robot
    return joint_limits(dataset, splits), *vocabularies(dataset, writes), robot


def new_model(config: ThesisFusionConfig) -> ThesisFusionNet:
    """An untrained FusionNet for a data set, with the weights that it is told to begin with."""
    sizes = config.sizes
    limits, source, target, robot = _scanned(config.dataset, config.writes)
    trained = None
    if config.translator is not None:
        trained = transfer_transformer(config.translator)
        source, target = trained.vocabularies
    whole = thesis(
        robot,
        limits,
        source,
        target,
        sizes=sizes,
        crop=config.crop,
        vision=config.vision,
        writes=config.writes,
        fuser=config.fuser,
        heads=config.outputs,
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derived_seed(config.seed, "thesis fusion", "weights"))
        model = ThesisFusionNet(whole)
    if model.detector is not None and config.detector is None:
        said = backbones.fill_backbone(model.detector.backbone, sizes.backbone_weights)
        log.info("backbone: %s", said)
    if config.detector is not None:
        transfer_detector(config.detector, model)
    if trained is not None:
        trained.fill(model)
    return model


def _freeze_unused(model: ThesisFusionNet, config: ThesisFusionConfig, batch: FusionBatch) -> None:
    """Keep what no loss reaches as it is: several devices would wait for its gradient."""
    weights = config.loop.loss_weights
    named = {n: v for n, v in model.losses(batch).items() if weights.get(n, 1.0)}
    if not named:
        raise DataError("Every loss has the factor 0; nothing would be learnt.")
    parameters = [p for p in model.parameters() if p.requires_grad]
    total = torch.stack(list(named.values())).sum()
    found: tuple[torch.Tensor | None, ...] = torch.autograd.grad(
        total, parameters, allow_unused=True
    )
    for parameter, gradient in zip(parameters, found, strict=True):
        if gradient is None:
            parameter.requires_grad_(False)
