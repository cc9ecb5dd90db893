"""The compact FusionNet's fusion as several experiments train it: from commands, quickly."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from fusionnet import robots
from fusionnet.corpora import Command
from fusionnet.evaluation.acting import act_all
from fusionnet.experiments._experiment import Trial
from fusionnet.models.fusionnet import FusionNet, compact
from fusionnet.randomness import generator
from fusionnet.training.fusion import (
    LOSS_WEIGHTS,
    FusionBatch,
    FusionConfig,
    cells_right,
    draw_batch,
)
from fusionnet.training.journal import LogLine
from fusionnet.training.loop import LoopConfig, fit
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.planned_examples import PlannedExamples
from fusionnet.training.simulated_readings import cells_of, simulated_readings

Losses = Callable[[Any, FusionBatch], Mapping[str, torch.Tensor]]


def fusion_config(steps: int, seed: int, batch: int = 64, **loop: Any) -> FusionConfig:
    """Like the shipped fusion part's, for fewer steps; `loop` changes its loop.

    Its weights are averaged over fewer steps (0.98, not 0.998), and no reader's pictures are
    learnt from.
    """
    chosen = {
        "learning_rate": 0.04,
        "optimizer": OptimizerConfig(weight_decay=0.0),
        "average": 0.98,
        "loss_weights": LOSS_WEIGHTS,
        "tensorboard": False,
        "log_every": max(1, steps // 20),
        "save_every": 50,
        **loop,
    }
    return FusionConfig(seed=seed, batch=batch, loop=LoopConfig(steps=steps, **chosen))


def train_fusion(
    commands: Sequence[Command],
    config: FusionConfig,
    trial: Trial,
    model: FusionNet | None = None,
    losses: Losses | None = None,
    *,
    resumed: bool = True,
) -> tuple[FusionNet, list[LogLine]]:
    """A fusion part that has learnt from some commands, and the lines of its log.

    A killed run goes on from the trial's state, unless it is not to be `resumed`.
    """
    torch.set_num_threads(1)
    examples = PlannedExamples(commands)
    model = compact(config.robot) if model is None else model

    def batches(first: int) -> Iterator[FusionBatch]:
        for step in range(first, config.loop.steps):
            yield draw_batch(examples, None, config, step)

    history = fit(
        model,
        batches,
        losses or (lambda network, batch: network.losses(*batch)),
        config.loop,
        folder=trial.state if resumed else None,
        settings=config,
        seed=config.seed,
        progress=trial.progress,
    )
    return model, history


def readings_of(
    commands: Sequence[Command], seed: int
) -> tuple[Float[ndarray, "n 8 8 8 17"], Float[ndarray, " n"]]:
    """The commands' layouts as a reader full of doubt sees them; the same for every variant."""
    cells, held = cells_of([command.scene.before for command in commands])
    return simulated_readings(cells, held, generator(seed, "experiments", "readings"))


def acted_on(
    model: FusionNet, commands: Sequence[Command], seed: int, episodes: int
) -> dict[str, float]:
    """How often both cells are right on readings full of doubt, and what the simulated arm does.

    Args:
        model: A trained fusion part.
        commands: All are asked for their cells, with gold trees.
        seed: Of the readings, and of which commands the arm does.
        episodes: How many of them.
    """
    occupancy, holding = readings_of(commands, seed)
    right = cells_right(model, commands, occupancy, holding)
    drawn = generator(seed, "episodes").permutation(len(commands))[:episodes]
    some = [commands[i] for i in drawn]
    readings = zip(some, occupancy[drawn], holding[drawn], strict=True)
    targets = [model(cells, float(held), [(c.tree, 1.0)]).targets for c, cells, held in readings]
    done = act_all(robots.load("nico"), some, np.array(targets))
    return {"cells_right": float(right.mean()), **done}


def curves_of(history: Sequence[LogLine]) -> dict[str, list[float]]:
    """The log's losses over its steps."""
    names = [name for name in (history[0] if history else {}) if name != "seconds"]
    return {name: [round(float(line[name]), 6) for line in history] for name in names}
