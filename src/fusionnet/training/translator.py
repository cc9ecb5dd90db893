"""Train the translator: sentences to trees, from a few thousand commands and their alignments.

`fusionnet train translator --data DIR` runs this: minutes on one core. Half of each
epoch is drawn towards sentences with rare symbols, and every sentence is changed
anew each time it is seen (`sentence_augmentation`).
"""

import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import cross_entropy

from fusionnet.corpora import Command, load_corpus, synthetic
from fusionnet.errors import DataError, InputError
from fusionnet.models.checkpoint import check_checkpoint_folder
from fusionnet.models.lexicon import Lexicon
from fusionnet.models.sentence_reader import SentenceReader
from fusionnet.models.translator import Translator
from fusionnet.models.translator_network import (
    STATES,
    SentenceBatch,
    TranslatorNetwork,
    TranslatorNetworkConfig,
    padded,
    state_word,
)
from fusionnet.models.tree_symbols import END, NUMBERS, PADDING, START
from fusionnet.randomness import derived_seed, generator
from fusionnet.sentences import UNKNOWN, Vocabulary
from fusionnet.sentences.phrases import COLOR_PHRASES, NUMBER_WORDS, OPENINGS, SYNONYMS
from fusionnet.training.aligned_sentences import (
    AlignedSentence,
    aligned_all,
    describes_what_is_dropped,
)
from fusionnet.training.loop import LoopConfig, Progress, fit, is_first_process
from fusionnet.training.sentence_augmentation import AugmentationConfig, Augmenter
from fusionnet.training.splits import Split, commands_of

log = logging.getLogger(__name__)

IGNORED = -100
"""Target of what has no right answer: the words of a marker."""

SYNTHETIC_SEED = 1_000
"""Seed of the synthetic commands to learn from; the corpus "synthetic" has seed 0."""

LOSS_WEIGHTS = {"symbols": 1.0, "words": 0.3}


@dataclass(frozen=True, kw_only=True)
class TranslatorConfig:
    """How to train the translator.

    Attributes:
        out: Folder of the checkpoint; the log and the resumable state go to `work`.
        work: Folder for everything that is not the checkpoint.
        corpus: Corpus to learn from.
        data: Folder of the corpus.
        learn: Splits to learn from; the test groups are never among the default ones.
        check: Splits to measure on; their commands are not learnt from.
        batch: Sentences a step.
        invented: How many synthetic commands to learn from beside the corpus's.
        invented_share: Share of the sentences of an epoch that are synthetic ones.
        rare: Share of the corpus's sentences that are drawn towards rare symbols.
        unknown_words: Share of words whose vector is hidden, so that spelling must do.
        smoothing: Share of probability that targets give away to all symbols.
        augmentation: How sentences are changed.
        loop: Steps and schedule.
        half: Whether the checkpoint stores 16 bits a number.
        seed: Source of all randomness.
    """

    out: Path = Path("runs/translator/checkpoint")
    work: Path = Path("runs/translator")
    corpus: str = "treebank"
    data: Path | None = None
    learn: tuple[Split, ...] = ("train", "val")
    check: tuple[Split, ...] = ("test",)
    batch: int = 64
    invented: int = 4000
    invented_share: float = 0.25
    rare: float = 0.5
    unknown_words: float = 0.1
    smoothing: float = 0.03
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=2400, learning_rate=2e-3, average=0.998, loss_weights=LOSS_WEIGHTS
        )
    )
    half: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        if self.batch < 1 or self.invented < 0:
            raise InputError(
                "batch is at least 1, invented at least 0; received "
                f"{self.batch} and {self.invented}."
            )
        shares = (self.invented_share, self.rare, self.unknown_words, self.smoothing)
        if not all(0 <= share <= 1 for share in shares):
            raise InputError(
                "invented_share, rare, unknown_words and smoothing go from 0 to 1; received "
                f"{', '.join(map(str, shares))}."
            )


@dataclass(frozen=True)
class TrainingBatch:
    """Sentences and what the network shall write for them.

    Attributes:
        sentences: The words.
        given: Symbols from `START` on.
        wanted: Symbols up to `END`; padding behind it.
        spans: First and last word of each wanted symbol, 0 where no word says it,
            `IGNORED` where nothing is asked.
    """

    sentences: SentenceBatch
    given: Int[Tensor, "b s"]
    wanted: Int[Tensor, "b s"]
    spans: Int[Tensor, "b s 2"]

    def to(self, device: torch.device) -> "TrainingBatch":
        """The same batch on another device."""
        return TrainingBatch(
            self.sentences.to(device),
            self.given.to(device),
            self.wanted.to(device),
            self.spans.to(device),
        )


