"""Ours: adaptive weightings of the losses against fixed ones, under one budget of steps.

The compact FusionNet's fusion has four losses on shared parameters: the cells of grasp and
place (cross-entropies), the joints (squared error) and whether the block ends held. The
thesis names homoscedastic uncertainty as future work (2.1.12, 7.5).
"""

import time

from fusionnet.experiments._experiment import (
    Claim,
    Experiment,
    Figure,
    Outcome,
    Scale,
    Trial,
    Variant,
)
from fusionnet.experiments._fusion import acted_on, curves_of, fusion_config, train_fusion
from fusionnet.experiments._sources import corpus_for
from fusionnet.training.fusion import LOSS_WEIGHTS

STEPS: dict[Scale, int] = {"smoke": 2, "small": 40, "thesis": 2000}
BATCH: dict[Scale, int] = {"smoke": 4, "small": 16, "thesis": 64}
EPISODES: dict[Scale, int] = {"smoke": 1, "small": 20, "thesis": 229}

PRIMARY = "joints"
"""What `primary` follows first: the arm's values, as the thesis's main objective."""

SET_UPS = {
    "tuned": ("fixed", LOSS_WEIGHTS, "fixed, tuned by hand"),
    "uniform": ("fixed", dict.fromkeys(LOSS_WEIGHTS, 1.0), "fixed, all 1"),
    "uncertainty": ("uncertainty", dict.fromkeys(LOSS_WEIGHTS, 1.0), "uncertainty"),
    "pcgrad": ("pcgrad", dict.fromkeys(LOSS_WEIGHTS, 1.0), "PCGrad"),
    "upgrad": ("upgrad", dict.fromkeys(LOSS_WEIGHTS, 1.0), "UPGrad"),
    "primary": ("primary", dict.fromkeys(LOSS_WEIGHTS, 1.0), "joints first (PCD)"),
}
"""Weighting, fixed factors and label of each variant."""


def variants(scale: Scale) -> list[Variant]:
    """One a weighting."""
    return [
        Variant(name=name, values={"weighting": weighting, "factors": factors}, label=label)
        for name, (weighting, factors, label) in SET_UPS.items()
    ]


def run(trial: Trial) -> Outcome:
    """Train with one weighting, and act on the test groups' commands."""
    scale, values = trial.scale, trial.variant.values
    corpus = corpus_for(trial)
    learnt, test = corpus.split("train"), corpus.split("test")
    config = fusion_config(
        STEPS[scale],
        trial.seed,
        batch=BATCH[scale],
        weighting=values["weighting"],
        loss_weights=values["factors"],
        primary=PRIMARY if values["weighting"] == "primary" else "",
    )
    began = time.process_time()
    model, history = train_fusion(learnt, config, trial, resumed=False)  # all its time is measured
    seconds = time.process_time() - began
    episodes = min(EPISODES[scale], len(test))
    return Outcome(
        metrics={**acted_on(model, test, trial.seed, episodes), "training_seconds": seconds},
        configuration={
            "steps": config.loop.steps,
            "batch": config.batch,
            "primary": config.loop.primary,
            "learnt": len(learnt),
            "tested": len(test),
            "episodes": episodes,
            "corpus": corpus.name,
        },
        curves=curves_of(history),
    )


def _beats(name: str, than: str) -> Claim:
    return Claim(
        better=name,
        worse=than,
        says=f"{SET_UPS[name][2]} gets more commands right than {SET_UPS[than][2]}.",
        source="ours",
    )


EXPERIMENT = Experiment(
    name="weightings",
    section="ours",
    title="Weightings: adaptive ones against fixed ones under one budget",
    question="Does a weighting that adapts spare the tuning of loss weights?",
    setup="The thesis weights its losses by fixed factors (7.1, 7.2) and names homoscedastic "
    "uncertainty as future work (7.5).",
    differs={
        "smoke": "Commands of our own, 2 steps, one episode: it shows only that it runs.",
        "small": "The compact FusionNet (tree executor), 40 steps of 16 examples for each, 20 "
        "episodes on the test groups with gold trees and simulated readings.",
        "thesis": "The compact FusionNet, 2000 steps of 64 examples, every test command.",
    },
    metric="cells_right",
    lower_is_better=False,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    claims=(
        *(_beats(name, "uniform") for name in ("uncertainty", "pcgrad", "upgrad", "primary")),
        *(_beats(name, "tuned") for name in ("uncertainty", "pcgrad", "upgrad", "primary")),
        _beats("tuned", "uniform"),
    ),
    figures=(
        Figure(y_label="both cells right, share of test commands", title="Both cells right"),
        Figure(
            metric="executed_success",
            y_label="executed success, share of episodes",
            title="Executed success",
        ),
        Figure(
            metric="training_seconds",
            y_label="processor time of the training [s]",
            title="What it costs: gradients of every loss apart",
        ),
    ),
    caution="One budget means the same examples in the same order; those that look at gradients "
    "need more time for it (last figure), and no rate was tuned for any of them: the rate is "
    "that of the fixed, tuned weights.",
)
