"""Train the compact FusionNet's fusion part: from soft layouts and trees to cells and joints.

The planner labels varied trees of the training groups on varied layouts
(`planned_examples`), the layouts are seen with a reader's doubts
(`simulated_readings`), or as a real reader saw them where such readings are given.
"""

import hashlib
import json
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fusionnet.blocks import Move, layout_to_json, plan
from fusionnet.corpora import Command, executable, load_corpus
from fusionnet.errors import InputError
from fusionnet.models.checkpoint import WEIGHTS_FILE, check_checkpoint_folder
from fusionnet.models.fusionnet import FusionNet, compact
from fusionnet.models.program_pack import PackedPrograms, pack
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.tree_program import compile_tree
from fusionnet.randomness import generator
from fusionnet.training.loop import LoopConfig, fit, is_first_process
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.planned_examples import Example, PlannedExamples
from fusionnet.training.reader_outputs import (
    ReaderOutputs,
    collect_reader_outputs,
    load_reader_outputs,
)
from fusionnet.training.simulated_readings import (
    cells_of,
    exact_readings,
    simulated_readings,
)

log = logging.getLogger(__name__)

_RECENT = 40
"""Steps for which an example may be drawn again."""

Progress = Callable[[int, int, Any], None]


LOSS_WEIGHTS = {
    "grasp": 1.0,
    "place": 1.0,
    "holds": 0.1,
    "joints": 3.0,
    "evidence": 0.3,
}
"""Factors of the named losses."""


@dataclass(frozen=True, kw_only=True)
class FusionConfig:
    """How to train the fusion part.

    Attributes:
        out: Folder of the checkpoint; the log and the resumable state go to `work`.
        work: Folder for everything that is not the checkpoint.
        corpus: Corpus whose training groups' trees and layouts are varied.
        data: Folder of the corpus.
        robot: Name of the robot whose joint table is used.
        batch: Examples a step.
        exact: Share of the simulated readings that are without doubt.
        reader: Folder of a trained detector, to learn from its readings of pictures as well;
            they are kept in `work`.
        pictures: How many pictures it reads.
        read_share: Share of the examples whose layout it read.
        loop: Steps and schedule.
        seed: Source of all randomness.
        threads: Of PyTorch while it trains; the tensors are small, more than one gains little.
    """

    out: Path = Path("runs/fusion/checkpoint")
    work: Path = Path("runs/fusion")
    corpus: str = "treebank"
    data: Path | None = None
    robot: str = "nico"
    batch: int = 64
    exact: float = 0.2
    reader: Path | None = None
    pictures: int = 3000
    read_share: float = 0.4
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=2000,
            learning_rate=0.04,
            optimizer=OptimizerConfig(weight_decay=0.0),
            average=0.998,
            loss_weights=LOSS_WEIGHTS,
        )
    )
    seed: int = 0
    threads: int = 1

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        if min(self.batch, self.threads, self.pictures) < 1:
            raise InputError(
                "batch, threads and pictures are at least 1; received "
                f"{self.batch}, {self.threads} and {self.pictures}."
            )
        if not (0 <= self.exact <= 1 and 0 <= self.read_share <= 1):
            raise InputError("exact and read_share are shares: they go from 0 to 1.")


class FusionBatch(NamedTuple):
    """Programs with layouts as they were read, and the cells that the planner found."""

    programs: PackedPrograms
    occupancy: Float[Tensor, "b 8 8 8 17"]
    holding: Float[Tensor, " b"]
    source: Tensor
    target: Tensor
    begins: Float[Tensor, " b"]


