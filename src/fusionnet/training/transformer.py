"""Train the thesis's Transformer: sentences, clean and noised, to the text of their trees.

`fusionnet train translator --preset thesis --data DIR` runs this. Experiments call `train`
with a configuration of their own and take its metrics. Three things the thesis leaves
open are decided here: a source token that occurs once counts as unknown, so that the
vector of unknown tokens is learnt; trees of more tokens than `l_seq` are left out of
training and count as wrong when measured; batches hold targets of like length.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import cross_entropy

from fusionnet.corpora import Command, load_corpus
from fusionnet.errors import DataError, InputError
from fusionnet.models.checkpoint import check_checkpoint_folder
from fusionnet.models.target_text import END, START, Writes, target_tokens
from fusionnet.models.transformer import Transformer
from fusionnet.models.transformer_config import thesis
from fusionnet.models.transformer_network import TransformerNetwork, number_rows
from fusionnet.randomness import derived_seed, generator
from fusionnet.rcl import format
from fusionnet.sentences import PADDING, Vocabulary, tokenize, variants, words_of
from fusionnet.sentences.word_vectors import cbow, skip_gram, train_word_vectors
from fusionnet.training.loop import LogLine, LoopConfig, Progress, fit, is_first_process
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.schedules import ScheduleConfig
from fusionnet.training.splits import Split, commands_of

Embeddings = Literal["random", "skip-gram", "cbow"]
VECTORS = {"skip-gram": skip_gram, "cbow": cbow}


def thesis_loop() -> LoopConfig:
    """Adam, the warm-up of equation 4.1, 32,000 steps (tables 5.1 and 7.1, section 5.4).

    The gradient is not clipped: the thesis mentions no bound.
    """
    return LoopConfig(
        steps=32_000,
        learning_rate=1.0,  # times what d_model gives (equation 4.1)
        schedule=ScheduleConfig(kind="inverse-root", warm_up_steps=4000),
        optimizer=OptimizerConfig(
            kind="adam", weight_decay=0.0, beta_1=0.9, beta_2=0.98, epsilon=1e-9
        ),
        clip=0.0,
        accelerator="auto",
        log_every=100,
        save_every=1000,
    )


@dataclass(frozen=True, kw_only=True)
class ThesisTranslatorConfig:
    """How to train the thesis's Transformer; the values are those of section 5.4.

    Attributes:
        out: Folder of the checkpoint; the log and the resumable state go to `work`.
        work: Folder for everything that is not the checkpoint.
        corpus: Corpus to learn from.
        data: Folder of the corpus.
        learn: Splits to learn from.
        check: Splits to measure on; their commands are not learnt from.
        writes: "rcl", "english" for the sentence itself (section 7.3), or "short" for the
            tree's values alone.
        noised: Perturbed sentences beside each clean one (3.4.1).
        embeddings: Where the embeddings begin: random, or word vectors of the training
            sentences and trees (5.1).
        vector_epochs: Passes over them when word vectors are trained.
        embedding_size: d_emb.
        layers: N_m.
        heads: N_h.
        attention_size: d_a.
        feed_forward_size: d_ff.
        fusion_nodes: D, of the fusion sublayer.
        longest: l_seq.
        dropout: P_drop.
        batch: Sentences a step.
        least: How often a source token must occur to be known.
        loop: Steps, optimiser and schedule; with an inverse root the learning rate is a factor
            of equation 4.1.
        half: Whether the checkpoint stores 16 bits a number.
        seed: Source of all randomness.
    """

    out: Path = Path("runs/thesis-translator/checkpoint")
    work: Path = Path("runs/thesis-translator")
    corpus: str = "treebank"
    data: Path | None = None
    learn: tuple[Split, ...] = ("train",)
    check: tuple[Split, ...] = ("val",)
    writes: Writes = "rcl"
    noised: int = 3
    embeddings: Embeddings = "skip-gram"
    vector_epochs: int = 200
    embedding_size: int = 50
    layers: int = 4
    heads: int = 4
    attention_size: int = 12
    feed_forward_size: int = 256
    fusion_nodes: int = 4
    longest: int = 200
    dropout: float = 0.1
    batch: int = 30
    least: int = 2
    loop: LoopConfig = field(default_factory=thesis_loop)
    half: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        if min(self.batch, self.least, self.vector_epochs, self.noised + 1) < 1:
            raise InputError(
                "batch, least and vector_epochs >= 1, noised >= 0; got "
                f"{self.batch}, {self.least}, {self.vector_epochs}, {self.noised}"
            )


@dataclass(frozen=True)
class TokenPair:
    """A sentence and what is written for it, as tokens."""

    source: tuple[str, ...]
    target: tuple[str, ...]


@dataclass(frozen=True)
class TokenBatch:
    """Sentences, what the decoder is given, and what it shall write; 0 is padding."""

    source: Int[Tensor, "b t"]
    given: Int[Tensor, "b s"]
    wanted: Int[Tensor, "b s"]

    def to(self, device: torch.device) -> "TokenBatch":
        """The same batch on another device."""
        return TokenBatch(self.source.to(device), self.given.to(device), self.wanted.to(device))


def train(config: ThesisTranslatorConfig, *, progress: Progress | None = None) -> dict[str, Any]:
    """Train, measure on the commands kept apart, and save; returns the metrics.

    Of several processes, one a device, only the first measures and saves; the others return
    nothing.

    Raises:
        DataError: If there is nothing to learn from.
        OutputError: If the checkpoint cannot be written.
    """
    check_checkpoint_folder(config.out, config.work)
    corpus = load_corpus(config.corpus, config.data)
    checked = commands_of(corpus, config.check)
    kept_apart = {command.id for command in checked}
    learnt = [c for c in commands_of(corpus, config.learn) if c.id not in kept_apart]
    translator, pairs, history = learn(learnt, config, folder=config.work, progress=progress)
    if not is_first_process():
        return {}
    metrics: dict[str, Any] = {"commands": len(learnt), "pairs": pairs}
    metrics |= measure(translator, checked) if checked else {}
    metrics["loss"] = history[-1]["loss"] if history else None
    metrics["parameters"] = sum(p.numel() for p in translator.network.parameters())
    described = {k: v for k, v in asdict(config).items() if k not in ("out", "work", "data")}
    translator.save(
        config.out, metadata={"training": described, "metrics": metrics}, half=config.half
    )
    return metrics


def learn(
    commands: Sequence[Command],
    config: ThesisTranslatorConfig,
    *,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> tuple[Transformer, int, list[LogLine]]:
    """A Transformer trained on some commands, from how many pairs, and the lines of its log.

    Args:
        commands: What to learn from.
        config: How.
        folder: Where the log and the resumable state go.
        progress: Called after every step.

    Raises:
        DataError: If no command is short enough.
    """
    translator, pairs = new_transformer(commands, config)
    rate = config.loop.learning_rate
    if config.loop.schedule.kind == "inverse-root":
        rate *= translator.network.config.model_size**-0.5
    history = fit(
        translator.network,
        lambda first: batches(pairs, translator, config, first),
        transformer_losses,
        replace(config.loop, learning_rate=rate),
        folder=folder,
        settings=config,
        seed=config.seed,
        progress=progress,
    )
    return translator, len(pairs), history


def new_transformer(
    commands: Sequence[Command], config: ThesisTranslatorConfig
) -> tuple[Transformer, list[TokenPair]]:
    """An untrained Transformer with the vocabularies of some commands, and what it learns from.

    Raises:
        DataError: If no command is short enough.
    """
    pairs = token_pairs(commands, config)
    if not pairs:
        raise DataError(
            f"The corpus {config.corpus!r} has no commands in {config.learn} whose trees have "
            f"fewer than {config.longest} tokens."
        )
    source = Vocabulary.of((pair.source for pair in pairs), config.least)
    target = Vocabulary([START, END, *Vocabulary.of(pair.target for pair in pairs).words])
    known = Vocabulary.of(words_of(c.sentence).texts for c in commands)
    made = replace(
        thesis(len(source), len(target)),
        embedding_size=config.embedding_size,
        layers=config.layers,
        heads=config.heads,
        attention_size=config.attention_size,
        feed_forward_size=config.feed_forward_size,
        fusion_nodes=config.fusion_nodes,
        longest=config.longest,
        dropout=config.dropout,
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derived_seed(config.seed, "transformer", "weights"))
        network = TransformerNetwork(made)
    if config.embeddings != "random":
        fill_embeddings(network, pairs, source, target, config)
    return Transformer(network, source, target, known, writes=config.writes), pairs


def token_pairs(commands: Sequence[Command], config: ThesisTranslatorConfig) -> list[TokenPair]:
    """Every clean sentence and its noised variants, each with the untampered target."""
    found = []
    for command in commands:
        rng = generator(config.seed, "transformer", "noise", command.id)
        noised = variants(command.sentence, rng, config.noised)
        target = tuple(target_tokens(config.writes, command.sentence, format(command.tree)))
        if len(target) < config.longest:
            said = [command.sentence, *(variant.sentence for variant in noised)]
            found += [TokenPair(_tokens(text)[: config.longest], target) for text in said]
    return found


def fill_embeddings(
    network: TransformerNetwork,
    pairs: Sequence[TokenPair],
    source: Vocabulary,
    target: Vocabulary,
    config: ThesisTranslatorConfig,
) -> None:
    """Begin both embeddings with word vectors, trained on their own sequences (5.1.1)."""
    how = replace(
        VECTORS[config.embeddings](),
        size=config.embedding_size,
        epochs=config.vector_epochs,
        seed=config.seed,
    )
    targets = [p.target for p in pairs[:: config.noised + 1]]
    for embedding, vocabulary, said in (
        (network.source_words, source, [pair.source for pair in pairs]),
        (network.target_words, target, targets),
    ):
        vectors = train_word_vectors(said, how)
        with torch.no_grad():
            embedding.weight.copy_(torch.from_numpy(vectors.matrix(vocabulary)))


def batches(
    pairs: Sequence[TokenPair],
    translator: Transformer,
    config: ThesisTranslatorConfig,
    first: int,
    pool: int = 20,
) -> Iterator[TokenBatch]:
    """Endless batches from step `first` on; the same for a resumed run.

    An epoch shows every pair once; within pools of some batches those of like length go
    together.
    """
    size = min(config.batch, len(pairs))
    an_epoch = len(pairs) // size
    step = first
    while True:
        epoch, skipped = divmod(step, an_epoch)
        rng = generator(config.seed, "transformer", "epoch", epoch)
        order = rng.permutation(len(pairs))[: an_epoch * size]
        rows = []
        for start in range(0, len(order), size * pool):
            part = sorted(order[start : start + size * pool], key=lambda i: len(pairs[i].target))
            rows += [part[i : i + size] for i in range(0, len(part), size)]
        for number in rng.permutation(len(rows))[skipped:]:
            yield collate([pairs[i] for i in rows[number]], translator)
            step += 1


def collate(pairs: Sequence[TokenPair], translator: Transformer) -> TokenBatch:
    """Pairs as tensors."""
    source = number_rows([[translator.source.number(t) for t in p.source] for p in pairs])
    return TokenBatch(source, *translator.targets([pair.target for pair in pairs]))


def transformer_losses(network: torch.nn.Module, batch: TokenBatch) -> dict[str, Float[Tensor, ""]]:
    """Cross-entropy of the tokens, without smoothing."""
    logits = network(batch.source, batch.given)
    loss = cross_entropy(logits.flatten(0, 1), batch.wanted.flatten(), ignore_index=PADDING)
    return {"tokens": loss}


def measure(
    translator: Transformer, commands: Sequence[Command], *, beam: int = 1, size: int = 32
) -> dict[str, float]:
    """What the thesis measures (5.4): cross-entropy, accuracy of words and of sentences.

    Returns:
        cross_entropy, word_accuracy: Given the right tokens before each.
        sentence_accuracy: Share of commands whose decoded tokens are all right.
    """
    sentences = [command.sentence for command in commands]
    accuracy, entropy = translator.teacher_forced(
        sentences, [None] * len(commands), [command.tree for command in commands]
    )
    rows = [_tokens(sentence)[: translator.network.config.longest] for sentence in sentences]
    wanted = [translator.wanted(command.sentence, command.tree) for command in commands]
    right = 0
    for start in range(0, len(rows), size):
        found = translator.hypotheses(rows[start : start + size], beam=beam)
        for some, row in zip(found, wanted[start : start + size], strict=True):
            right += bool(some) and translator.written(some[0]) == row
    return {
        "cross_entropy": entropy,
        "word_accuracy": accuracy,
        "sentence_accuracy": right / max(len(rows), 1),
    }


def _tokens(text: str) -> tuple[str, ...]:
    return tuple(token.text for token in tokenize(text))