def train(config: TranslatorConfig, *, progress: Progress | None = None) -> dict[str, Any]:
    """Train, measure on the commands kept apart, and save; returns the metrics.

    Of several processes, one a device, only the first measures and saves; the others return
    nothing.

    Raises:
        OutputError: If the checkpoint cannot be written.
    """
    check_checkpoint_folder(config.out, config.work)
    corpus = load_corpus(config.corpus, config.data)
    checked = commands_of(corpus, config.check)
    kept_apart = {command.id for command in checked}
    learnt = [c for c in commands_of(corpus, config.learn) if c.id not in kept_apart]
    sentences = [s for s in aligned_all(learnt) if not describes_what_is_dropped(s)]
    if not sentences:
        raise DataError(f"The corpus {config.corpus!r} has no commands in {config.learn} to learn.")
    invented = aligned_all(islice(synthetic.commands(SYNTHETIC_SEED), config.invented))
    vocabulary = vocabulary_of([*sentences, *invented])
    network = new_network(len(vocabulary), config.seed)
    history = fit(
        network,
        lambda first: batches(sentences, vocabulary, config, first, invented),
        lambda wrapped, batch: translator_losses(wrapped, batch, config.smoothing),
        config.loop,
        folder=config.work,
        settings=config,
        seed=config.seed,
        progress=progress,
    )
    if not is_first_process():
        return {}
    translator = Translator(network, vocabulary, lexicon_of([*sentences, *invented], vocabulary))
    metrics = {
        "sentences": len(sentences),
        "invented": len(invented),
        "checked": len(checked),
        "exact": exact(translator, checked) if checked else None,
        "loss": history[-1]["loss"] if history else None,
        "parameters": sum(p.numel() for p in network.parameters()),
    }
    described = {k: v for k, v in asdict(config).items() if k not in ("out", "work", "data")}
    translator.save(
        config.out, metadata={"training": described, "metrics": metrics}, half=config.half
    )
    return metrics


def vocabulary_of(sentences: Sequence[AlignedSentence], least: int = 2) -> Vocabulary:
    """The words that occur often enough, the gripper's states, and those of our own phrases."""
    ours = [words.split() for words in OPENINGS]
    ours += [phrase.split() for phrases, _ in COLOR_PHRASES.values() for phrase in phrases]
    ours += [phrase.split() for known in SYNONYMS.values() for phrase in known]
    ours += [[*STATES, *NUMBER_WORDS]]
    return Vocabulary.of([*(s.words for s in sentences), *ours, *ours], least)


def lexicon_of(sentences: Sequence[AlignedSentence], vocabulary: Vocabulary) -> Lexicon:
    """What the vocabulary's words say, in sentences and in our own phrases."""
    phrases = [
        (f"color:{color}", phrase.split())
        for color, (known, _) in COLOR_PHRASES.items()
        for phrase in known
    ]
    phrases += [(name, p.split()) for name, known in SYNONYMS.items() for p in known]
    phrases += [
        (f"cardinal:{number}", [word]) for number, word in enumerate(NUMBER_WORDS) if number
    ]
    idle = {word for opening in OPENINGS for word in opening.split()}
    idle |= {"tower", "stack", "pile", "bricks"}  # "a tower of bricks": one of them says it
    learnt = Lexicon.of(((s.words, s.symbols, s.spans) for s in sentences), phrases, idle)
    return learnt.kept(vocabulary.words)


