"""`fusionnet corpus stats|export|vectors`: what is in a corpus, as tables, files and vectors."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import tyro
from rich.console import Console
from rich.table import Table

from fusionnet.apps.corpus_source import CorpusSource, read_corpus
from fusionnet.apps.progress import bars
from fusionnet.corpora import json_lines, treebank_files
from fusionnet.errors import InputError
from fusionnet.files import check_file, folder_whole, write_whole
from fusionnet.sentences.corpus_statistics import statistics
from fusionnet.sentences.word_vectors import (
    WordVectorConfig,
    noised_sentences,
    train_word_vectors,
    tree_sentences,
)


@dataclass(frozen=True, kw_only=True)
class StatsConfig:
    """Which commands to count."""

    source: tyro.conf.OmitArgPrefixes[CorpusSource] = field(default_factory=CorpusSource)
    json: bool = False
    """Print one JSON object instead of tables."""


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """What to write, and where to."""

    out: Path
    """The file (json) or folder (treebank) to write; one that exists is refused."""

    form: Literal["json", "treebank"] = "json"
    """JSON lines, one a command; or the treebank's three text files, which can be read again."""

    source: tyro.conf.OmitArgPrefixes[CorpusSource] = field(default_factory=CorpusSource)


@dataclass(frozen=True, kw_only=True)
class VectorsConfig:
    """Which words to train vectors of, and how."""

    out: Path
    """The file (.safetensors) to write."""

    of: Literal["sentences", "trees"] = "sentences"
    """Sentences, each with three perturbed variants, or the texts of the trees."""

    source: tyro.conf.OmitArgPrefixes[CorpusSource] = field(default_factory=CorpusSource)
    how: WordVectorConfig = field(default_factory=WordVectorConfig)
    """How to train them; the defaults are the thesis's."""


def stats(config: StatsConfig) -> None:
    """Count a corpus: commands, words, trees, the values in them, and what was left out."""
    corpus = read_corpus(config.source)
    parts: dict[str, Any] = {config.source.part: statistics(corpus.commands)}
    if config.source.part == "all":
        for part in ("train", "val", "test"):
            parts[part] = statistics(corpus.split(part))
    numbers = {
        "corpus": corpus.name,
        "scenes": len(corpus.scenes),
        "layouts": len(corpus.layouts),
        "left_out": dict(corpus.left_out),
        "parts": parts,
    }
    if config.json:
        print(json.dumps(numbers))
        return
    console = Console(highlight=False)
    title = f"{corpus.name}: {len(corpus.scenes)} scenes, {len(corpus.layouts)} layouts"
    _print(console, _counts(title, parts))
    for kind in ("actions", *parts[config.source.part]["values"]):
        _print(console, _values(kind, parts))
    _print(console, _values("unaligned", parts, "leaves that no word says"))
    left_out = Table("left out", "commands", title_justify="left")
    for reason, count in corpus.left_out.items() or [("nothing", 0)]:
        left_out.add_row(reason, str(count))
    _print(console, left_out)


def export(config: ExportConfig) -> dict[str, Any]:
    """Write a corpus as JSON lines, or in the treebank's form; prints what was written."""
    corpus = read_corpus(config.source)
    if config.out.exists():
        raise InputError(f"{config.out} is there already; name a new file or folder (--out).")
    if config.form == "json":
        write_whole(config.out, json_lines(corpus))
    else:
        with folder_whole(config.out) as aside:
            for name, text in treebank_files(corpus).items():
                write_whole(aside / name, text)
    return {
        "corpus": corpus.name,
        "commands": len(corpus.commands),
        "left_out": dict(corpus.left_out),
        "out": str(config.out),
    }


def vectors(config: VectorsConfig) -> dict[str, Any]:
    """Train word vectors (skip-gram or CBOW, as the thesis's tables 5.2 and 5.3) on a corpus.

    Prints the words and, for the commonest, the words nearest to them.
    """
    check_file(config.out)
    commands = read_corpus(config.source).commands
    sentences = (
        noised_sentences(commands, config.how.seed)
        if config.of == "sentences"
        else tree_sentences(commands)
    )
    with bars() as bar:
        trained = train_word_vectors(sentences, config.how, progress=bar("epochs"))
    trained.save(config.out)
    near = {word: [n for n, _ in trained.nearest(word, 3)] for word in trained.words[:12]}
    return {
        "sentences": len(sentences),
        "words": len(trained.words),
        "size": config.how.size,
        "nearest": near,
        "out": str(config.out),
    }


def _counts(title: str, parts: Mapping[str, Any]) -> Table:
    table = Table("", *parts, title=title, title_justify="left")
    for name in ("commands", "scenes", "groups", "holding", "words"):
        table.add_row(name, *(str(part[name]) for part in parts.values()))
    for name in ("words_a_sentence", "nodes_a_tree"):
        for measure, said in (("mean", "mean"), ("p95", "95 % to"), ("most", "most")):
            numbers = (f"{part[name][measure]:.4g}" for part in parts.values())
            table.add_row(f"{name.replace('_', ' ')}, {said}", *numbers)
    return table


def _values(kind: str, parts: Mapping[str, Any], title: str | None = None) -> Table:
    """How often each value is in each part."""
    counts = [part[kind] if kind in part else part["values"][kind] for part in parts.values()]
    table = Table(title or kind, *parts)
    for value in counts[0]:
        table.add_row(str(value), *(str(count.get(value, 0)) for count in counts))
    return table


def _print(console: Console, table: Table) -> None:
    console.print(table, soft_wrap=not console.is_terminal)
