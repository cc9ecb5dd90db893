"""Figure 5.1: the Transformer's cross-entropy by kind and size of its embeddings.

Embeddings begin at random (He's scale), or with word vectors of the training sentences
and trees by skip-gram or CBOW (tables 5.2 and 5.3).
"""

from dataclasses import asdict, replace
from typing import Any

import torch

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
from fusionnet.experiments._sources import corpus_for
from fusionnet.training.loop import LoopConfig, fit
from fusionnet.training.schedules import ScheduleConfig
from fusionnet.training.transformer import (
    VECTORS,
    ThesisTranslatorConfig,
    batches,
    new_transformer,
    thesis_loop,
    transformer_losses,
)

KINDS = {"cbow": "Word2vec CBOW", "random": "random, He", "skip-gram": "Word2vec skip-gram"}
SIZES: dict[Scale, tuple[int, ...]] = {
    "smoke": (10,),
    "small": (10, 50, 100),
    "thesis": (10, 50, 100, 200, 500),
}
STEPS: dict[Scale, int] = {"smoke": 3, "small": 150, "thesis": 16_000}
BATCH: dict[Scale, int] = {"smoke": 8, "small": 16, "thesis": 60}
LAYERS: dict[Scale, int] = {"smoke": 1, "small": 2, "thesis": 4}
VECTOR_EPOCHS: dict[Scale, int] = {"smoke": 2, "small": 10, "thesis": 200}

SMALL_RATE = 5e-3
"""Peak of the one-cycle at the smaller scales: 4000 steps of warm-up would never end there."""

TABLE_5_1 = {"batch": 60, "dropout": 0.1, "heads": 2, "attention_size": 12}
TABLE_5_1 |= {"feed_forward_size": 128, "longest": 200}
"""The base Transformer, apart from what this experiment or the scale sets."""

TABLE_5_2 = {"epochs": 200, "model": "cbow", "negatives": 5, "negative_exponent": 5, "window": 9}
TABLE_5_2 |= {"least": 0.75, "learning_rate": 0.025, "least_learning_rate": 0.001}
TABLE_5_3 = {**TABLE_5_2, "model": "skip-gram"}
"""As printed. `sentences.word_vectors` says why exponent and least frequency are exchanged."""


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


def loop_of(scale: Scale, seed: int) -> LoopConfig:
    """The thesis's optimiser; its schedule only where there are steps enough for it."""
    loop = replace(thesis_loop(), steps=STEPS[scale], seed=seed, tensorboard=False)
    if scale == "thesis":
        return loop
    return replace(
        loop,
        learning_rate=SMALL_RATE,
        schedule=ScheduleConfig(kind="one-cycle"),
        accelerator="cpu",
        log_every=max(1, STEPS[scale] // 20),
        save_every=50,
    )


def run(trial: Trial) -> Outcome:
    """Train a Transformer from its embeddings, and measure it on the validation groups."""
    torch.set_num_threads(1)
    scale = trial.scale
    corpus = corpus_for(trial)
    sizes: dict[str, Any] = {**TABLE_5_1, "batch": BATCH[scale], "layers": LAYERS[scale]}
    config = ThesisTranslatorConfig(
        embeddings=trial.variant.values["kind"],
        embedding_size=trial.variant.values["size"],
        vector_epochs=VECTOR_EPOCHS[scale],
        loop=loop_of(scale, trial.seed),
        seed=trial.seed,
        **sizes,
    )
    translator, pairs = new_transformer(corpus.split("train"), config)
    rate = config.loop.learning_rate
    if scale == "thesis":
        rate *= translator.network.config.model_size**-0.5
    history = fit(
        translator.network,
        lambda first: batches(pairs, translator, config, first),
        transformer_losses,
        replace(config.loop, learning_rate=rate),
        folder=trial.state,
        progress=trial.progress,
    )
    checked = corpus.split("val")
    translator.network.cpu()
    accuracy, entropy = translator.teacher_forced(
        [command.sentence for command in checked],
        [None] * len(checked),
        [command.tree for command in checked],
    )
    kind = trial.variant.values["kind"]
    vectors = asdict(VECTORS[kind]()) | {"epochs": config.vector_epochs} if kind in VECTORS else {}
    return Outcome(
        metrics={"cross_entropy": entropy, "token_accuracy": accuracy},
        configuration={
            **sizes,
            "steps": config.loop.steps,
            "learning_rate": config.loop.learning_rate,
            "word_vectors": vectors | ({"size": config.embedding_size} if vectors else {}),
            "corpus": corpus.name,
            "pairs": len(pairs),
            "measured": len(checked),
        },
        curves={n: [float(line[n]) for line in history] for n in ("step", "tokens")},
    )


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
        "small": "Treebank, 2 layers, 150 steps of 16 sequences with a one-cycle schedule, "
        "word vectors of 10 epochs, sizes 10, 50 and 100. Far from converged: it tells which "
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
