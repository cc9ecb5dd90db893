"""Files that are whole or not there: written aside, then renamed."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fusionnet.errors import OutputError


def write_whole(file: Path, content: str | bytes) -> None:
    """Write a file, whole or not at all; its folder is made if it is missing.

    Raises:
        OutputError: If it cannot be written; what was there before is still there.
    """
    try:
        _check_name(file)
        aside = file.with_name(f".{file.name}.{os.getpid()}.part")
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            aside.write_bytes(content.encode() if isinstance(content, str) else content)
            os.replace(aside, file)
        finally:
            aside.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"Cannot write {file}: {error.strerror or error}.") from error


def check_file(file: Path) -> None:
    """Fail before any work is done, if `file` could not be written.

    Raises:
        OutputError: If it is a folder, or its folder cannot be one or may not be written.
    """
    _check_name(file)
    check_folder(file.parent)


def _check_name(file: Path) -> None:
    if not file.name or file.is_dir():
        raise OutputError(f"{file} is a folder; name a file in it.")


def check_folder(folder: Path) -> None:
    """Fail before any work is done, if files could not be written into a folder, new or not.

    Raises:
        OutputError: If a file is in its way, or it may not be written.
    """
    there = folder.resolve()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise OutputError(f"{there} is a file; {folder} has to be a folder.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(f"Cannot write into {there}: not allowed.")


def check_new_folder(folder: Path, ours: Callable[[Path], bool] | None = None) -> None:
    """Fail before any work is done, if `folder` cannot become a new one.

    Args:
        folder: One that is not there, or holds nothing.
        ours: Whether a folder that holds files is an earlier one, which may be replaced.

    Raises:
        OutputError: If it is a file, holds other files already, or cannot be made.
    """
    try:
        if folder.is_dir():
            if any(folder.iterdir()) and not (ours and ours(folder)):
                raise OutputError(
                    f"The folder {folder} holds files already; name a new one, or remove it first."
                    if ours is None
                    else f"The folder {folder} holds other files; name a new one, or one that an "
                    "earlier run wrote."
                )
        elif folder.exists():
            raise OutputError(f"{folder} is a file; name a folder.")
        folder = folder.resolve()
        folder.parent.mkdir(parents=True, exist_ok=True)
        os.rmdir(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"Cannot make {folder}: {error.strerror or error}.") from error


@contextmanager
def folder_whole(folder: Path, ours: Callable[[Path], bool] | None = None) -> Iterator[Path]:
    """A folder aside that takes the name of a new `folder` when all went well.

    When anything goes wrong nothing is left of it, and an earlier folder stays as it was.

    Args:
        folder: One that is not there, or holds nothing.
        ours: Whether a folder that holds files is an earlier one, which is replaced.

    Raises:
        OutputError: If `folder` holds other files already, or it cannot be written.
    """
    check_new_folder(folder, ours)
    folder = folder.resolve()
    try:
        aside = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        try:
            aside.chmod(0o755)
            yield aside
            check_new_folder(folder, ours)  # what came meanwhile is not replaced
            _take_place(aside, folder)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"Cannot write {folder}: {error.strerror or error}.") from error


def _take_place(aside: Path, folder: Path) -> None:
    """Rename `aside` to `folder`; one that stood there is kept until that is done."""
    if not folder.exists() or not any(folder.iterdir()):
        os.replace(aside, folder)
        return
    earlier = Path(tempfile.mkdtemp(prefix=f".{folder.name}-earlier-", dir=folder.parent))
    os.rename(folder, earlier)
    try:
        os.rename(aside, folder)
    except OSError:
        os.rename(earlier, folder)
        raise
    shutil.rmtree(earlier, ignore_errors=True)
