"""The journal of a run: JSON lines, and the same numbers for TensorBoard."""

import json
from pathlib import Path
from types import TracebackType
from typing import Any

from fusionnet.files import write_whole

LogLine = dict[str, float | int]

LOG_FILE = "log.jsonl"


class Journal:
    """Writes the lines of a run's log to `log.jsonl` and `tensorboard/` in its folder.

    Args:
        folder: Where to; None writes nothing.
        first: Step that the run begins with: what an earlier run wrote past it, before it
            was killed, is dropped, so that no step stands twice.
        tensorboard: Whether to write events for TensorBoard as well.
    """

    def __init__(self, folder: Path | None, *, first: int = 0, tensorboard: bool = True) -> None:
        self._file = folder / LOG_FILE if folder is not None else None
        self._events: Any = None
        if folder is None:
            return
        folder.mkdir(parents=True, exist_ok=True)
        _drop_lines_after(folder, first)
        if tensorboard:
            from torch.utils.tensorboard import SummaryWriter

            self._events = SummaryWriter(str(folder / "tensorboard"), purge_step=first + 1)

    def write(self, line: LogLine) -> None:
        """Append one line, which holds its `step`."""
        if self._file is not None:
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(line) + "\n")
        if self._events is not None:
            for name, value in line.items():
                if name != "step":
                    self._events.add_scalar(f"training/{name}", value, int(line["step"]))
            self._events.flush()

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._events is not None:
            self._events.close()


def read_lines(folder: Path | None, last: int) -> list[LogLine]:
    """The lines of a run's log up to a step; a line that a kill cut short is left out.

    Args:
        folder: Where the run is kept; None, or one without a log, has no lines.
        last: The step.
    """
    if folder is None or not (folder / LOG_FILE).is_file():
        return []
    kept = []
    for text in (folder / LOG_FILE).read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            line = json.loads(text)
            if line["step"] <= last:
                kept.append(line)
        except (ValueError, KeyError, TypeError):
            continue
    return kept


def _drop_lines_after(folder: Path, step: int) -> None:
    if (folder / LOG_FILE).is_file():
        kept = "".join(json.dumps(line) + "\n" for line in read_lines(folder, step))
        write_whole(folder / LOG_FILE, kept)
