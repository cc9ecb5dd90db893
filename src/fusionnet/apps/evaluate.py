"""`fusionnet evaluate ...`: measure a policy, a translator or a detector, and print the numbers."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from rich.table import Table

from fusionnet.apps.gallery import Gallery
from fusionnet.apps.progress import bars
from fusionnet.evaluation.detection import DetectionEvaluation
from fusionnet.evaluation.detection import evaluate as evaluate_detection
from fusionnet.evaluation.policy import PolicyEvaluation
from fusionnet.evaluation.policy import evaluate as evaluate_policy
from fusionnet.evaluation.translation import TranslationEvaluation
from fusionnet.evaluation.translation import evaluate as evaluate_translation
from fusionnet.files import check_file, write_whole
from fusionnet.provenance import provenance


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """What to measure, and how to print it."""

    what: tyro.conf.OmitArgPrefixes[PolicyEvaluation] = field(default_factory=PolicyEvaluation)
    gallery: Path | None = None
    """A page (.html) to write, with a card for every episode that failed."""
    json: bool = False
    """Print one JSON object instead of the table."""


@dataclass(frozen=True, kw_only=True)
class TranslatorConfig:
    """What to measure, and how to print it."""

    what: tyro.conf.OmitArgPrefixes[TranslationEvaluation] = field(
        default_factory=TranslationEvaluation
    )
    json: bool = False
    """Print one JSON object instead of the table."""


@dataclass(frozen=True, kw_only=True)
class DetectorConfig:
    """What to measure, and how to print it."""

    what: tyro.conf.OmitArgPrefixes[DetectionEvaluation] = field(
        default_factory=DetectionEvaluation
    )
    json: bool = False
    """Print one JSON object instead of the table."""


def policy(config: PolicyConfig) -> None:
    """Measure how often a policy's answer, executed in the simulator, does what was asked.

    Failures are counted by what is to blame: read wrong, saw wrong, pointed wrong, slipped.
    """
    gallery = Gallery()
    if config.gallery is not None:
        check_file(config.gallery)
    with bars() as bar:
        report = evaluate_policy(config.what, progress=bar("episodes"), watch=gallery)
    if config.gallery is not None:
        write_whole(config.gallery, gallery.page(report.as_json()))
    _show("policy", report.as_json(), as_json=config.json)


def translator(config: TranslatorConfig) -> None:
    """Measure how many sentences are read exactly, and well enough to act on."""
    _show("translator", evaluate_translation(config.what), as_json=config.json)


def detector(config: DetectorConfig) -> None:
    """Measure how well blocks are found and layouts read: on a data set, or through the eye.

    Prints instances and average precision of every class, as table 6.2 of the thesis.
    """
    with bars() as bar:
        measured = evaluate_detection(config.what, progress=bar("pictures"))
    if config.json:
        print(json.dumps({**measured, "provenance": provenance()}))
        return
    classes = {name: c for name, c in measured.pop("classes").items() if c["instances"]}
    if lenient := measured.get("without_mostly_hidden_blocks"):
        del lenient["classes"]
    _show("detector", measured, as_json=False)
    table = Table("class", "instances", "AP@0.5", "AP@[.5:.95]", title_justify="left")
    for name, found in classes.items():
        values = (f"{found[key]:.4f}" for key in ("ap_50", "ap_50_95"))
        table.add_row(name, str(found["instances"]), *values)
    Console(highlight=False).print(table)


def _show(title: str, numbers: Mapping[str, Any], *, as_json: bool) -> None:
    """Print a measurement: all of it as JSON, or its numbers as a table."""
    if as_json:
        print(json.dumps({**numbers, "provenance": provenance()}))
        return
    table = Table(title=title, show_header=False, title_justify="left")
    for name, value in numbers.items():
        if isinstance(value, list) and len(value) > 2:
            continue  # lists of single cases are for the JSON
        table.add_row(name.replace("_", " "), _readable(value))
    console = Console(highlight=False)
    console.print(table, soft_wrap=not console.is_terminal)


def _readable(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return " to ".join(_readable(item) for item in value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_readable(item)}" for key, item in value.items())
    return str(value)
