"""Files that are whole or not there: written aside, then renamed."""

import os
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
