"""Figure 5.1: the Transformer's cross-entropy by kind and size of its embeddings.

Embeddings begin at random (He's scale), or with word vectors of the training sentences
and trees by skip-gram or CBOW (tables 5.2 and 5.3).
"""

from dataclasses import asdict, replace
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
from fusionnet.training.transformer import VECTORS

KINDS = {"cbow": "Word2vec CBOW", "random": "random, He", "skip-gram": "Word2vec skip-gram"}
SIZES: dict[Scale, tuple[int, ...]] = {
    "smoke": (10,),
    "small": (10, 50, 100),
    "thesis": (10, 50, 100, 200, 500),
}
STEPS: dict[Scale, int] = {"smoke": 3, "small": 1000, "thesis": 16_000}
BATCH: dict[Scale, int] = {"smoke": 8, "small": 16, "thesis": 60}
LAYERS: dict[Scale, int] = {"smoke": 1, "small": 2, "thesis": 4}
VECTOR_EPOCHS: dict[Scale, int] = {"smoke": 2, "small": 10, "thesis": 200}

TABLE_5_1 = {"batch": 60, "dropout": 0.1, "heads": 2, "attention_size": 12}
TABLE_5_1 |= {"feed_forward_size": 128, "longest": 200}
"""The base Transformer, apart from what this experiment or the scale sets."""


def variants(scale: Scale) -> list[Variant]:
    """One a kind and size."""
    return [
        Variant(
            name=f"{kind}-{size}",
            values={"embedding": label, "kind": kind, "size": size},
            label=f"{label}, {size}",
        )
        for kind, label in KINDS.items()
        for size in SIZES[scale]
    ]


def run(trial: Trial) -> Outcome:
    """Train a Transformer from its embeddings, and measure it on the validation groups."""
    scale = trial.scale
    kind, size = trial.variant.values["kind"], trial.variant.values["size"]
    sizes: dict[str, Any] = {**TABLE_5_1, "batch": BATCH[scale], "layers": LAYERS[scale]}
    sizes |= {"embeddings": kind, "embedding_size": size, "vector_epochs": VECTOR_EPOCHS[scale]}
    outcome = trained(trial, sizes, STEPS[scale])[2]
    vectors = asdict(VECTORS[kind]()) | {"epochs": VECTOR_EPOCHS[scale]} if kind in VECTORS else {}
    said = {"word_vectors": vectors | ({"size": size} if vectors else {})}
    return replace(outcome, configuration={**outcome.configuration, **said})


def _better(size: int, than: int) -> list[Claim]:
    return [
        Claim(
            better=f"{kind}-{size}",
            worse=f"{kind}-{than}",
            says=f"Embeddings ({label}) of size {size} are better than of size {than}.",
        )
        for kind, label in KINDS.items()
    ]


EXPERIMENT = Experiment(
    name="embeddings",
    section="5.1",
    title="Embeddings of the Transformer",
    question="Do word vectors help the translation, and of which size?",
    setup="Base Transformer (table 5.1: 2 heads, 4 layers, d_a 12, d_ff 128, dropout 0.1, 16,000 "
    "steps of 60 sequences, clean and three noised), embeddings of both vocabularies random or "
    "pretrained by skip-gram or CBOW (tables 5.2 and 5.3: 200 epochs, 5 negatives, window 9) on "
    "the training sequences; sizes 10 to 500; validation cross-entropy, three repetitions.",
    differs={
        "smoke": "Commands of our own, one layer, 3 steps: it shows only that it runs.",
        "small": f"Treebank, {SMALL_TREES}; 2 layers, 1,000 steps of 16 sequences with a one-cycle "
        "schedule, word vectors of 10 epochs, sizes 10, 50 and 100. Not converged: it tells which "
        "embeddings learn fastest, not where they end.",
        "thesis": "Treebank in place of the ETR data; exponent and least frequency of the word "
        "vectors exchanged, since they are swapped in print.",
    },
    metric="cross_entropy",
    lower_is_better=True,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    published=(
        Published(
            variant="cbow-10",
            metric="cross_entropy",
            mean=0.2818,
            deviation=0.0077,
            where="5.1.2",
        ),
        Published(
            variant="random-10",
            metric="cross_entropy",
            mean=0.2038,
            deviation=0.055,
            where="5.1.2",
        ),
        Published(
            variant="skip-gram-10",
            metric="cross_entropy",
            mean=0.1901,
            deviation=0.0036,
            where="5.1.2",
        ),
        Published(
            variant="skip-gram-50",
            metric="cross_entropy",
            mean=0.0469,
            deviation=0.0011,
            where="5.1.2",
        ),
    ),
    claims=(
        Claim(
            better="skip-gram-50",
            worse="random-50",
            says="Skip-gram vectors are better than random ones (size 50).",
        ),
        Claim(
            better="skip-gram-50",
            worse="cbow-50",
            says="Skip-gram vectors are better than those of CBOW (size 50).",
        ),
        Claim(
            better="skip-gram-10",
            worse="cbow-10",
            says="Skip-gram vectors are better than those of CBOW (size 10).",
        ),
        *_better(50, 10),
        *_better(50, 100),
    ),
    figures=(
        Figure(
            kind="lines",
            x="size",
            series="embedding",
            like="figure 5.1",
            x_label="size of the embeddings",
            y_label="validation cross-entropy [nats a token]",
        ),
    ),
    caution="The thesis states only four of the figure's fifteen numbers. The cross-entropies of "
    "the two cannot be compared: other data, other tokens, fewer steps.",
)
