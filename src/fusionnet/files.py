"""Files that are whole or not there: written aside, then renamed."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fusionnet.errors import OutputError


def write_whole(file: Path, content: str | bytes) -> None:
    """Write a file, whole or not at all; its folder is made if it is missing.

    Raises:
        OutputError: If it cannot be written; what was there before is still there.
    """
    aside = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            aside.write_bytes(content.encode() if isinstance(content, str) else content)
            os.replace(aside, file)
        finally:
            aside.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"Cannot write {file}: {error.strerror or error}.") from error


def check_new_folder(folder: Path) -> None:
    """Fail before any work is done, if `folder` cannot become a new one.

    Raises:
        OutputError: If it is a file, holds files already, or cannot be made.
    """
    try:
        if folder.is_dir():
            if any(folder.iterdir()):
                raise OutputError(
                    f"The folder {folder} holds files already; name a new one, or remove it first."
                )
        elif folder.exists():
            raise OutputError(f"{folder} is a file; name a folder.")
        folder.resolve().parent.mkdir(parents=True, exist_ok=True)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"Cannot make {folder}: {error.strerror or error}.") from error


@contextmanager
def folder_whole(folder: Path) -> Iterator[Path]:
    """A folder aside that takes the name of a new `folder` when all went well.

    When anything goes wrong nothing is left of it.

    Raises:
        OutputError: If `folder` holds files already, or it cannot be written.
    """
    check_new_folder(folder)
    folder = folder.resolve()
    try:
        aside = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        try:
            aside.chmod(0o755)
            yield aside
            os.replace(aside, folder)  # also onto an empty folder
        finally:
            shutil.rmtree(aside, ignore_errors=True)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"Cannot write {folder}: {error.strerror or error}.") from error
