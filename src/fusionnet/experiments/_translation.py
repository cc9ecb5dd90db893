"""Runs of chapter 5: a Transformer of some sizes, trained, and measured as the thesis did."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch

from fusionnet.corpora import Command
from fusionnet.experiments._experiment import Outcome, Scale, Trial
from fusionnet.experiments._sources import corpus_for
from fusionnet.models.transformer import Transformer
from fusionnet.training.loop import LoopConfig
from fusionnet.training.schedules import ScheduleConfig
from fusionnet.training.transformer import ThesisTranslatorConfig, learn, thesis_loop

SMALL_RATE = 3e-3
"""Peak of the one-cycle at the smaller scales: 4000 steps of warm-up would never end there."""

SMALL_TREES = "the tree's values (about 9 tokens) in place of its text, which is learnt in minutes"


def loop_of(scale: Scale, steps: int, rate: float = SMALL_RATE) -> LoopConfig:
    """The thesis's optimiser; its schedule only where there are steps enough for it."""
    loop = replace(thesis_loop(), steps=steps, tensorboard=False)
    if scale == "thesis":
        return loop
    return replace(
        loop,
        learning_rate=rate,
        schedule=ScheduleConfig(kind="one-cycle"),
        accelerator="cpu",
        log_every=max(1, steps // 20),
        save_every=500,
    )


def trained(
    trial: Trial,
    sizes: Mapping[str, Any],
    steps: int,
    learnt: int = 0,
    rate: float = SMALL_RATE,
) -> tuple[Transformer, list[Command], Outcome]:
    """A Transformer of some sizes, the validation commands, and what was measured of both.

    Args:
        trial: Whose corpus, seed and state.
        sizes: Fields of `ThesisTranslatorConfig`.
        steps: Optimiser steps.
        learnt: How many commands of the training groups, evenly spread; 0 for all.
        rate: Peak of the learning rate at the smaller scales.
    """
    torch.set_num_threads(1)
    corpus = corpus_for(trial)
    config = ThesisTranslatorConfig(
        writes="rcl" if trial.scale == "thesis" else "short",
        loop=loop_of(trial.scale, steps, rate),
        seed=trial.seed,
        **sizes,
    )
    commands: Sequence[Command] = corpus.split("train")
    if learnt:
        commands = commands[:: max(1, len(commands) // learnt)][:learnt]
    translator, pairs, history = learn(
        commands, config, folder=trial.state, progress=trial.progress
    )
    checked = corpus.split("val")
    accuracy, entropy = translator.teacher_forced(
        [command.sentence for command in checked],
        [None] * len(checked),
        [command.tree for command in checked],
    )
    outcome = Outcome(
        metrics={"cross_entropy": entropy, "token_accuracy": accuracy},
        configuration={
            **sizes,
            "steps": steps,
            "learning_rate": config.loop.learning_rate,
            "corpus": corpus.name,
            "commands": len(commands),
            "pairs": pairs,
            "measured": len(checked),
            "parameters": sum(p.numel() for p in translator.network.parameters()),
        },
        curves={n: [round(float(line[n]), 5) for line in history] for n in ("step", "tokens")},
    )
    return translator, checked, outcome
