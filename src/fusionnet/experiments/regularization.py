"""Figures 5.3 and 5.4: the Transformer's cross-entropy by dropout, and by perturbed sentences."""

from typing import Any

from fusionnet.experiments._experiment import (
    Claim,
    Experiment,
    Figure,
    Outcome,
    Published,
    Scale,
    Trial,
    Variant,
)
from fusionnet.experiments._translation import SMALL_TREES, trained

BEST_DROPOUT = 0.15
ALL_NOISED = 3
DROPOUTS: dict[Scale, tuple[float, ...]] = {
    "smoke": (0.0, BEST_DROPOUT),
    "small": (0.0, BEST_DROPOUT, 0.4),
    "thesis": (0.0, 0.1, BEST_DROPOUT, 0.2, 0.3, 0.4),
}
NOISED: dict[Scale, tuple[int, ...]] = {"smoke": (0,), "small": (0, 1), "thesis": (0, 1, 2)}
STEPS: dict[Scale, int] = {"smoke": 2, "small": 2000, "thesis": 16_000}
BATCH: dict[Scale, int] = {"smoke": 4, "small": 16, "thesis": 5}
LAYERS: dict[Scale, int] = {"smoke": 1, "small": 2, "thesis": 4}
LEARNT: dict[Scale, int] = {"smoke": 40, "small": 300, "thesis": 0}
VECTOR_EPOCHS: dict[Scale, int] = {"smoke": 1, "small": 5, "thesis": 200}


def variants(scale: Scale) -> list[Variant]:
    """Each dropout with all perturbed sentences; with the best dropout, fewer of them."""
    dropouts = [
        Variant(
            name=f"dropout-{share:g}",
            values={"dropout": share, "noised": ALL_NOISED},
            label=f"dropout {share:g}, {ALL_NOISED} perturbed",
        )
        for share in DROPOUTS[scale]
    ]
    return dropouts + [
        Variant(
            name=f"noised-{number}",
            values={"dropout": BEST_DROPOUT, "noised": number},
            label=f"dropout {BEST_DROPOUT:g}, {number or 'none'} perturbed",
        )
        for number in NOISED[scale]
    ]


def run(trial: Trial) -> Outcome:
    """Train a Transformer with this dropout and noise; measure it on the validation groups."""
    scale = trial.scale
    sizes: dict[str, Any] = {
        "heads": 2,
        "feed_forward_size": 128,
        "layers": LAYERS[scale],
        "batch": BATCH[scale],
        "vector_epochs": VECTOR_EPOCHS[scale],
        "dropout": trial.variant.values["dropout"],
        "noised": trial.variant.values["noised"],
    }
    return trained(trial, sizes, STEPS[scale], LEARNT[scale])[2]


EXPERIMENT = Experiment(
    name="regularization",
    section="5.3",
    title="Dropout and perturbed sentences",
    question="Do dropout and perturbed training sentences help the translation?",
    setup="Base Transformer with skip-gram embeddings of size 50, 16,000 steps of 5 sequences; "
    "P_drop from 0 to 0.4 with three perturbed sentences beside each clean one; then, with the "
    "best P_drop (0.15), two, one and none; validation cross-entropy, three repetitions.",
    differs={
        "smoke": "Commands of our own, one layer, 2 steps: it shows only that it runs.",
        "small": "300 commands of the treebank, so that there is something to overfit, "
        f"{SMALL_TREES}; 2 layers, 2,000 steps of 16 sequences with a one-cycle schedule, word "
        "vectors of 5 epochs.",
        "thesis": "Treebank in place of the ETR data. The set-up of 5.3.1 lists P_drop of 0.1 and "
        "0.2, its result is best at 0.15: all three are run.",
    },
    metric="cross_entropy",
    lower_is_better=True,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    published=(
        Published(
            variant="dropout-0.15",
            metric="cross_entropy",
            mean=0.0841,
            deviation=0.0016,
            where="5.3.2",
        ),
        Published(
            variant="noised-0", metric="cross_entropy", mean=0.099, deviation=0.0011, where="5.3.2"
        ),
    ),
    claims=(
        Claim(
            better="dropout-0.15",
            worse="dropout-0",
            says="Some dropout (0.15) is better than none.",
        ),
        Claim(
            better="dropout-0.15",
            worse="dropout-0.4",
            says="Dropout of 0.15 is better than of 0.4.",
        ),
        Claim(
            better="dropout-0.15",
            worse="noised-0",
            says="Three perturbed sentences beside each clean one are better than none.",
        ),
        Claim(
            better="dropout-0.15",
            worse="noised-1",
            says="Three perturbed sentences are better than one.",
        ),
    ),
    figures=(
        Figure(
            kind="bars",
            like="figures 5.3 and 5.4",
            y_label="validation cross-entropy [nats a token]",
        ),
    ),
    caution="Validation sentences are clean. With a fixed number of steps, each clean sentence is "
    "seen four times as often where there are no perturbed ones. At small the networks have hardly "
    "begun to look at the sentence; what differs is how fast they learn the language of trees.",
)
