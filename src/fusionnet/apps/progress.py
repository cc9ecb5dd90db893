"""One bar for each stage of long work; silent where there is no terminal."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


class Bar:
    """A callback that moves one bar: called with done, of how many, and maybe a log line."""

    def __init__(self, progress: Progress, stage: str) -> None:
        self._progress = progress
        self._task = progress.add_task(stage, total=None, visible=False, losses="")

    def __call__(
        self, done: int, total: int, line: Mapping[str, float | int] | None = None
    ) -> None:
        """Show that `done` of `total` is done."""
        losses = f"loss {line['loss']:.4g}" if line and "loss" in line else ""
        self._progress.update(self._task, completed=done, total=total, visible=True, losses=losses)


@contextmanager
def bars() -> Iterator[Callable[[str], "Bar"]]:
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
        yield lambda stage: Bar(progress, stage)
