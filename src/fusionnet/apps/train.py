"""`fusionnet train ...`: the trainers of the library, with a bar for each of their stages."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from fusionnet.training.detector import DetectorConfig
from fusionnet.training.detector import train as train_detector
from fusionnet.training.fusion import FusionConfig
from fusionnet.training.fusion import train as train_fusion
from fusionnet.training.translator import TranslatorConfig
from fusionnet.training.translator import train as train_translator


def detector(config: DetectorConfig) -> dict[str, Any]:
    """Render pictures and train the detector: boxes, the camera's pose, the layout.

    Prints its metrics on the validation groups as JSON.
    """
    with bars() as bar:
        return train_detector(config, progress=bar("training"), rendering=bar("rendering"))


def translator(config: TranslatorConfig) -> dict[str, Any]:
    """Train the translator: a sentence to its tree.

    Prints its metrics on the commands kept apart as JSON.
    """
    with bars() as bar:
        return train_translator(config, progress=bar("training"))


def fusion(config: FusionConfig) -> dict[str, Any]:
    """Train FusionNet: picture and sentence to the fourteen values.

    Prints its metrics on the validation groups as JSON.
    """
    with bars() as bar:
        return train_fusion(config, progress=bar("training"))


class _Bar:
    """A callback that moves one bar: called with done, of how many, and maybe a log line."""

    def __init__(self, progress: Progress, stage: str) -> None:
        self._progress = progress
        self._task = progress.add_task(stage, total=None, visible=False, losses="")

    def __call__(self, done: int, total: int, line: Mapping[str, float] | None = None) -> None:
        losses = f"loss {line['loss']:.4g}" if line and "loss" in line else ""
        self._progress.update(self._task, completed=done, total=total, visible=True, losses=losses)


@contextmanager
def bars() -> Iterator[Any]:
    """A function that makes a bar for a named stage; on no terminal they stay silent."""
    logging.getLogger("fusionnet").setLevel(logging.INFO)
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[losses]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        yield lambda stage: _Bar(progress, stage)
