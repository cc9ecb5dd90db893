"""`fusionnet translate "SENTENCE"`: a sentence to its tree, and what that would do.

Without a sentence it translates standard input, one sentence a line.
"""

import io
import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.text import Text

from fusionnet import rcl
from fusionnet.apps.attention_drawing import draw_attention
from fusionnet.apps.cli import EXIT_MISSED, EXIT_REACHED
from fusionnet.apps.setting import check_scene_named, setting_of
from fusionnet.apps.tree_drawing import draw_tree
from fusionnet.apps.tree_text import tree_text
from fusionnet.blocks import Layout
from fusionnet.errors import InputError, NotUnderstoodError, PlanningError
from fusionnet.files import check_file
from fusionnet.models.grounded_reading import GroundedReading, grounded
from fusionnet.models.reading import Reading
from fusionnet.models.sentence_reader import SentenceReader
from fusionnet.models.translators import load_translator
from fusionnet.sentences import tokenize

LINES_AT_ONCE = 512
"""Lines of standard input that are translated together."""


@dataclass(frozen=True, kw_only=True)
class TranslateConfig:
    """What to translate, and how to show it."""

    sentence: Annotated[
        str | None,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="[SENTENCE]", help_behavior_hint=""),
    ] = None
    """The command in English; without one, standard input is read, a sentence a line."""

    scene: int | None = None
    """Number of a scene of the corpus: say what the command would do in it."""

    corpus: str = "examples"
    """Where the scene comes from: "examples" (in this package) or "treebank" (with --data)."""

    data: Path | None = None
    """Folder of the corpus's files."""

    layout: Path | None = None
    """A file with a layout of your own, as JSON, instead of a scene."""

    holding: Literal["yes", "no", "unknown"] = "unknown"
    """Whether the gripper holds a block; a scene or layout says so itself."""

    count: int = 3
    """Readings to show."""

    beam: int = 10
    """Width of the search; 1 is greedy."""

    picture: Path | None = None
    """A file (.png or .svg) to draw the tree into."""

    attention: Path | None = None
    """A file (.png or .svg) to draw into where the translator looked while it wrote."""

    checkpoint: Path | None = None
    """Folder of a translator, or the shipped name compact (the default)."""

    json: bool = False
    """Print one JSON object (a line each for standard input)."""


def translate(config: TranslateConfig) -> int:
    """Translate a sentence to its tree, and say what it would do in a scene.

    Without a sentence it translates standard input, one sentence a line: the trees'
    text goes to standard output (an empty line where a sentence was not understood),
    the reasons to standard error. With a scene, the reading that fits it is taken.
    """
    for file in (config.picture, config.attention):
        if file is not None:
            if file.suffix not in (".png", ".svg"):
                raise InputError(f"A picture is a .png or .svg file, not {str(file)!r}.")
            check_file(file)
    if config.count < 1:
        raise InputError(f"At least 1 reading is shown; received --count {config.count}.")
    _check_one_sentence(config)
    layout = _layout(config)
    translator = load_translator(config.checkpoint)
    if config.sentence is None:
        return _translate_lines(config, translator, layout)
    holding = {"yes": True, "no": False, "unknown": None}[config.holding]
    if layout is not None:
        holding = layout.held is not None
    sentence = config.sentence
    readings = translator.translate(
        sentence, holding=holding, beam=config.beam, count=max(config.count, 5)
    )
    chosen, reason = _chosen(readings, layout)
    best = readings[0] if chosen is None else chosen.reading
    if config.picture is not None:
        _draw(best, sentence, config.picture)
    if config.attention is not None:
        draw_attention(best, config.attention)
    if config.json:
        document = _as_json(sentence, readings[: config.count], best, chosen, reason)
        print(json.dumps(document))
    else:
        _show(sentence, readings[: config.count], best, chosen, reason)
    return EXIT_REACHED if reason is None else EXIT_MISSED


def _check_one_sentence(config: TranslateConfig) -> None:
    """Refuse what is for one sentence where standard input is read."""
    named = {
        "--picture": config.picture is not None,
        "--attention": config.attention is not None,
        "--count": config.count != TranslateConfig.count,
    }
    options = " and ".join(option for option, is_named in named.items() if is_named)
    if config.sentence is None and options:
        raise InputError(
            f"{options} can be had of one sentence only, not of standard input; give the sentence, "
            f"or leave {options} out."
        )


