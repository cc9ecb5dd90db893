"""An output folder that is there whole or not at all."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fusionnet.errors import OutputError

RESULT_FILE = "result.json"
"""Every output folder holds one; that is how a folder of ours is known."""

RESULT_KIND = "fusionnet run"


def check_writable(out: Path) -> None:
    """Fail before any work is done, if `out` cannot become our folder.

    Raises:
        OutputError: If it is a file, holds other people's files, or cannot be made.
    """
    out = out.resolve()
    if out.is_dir():
        if any(out.iterdir()) and not _is_ours(out):
            raise OutputError(
                f"The folder {out} holds other files; name a new one, or one that an earlier "
                "run wrote (--out DIR)."
            )
    elif out.exists():
        raise OutputError(f"{out} is a file; name a folder (--out DIR).")
    with _explained(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        os.rmdir(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))


@contextmanager
def written_whole(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out` that takes its name when all went well.

    An earlier run's folder there is replaced; when anything goes wrong it stays as it was,
    and what had been written vanishes.

    Raises:
        OutputError: If the disk is full or the folder cannot be written.
    """
    check_writable(out)
    out = out.resolve()
    with _explained(out):
        aside = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
        try:
            aside.chmod(0o755)
            yield aside
            _take_place(aside, out)
        finally:
            shutil.rmtree(aside, ignore_errors=True)


def _take_place(aside: Path, out: Path) -> None:
    """Rename `aside` to `out`; a folder that stood there is kept until that is done."""
    if not out.exists():
        os.rename(aside, out)
        return
    earlier = Path(tempfile.mkdtemp(prefix=f".{out.name}-earlier-", dir=out.parent))
    os.rename(out, earlier)
    try:
        os.rename(aside, out)
    except OSError:
        os.rename(earlier, out)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def _is_ours(folder: Path) -> bool:
    """Whether an earlier run wrote this folder, and nothing but its files is in it."""
    try:
        document = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
        files = {*document["files"], RESULT_FILE}
        return document["kind"] == RESULT_KIND and {f.name for f in folder.iterdir()} <= files
    except (OSError, ValueError, TypeError, KeyError):
        return False


@contextmanager
def _explained(out: Path) -> Iterator[None]:
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"Cannot write the folder {out}: {reason}.") from error
