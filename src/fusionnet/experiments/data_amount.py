"""Ours: how many commands the compact FusionNet's fusion needs.

The first N commands of a random order of the training groups are learnt from (nested by
seed), and the test groups' commands are done with gold trees and readings that are full
of doubt.
"""

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
from fusionnet.randomness import generator

SIZES: dict[Scale, tuple[int, ...]] = {
    "smoke": (60, 180),
    "small": (30, 250, 2000),
    "thesis": (30, 60, 125, 250, 500, 1000, 2000),
}
STEPS: dict[Scale, int] = {"smoke": 3, "small": 60, "thesis": 2000}
BATCH: dict[Scale, int] = {"smoke": 4, "small": 16, "thesis": 64}
EPISODES: dict[Scale, int] = {"smoke": 2, "small": 20, "thesis": 229}


def variants(scale: Scale) -> list[Variant]:
    """One a number of commands."""
    return [Variant(name=f"n{n}", values={"commands": n}, label=str(n)) for n in SIZES[scale]]


def run(trial: Trial) -> Outcome:
    """Train on the first commands of a random order, and act on the test groups' commands."""
    corpus = corpus_for(trial)
    learnt = corpus.split("train")
    order = generator(trial.seed, "amount of data").permutation(len(learnt))
    some = [learnt[i] for i in order[: trial.variant.values["commands"]]]
    config = fusion_config(STEPS[trial.scale], trial.seed, BATCH[trial.scale])
    model, history = train_fusion(some, config, trial)
    test = corpus.split("test")
    episodes = min(EPISODES[trial.scale], len(test))
    return Outcome(
        metrics=acted_on(model, test, trial.seed, episodes),
        configuration={
            "steps": config.loop.steps,
            "batch": config.batch,
            "learnt": len(some),
            "tested": len(test),
            "episodes": episodes,
            "corpus": corpus.name,
        },
        curves=curves_of(history),
    )


EXPERIMENT = Experiment(
    name="data_amount",
    section="ours",
    title="Amount of data: how many commands the fusion learns from",
    question="How much does executed success owe to the number of commands?",
    setup="The thesis has no such experiment; it learns from all commands of the ETR data.",
    differs={
        "smoke": "Commands of our own, 3 steps, 2 episodes: it shows only that it runs.",
        "small": "The compact FusionNet (tree executor), 60 steps of 16 examples, 20 episodes "
        "on the test groups with gold trees and simulated readings.",
        "thesis": "The compact FusionNet, 2000 steps as the shipped one, but without a "
        "reader's pictures and with weights averaged by 0.98 instead of 0.998; every test command.",
    },
    metric="executed_success",
    lower_is_better=False,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    claims=(
        Claim(
            better="n2000",
            worse="n250",
            says="Eight times the commands raise executed success.",
            source="ours",
        ),
        Claim(
            better="n2000",
            worse="n250",
            says="Eight times the commands raise the share of commands with both cells right.",
            metric="cells_right",
            source="ours",
        ),
        Claim(
            better="n250",
            worse="n30",
            says="From 30 to 250 commands executed success rises.",
            source="ours",
        ),
    ),
    figures=(
        Figure(
            kind="lines",
            x="commands",
            x_label="commands learnt from",
            y_label="executed success, share of episodes",
        ),
    ),
    caution="Every command's tree and layout is varied (colours, sides, numbers, foreign layouts) "
    "in each step, so a small number of commands goes further than without that; the sentence's "
    "reading is given, so this says nothing of the translator.",
)