def _layout(config: TranslateConfig) -> Layout | None:
    check_scene_named(config.scene, config.corpus, config.data)
    if config.scene is None and config.layout is None:
        return None
    return setting_of(
        scene=config.scene,
        corpus=config.corpus,
        data=config.data,
        layout=config.layout,
        image=None,
        seed=None,
    ).layout


def _chosen(
    readings: tuple[Reading, ...], layout: Layout | None
) -> tuple[GroundedReading | None, str | None]:
    """The reading that fits the layout, or why none does."""
    if layout is None:
        return None, None
    try:
        return grounded(readings, layout), None
    except PlanningError as error:
        return None, str(error)


def _translate_lines(
    config: TranslateConfig, translator: SentenceReader, layout: Layout | None
) -> int:
    """Translate standard input; the status is 1 if a line was not understood or cannot be done."""
    holding = {"yes": True, "no": False, "unknown": None}[config.holding]
    if layout is not None:
        holding = layout.held is not None
    status, number = EXIT_REACHED, 0
    count = 1 if layout is None else 5
    for lines in _chunks(line.rstrip("\r\n") for line in _any_bytes(sys.stdin)):
        found = translator.translate_many(lines, holding=holding, beam=config.beam, count=count)
        for line, readings in zip(lines, found, strict=True):
            number += 1
            if isinstance(readings, NotUnderstoodError):
                document, reason = {"sentence": line, "error": str(readings)}, str(readings)
                tree = ""
            else:
                chosen, refused = _chosen(readings, layout)
                best = readings[0] if chosen is None else chosen.reading
                document = _as_json(line, (), best, chosen, refused)
                reason, tree = refused or "", rcl.format(best.tree)
            if reason:
                status = EXIT_MISSED
                print(f"line {number}: {reason}", file=sys.stderr)
            print(json.dumps(document) if config.json else tree)
        sys.stdout.flush()
    return status


def _any_bytes(stream: Iterable[str]) -> Iterable[str]:
    """The stream, with a replacement for what is no UTF-8."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(encoding="utf-8", errors="replace")
    return stream


def _chunks(lines: Iterable[str]) -> Iterator[list[str]]:
    lines = iter(lines)
    while chunk := list(islice(lines, LINES_AT_ONCE)):
        yield chunk


def _draw(reading: Reading, sentence: str, file: Path) -> None:
    draw_tree(reading.tree, [token.text for token in tokenize(sentence)], file)


def _reading(reading: Reading) -> dict[str, Any]:
    return {
        "rcl": rcl.format(reading.tree),
        "english": rcl.describe(reading.tree),
        "probability": reading.probability,
    }


def _as_json(
    sentence: str,
    readings: tuple[Reading, ...],
    best: Reading,
    chosen: GroundedReading | None,
    reason: str | None,
) -> dict[str, Any]:
    document: dict[str, Any] = {
        "sentence": sentence,
        "tokens": [token.text for token in tokenize(sentence)],
        **_reading(best),
    }
    if readings:
        document["readings"] = [_reading(reading) for reading in readings]
    if chosen is not None:
        document["move"] = {
            "source": list(chosen.move.source),
            "target": list(chosen.move.target),
            "begins_held": chosen.move.begins_held,
            "ends_held": chosen.move.ends_held,
        }
        document["remark"] = chosen.remark
    if reason is not None:
        document["refused"] = reason
    return document


def _show(
    sentence: str,
    readings: tuple[Reading, ...],
    best: Reading,
    chosen: GroundedReading | None,
    reason: str | None,
) -> None:
    console = Console(highlight=False)
    console.print(Text(rcl.describe(best.tree), style="bold"), soft_wrap=True)
    console.print()
    console.print(tree_text(best.tree, sentence), soft_wrap=True)
    console.print()
    console.print(Text(rcl.format(best.tree), style="dim"), soft_wrap=True)
    console.print()
    taken = 0 if chosen is None else chosen.place
    for place, reading in enumerate(readings):
        mark = "*" if place == taken else " "
        console.print(
            Text(f"{mark} {reading.probability:6.1%}  {rcl.describe(reading.tree)}"), soft_wrap=True
        )
    if chosen is not None:
        source, target = tuple(chosen.move.source), tuple(chosen.move.target)
        console.print(Text(f"\nIt would move the block at {source} to {target}. {chosen.remark}"))
    if reason is not None:
        console.print(Text(f"\nIt cannot be done in this scene: {reason}", style="red"))
