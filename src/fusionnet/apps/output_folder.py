"""An output folder that is there whole or not at all."""

import json
from contextlib import AbstractContextManager
from pathlib import Path

from fusionnet.files import check_new_folder, folder_whole

RESULT_FILE = "result.json"
"""Every output folder holds one; that is how a folder of ours is known."""

RESULT_KIND = "fusionnet run"


def check_writable(out: Path) -> None:
    """Fail before any work is done, if `out` cannot become our folder.

    Raises:
        OutputError: If it is a file, holds other people's files, or cannot be made.
    """
    check_new_folder(out, _is_ours)


def written_whole(out: Path) -> AbstractContextManager[Path]:
    """A temporary folder beside `out` that takes its name when all went well.

    An earlier run's folder there is replaced; when anything goes wrong it stays as it was,
    and what had been written vanishes.

    Raises:
        OutputError: If the disk is full or the folder cannot be written.
    """
    return folder_whole(out, _is_ours)


def _is_ours(folder: Path) -> bool:
    """Whether an earlier run wrote this folder, and nothing but its files is in it."""
    try:
        document = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
        files = {*document["files"], RESULT_FILE}
        return document["kind"] == RESULT_KIND and {f.name for f in folder.iterdir()} <= files
    except (OSError, ValueError, TypeError, KeyError):
        return False