def new_network(words: int, seed: int) -> TranslatorNetwork:
    """An untrained network."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derived_seed(seed, "translator", "weights"))
        return TranslatorNetwork(TranslatorNetworkConfig(words=words))


def batches(
    sentences: Sequence[AlignedSentence],
    vocabulary: Vocabulary,
    config: TranslatorConfig,
    first: int,
    invented: Sequence[AlignedSentence] = (),
) -> Iterator[TrainingBatch]:
    """Endless batches from step `first` on; the same for a resumed run.

    An epoch takes as many sentences as there are, changes them, sorts them by length
    within pools of some batches, and gives the batches in random order. The synthetic
    ones take their share of the places.
    """
    augment = Augmenter(sentences, config.augmentation)
    weights = rarity(sentences)
    size = min(config.batch, len(sentences))
    an_epoch = max(1, len(sentences) // size)
    step = first
    while True:
        epoch, skipped = divmod(step, an_epoch)
        rng = generator(config.seed, "translator", "epoch", epoch)
        ours = int(config.invented_share * an_epoch * size) if invented else 0
        rare = int(config.rare * (an_epoch * size - ours))
        common = an_epoch * size - ours - rare
        chosen = [sentences[i] for i in rng.permutation(len(sentences))[:common]]
        chosen += [sentences[i] for i in rng.choice(len(sentences), rare, p=weights)]
        chosen += [invented[i] for i in rng.integers(max(len(invented), 1), size=ours)]
        changed = [augment(chosen[i], rng) for i in rng.permutation(len(chosen))]
        rows = _bucketed(changed, size, rng)
        hidden = [rng.random((size, 1 + max(len(s.words) for s in row))) for row in rows]
        for row, chance in list(zip(rows, hidden, strict=True))[skipped:]:
            yield collate(row, vocabulary, chance < config.unknown_words)
            step += 1


def collate(
    sentences: Sequence[AlignedSentence], vocabulary: Vocabulary, hidden: np.ndarray | None = None
) -> TrainingBatch:
    """Sentences as tensors; the word vectors of `hidden` places are replaced by the unknown's."""
    words = [(state_word(s.holding), *s.words) for s in sentences]
    batch = SentenceBatch.of(words, vocabulary, TranslatorNetworkConfig(words=1).buckets)
    if hidden is not None:
        cover = torch.from_numpy(hidden) & (batch.spellings > 0)
        batch.numbers[cover] = UNKNOWN
    numbers = [[NUMBERS[name] for name in s.symbols] for s in sentences]
    spans = [
        [
            (IGNORED, IGNORED) if ":" not in n else (0, 0) if s is None else (s[0] + 1, s[1] + 1)
            for n, s in zip(sentence.symbols, sentence.spans, strict=True)
        ]
        for sentence in sentences
    ]
    first = padded([[*(a for a, _ in row), IGNORED] for row in spans], IGNORED)
    last = padded([[*(b for _, b in row), IGNORED] for row in spans], IGNORED)
    return TrainingBatch(
        batch,
        padded([[NUMBERS[START], *row] for row in numbers], NUMBERS[PADDING]),
        padded([[*row, NUMBERS[END]] for row in numbers], NUMBERS[PADDING]),
        torch.stack((first, last), -1),
    )


def translator_losses(
    network: torch.nn.Module, batch: TrainingBatch, smoothing: float
) -> dict[str, Float[Tensor, ""]]:
    """The losses of a batch, see `symbol_losses`."""
    logits, scores = network(batch.sentences, batch.given)
    return symbol_losses(logits, scores, batch, smoothing)


def symbol_losses(
    logits: Float[Tensor, "b s n"],
    scores: Float[Tensor, "b s 2 t"],
    batch: TrainingBatch,
    smoothing: float,
) -> dict[str, Float[Tensor, ""]]:
    """`symbols`: cross-entropy of the symbols; `words`: of the words that each head points at."""
    symbols = cross_entropy(
        logits.flatten(0, 1),
        batch.wanted.flatten(),
        ignore_index=NUMBERS[PADDING],
        label_smoothing=smoothing,
    )
    words = cross_entropy(scores.flatten(0, 2), batch.spans.flatten(), ignore_index=IGNORED)
    return {"symbols": symbols, "words": words}


def rarity(sentences: Sequence[AlignedSentence]) -> Float[np.ndarray, " n"]:
    """A probability for each sentence: larger, the rarer its rarest symbol is."""
    counts = Counter(name for s in sentences for name in set(s.symbols))
    weights = np.array([min(counts[name] for name in s.symbols) ** -0.5 for s in sentences])
    return weights / weights.sum()


def exact(translator: SentenceReader, commands: Sequence[Command], size: int = 64) -> float:
    """Share of commands whose most probable tree is the right one."""
    right = 0
    for start in range(0, len(commands), size):
        part = commands[start : start + size]
        found = translator.read(
            [c.sentence for c in part],
            [c.scene.before.held is not None for c in part],
            count=1,
        )
        right += sum(bool(r) and r[0].tree == c.tree for r, c in zip(found, part, strict=True))
    return right / len(commands)


def _bucketed(
    sentences: list[AlignedSentence], size: int, rng: np.random.Generator, pool: int = 10
) -> list[list[AlignedSentence]]:
    """Batches of like length, in random order."""
    rows = []
    for start in range(0, len(sentences), size * pool):
        part = sorted(sentences[start : start + size * pool], key=lambda s: len(s.words))
        rows += [part[i : i + size] for i in range(0, len(part), size)]
    return [rows[i] for i in rng.permutation(len(rows))]
