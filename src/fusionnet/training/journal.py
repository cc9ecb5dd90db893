"""The journal of a run: JSON lines, and the same numbers for TensorBoard."""

import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any

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
        _drop_lines_after(folder / LOG_FILE, first)
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


def _drop_lines_after(file: Path, step: int) -> None:
    """Keep the lines up to a step; a line that a kill cut short goes too."""
    if not file.is_file():
        return
    kept = []
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            if json.loads(line)["step"] <= step:
                kept.append(line + "\n")
        except (ValueError, KeyError, TypeError):
            continue
    aside = file.with_name(f".{LOG_FILE}.part")
    aside.write_text("".join(kept), encoding="utf-8")
    os.replace(aside, file)