def train(
    config: FusionConfig,
    progress: Progress | None = None,
    rendering: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Train, write the checkpoint, and return what it can do on val and test groups.

    Of several processes, one a device, only the first measures and saves; the others return
    nothing.

    Args:
        config: How to train.
        progress: Called after every step with step, steps and the latest log line.
        rendering: Called after every picture that the reader reads, with pictures read
            and pictures in all.

    Raises:
        DataError: If the treebank is missing or damaged.
        CheckpointError: If the reader is missing or damaged.
        OutputError: If the checkpoint cannot be written.
    """
    check_checkpoint_folder(config.out, config.work)
    before = torch.get_num_threads()
    torch.set_num_threads(config.threads)
    try:
        return _trained(config, progress, rendering)
    finally:
        torch.set_num_threads(before)


def _trained(
    config: FusionConfig,
    progress: Progress | None,
    rendering: Callable[[int, int], None] | None,
) -> dict[str, Any]:
    """`train` on the threads that are set."""
    began = time.monotonic()
    corpus = executable(load_corpus(config.corpus, config.data))
    learnt = corpus.split("train")
    if not learnt:
        raise InputError(f"The corpus {config.corpus!r} has no training groups to learn from.")
    examples = PlannedExamples(learnt)
    outputs = None if config.reader is None else _reader_outputs(config, learnt, rendering)
    model = compact(config.robot)

    def batches(first: int) -> Iterator[FusionBatch]:
        for step in count(first):  # several devices share them: more than steps
            yield draw_batch(examples, outputs, config, step)

    fit(
        model,
        batches,
        _losses,
        config.loop,
        folder=config.work,
        settings=config,
        seed=config.seed,
        progress=progress,
    )
    if not is_first_process():
        return {}
    metrics = evaluate_cells(model, {p: corpus.split(p) for p in ("val", "test")}, config.seed)
    metrics["minutes"] = round((time.monotonic() - began) / 60, 1)
    here = ("out", "work", "data", "reader", "pictures")
    stated = {key: value for key, value in asdict(config).items() if key not in here}
    stated["pictures"] = len(outputs) if outputs is not None else 0
    model.save(config.out, {"training": stated, "metrics": metrics})
    log.info("fusion part trained: %s", metrics)
    return metrics


def _reader_outputs(
    config: FusionConfig,
    learnt: Sequence[Command],
    rendering: Callable[[int, int], None] | None,
) -> ReaderOutputs:
    """What the reader says of pictures of varied layouts of the training groups.

    It is kept under a name that tells the reader, its settings and the pictures apart from others.
    """
    assert config.reader is not None
    reader = RetinaNet.from_folder(config.reader)
    layouts = list({id(s): s for c in learnt for s in (c.scene.before, c.scene.after)}.values())
    told = [reader.config.as_json(), [layout_to_json(layout) for layout in layouts]]
    digest = hashlib.blake2b((config.reader / WEIGHTS_FILE).read_bytes(), digest_size=6)
    digest.update(json.dumps(told).encode())
    pictures = f"{config.robot}-{config.corpus}-{config.pictures}-{config.seed}"
    file = config.work / f"reader_outputs-{digest.hexdigest()}-{pictures}.npz"
    if not file.is_file():
        collect_reader_outputs(
            file,
            reader,
            layouts,
            count=config.pictures,
            seed=config.seed,
            robot=config.robot,
            progress=rendering,
        )
    return load_reader_outputs(file)


def _losses(network: Any, batch: FusionBatch) -> dict[str, Tensor]:
    losses: dict[str, Tensor] = network.losses(*batch)
    return losses


def draw_batch(
    examples: PlannedExamples,
    outputs: ReaderOutputs | None,
    config: FusionConfig,
    step: int,
) -> FusionBatch:
    """The batch of a step: recent planned examples, seen with doubt.

    A third of a batch's examples are new; on average each is seen three times, always
    with other doubts.
    """
    rng = generator(config.seed, "fusion", "train", step)
    new = -(-config.batch // 3)
    recent = range(max(0, (step - _RECENT) * new), (step + 1) * new)
    drawn: list[Example] = []
    read: list[tuple[np.ndarray, float]] = []
    while outputs is not None and len(drawn) < round(config.read_share * config.batch):
        place = int(rng.integers(len(outputs)))
        example = examples.draw_on(outputs.layout(place), rng)
        if example is not None:
            drawn.append(example)
            read.append(outputs.reading(place))
    while len(drawn) < config.batch:
        number = recent[int(rng.integers(len(recent)))]
        drawn.append(examples.numbered(config.seed, number))
    cells, held = cells_of([example.layout for example in drawn])
    severity = rng.uniform(0, 1, len(drawn)) * (rng.random(len(drawn)) > config.exact)
    occupancy, holding = simulated_readings(cells, held, rng, severity)
    for place, (cell_probabilities, held_probability) in enumerate(read):
        occupancy[place], holding[place] = cell_probabilities, held_probability
    return batch_of([(e.tree, e.move) for e in drawn], occupancy, holding)


def batch_of(
    commands: Sequence[tuple[Any, Move]], occupancy: np.ndarray, holding: np.ndarray
) -> FusionBatch:
    """A batch from trees with their moves, and readings of their layouts."""
    moves = [move for _, move in commands]
    return FusionBatch(
        pack([compile_tree(tree) for tree, _ in commands]),
        torch.from_numpy(occupancy),
        torch.from_numpy(holding),
        torch.tensor([move.source.index for move in moves]),
        torch.tensor([move.target.index for move in moves]),
        torch.tensor([float(move.begins_held) for move in moves]),
    )


@torch.inference_mode()
def evaluate_cells(
    model: FusionNet, parts: dict[str, list[Command]], seed: int = 0
) -> dict[str, Any]:
    """How often both cells are right, on layouts read exactly and with doubt.

    The commands are real ones with gold trees; the moves are the planner's. Doubt is
    simulated, at a severity of 0.5 and of random severity up to 1.
    """
    metrics: dict[str, Any] = {}
    for part, commands in parts.items():
        cells, held = cells_of([command.scene.before for command in commands])
        rng = generator(seed, "fusion", "evaluate", part)
        middle = np.full(len(commands), 0.5)
        readings = {
            "exact": exact_readings(cells, held),
            "soft": simulated_readings(cells, held, rng),
            "half": simulated_readings(cells, held, rng, middle),
        }
        for name, (occupancy, holding) in readings.items():
            right = cells_right(model, commands, occupancy, holding)
            metrics[f"{part} {name}"] = round(float(right.mean()), 4)
    return metrics


@torch.inference_mode()
def cells_right(
    model: FusionNet,
    commands: Sequence[Command],
    occupancy: np.ndarray,
    holding: np.ndarray,
) -> Float[np.ndarray, " n"]:
    """Whether grasp cell and place cell are both the planner's, for each command."""
    right = np.zeros(len(commands))
    for first in range(0, len(commands), 64):
        some = slice(first, first + 64)
        planned = [(c.tree, plan(c.tree, c.scene.before)) for c in commands[some]]
        batch = batch_of(planned, occupancy[some], holding[some])
        execution, _ = model.execute(batch.programs, batch.occupancy, batch.holding)
        source, target = execution.source.argmax(1), execution.target.argmax(1)
        right[some] = ((source == batch.source) & (target == batch.target)).float().numpy()
    return right
