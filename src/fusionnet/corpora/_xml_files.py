"""XML from strangers: named files in a folder or zip, bounded, without entities or network.

What is read is only the elements' names and attributes. A document type, the one
door to entities, is refused.
"""

import lzma
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from xml.parsers import expat

from fusionnet.errors import DataError

LARGEST_FILE = 100_000_000
"""Bytes that one XML file may have."""

_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    ValueError,
    RuntimeError,  # encrypted, or packed in a way that is not implemented
)
"""What `zipfile` raises for an archive that it cannot unpack."""


class Element(NamedTuple):
    """The start of one element.

    Attributes:
        line: Line in its file, from 1.
        name: Its name.
        attributes: Its attributes by their names.
    """

    line: int
    name: str
    attributes: dict[str, str]


def read_named_files(source: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    """The contents of those of the named files that there are, in a folder or a zip.

    Files may lie in sub-folders; a folder with nothing but a zip in it will do.

    Raises:
        DataError: If the source is missing, no zip, or one of the files too large.
    """
    try:
        if source.is_dir():
            found = {p.name.lower(): p for p in sorted(source.rglob("*.xml")) if p.is_file()}
            zips = sorted(source.glob("*.zip"))
            if not found.keys() & set(names) and len(zips) == 1:
                return _from_zip(zips[0], names)
            return {name: _bounded(found[name]) for name in names if name in found}
        return _from_zip(source, names)
    except FileNotFoundError:
        raise DataError(f"There is no file or folder {source}.") from None
    except OSError as error:
        raise DataError(f"{source} cannot be read: {error.strerror or error}.") from None


def _bounded(path: Path) -> bytes:
    with path.open("rb") as file:
        content = file.read(LARGEST_FILE + 1)
    return _checked(path.name, content)


def _checked(name: str, content: bytes) -> bytes:
    if len(content) > LARGEST_FILE:
        raise DataError(f"{name} has more than {LARGEST_FILE} bytes.")
    return content


def _from_zip(path: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    found = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                name = PurePosixPath(entry.filename).name.lower()
                if name in names and "__MACOSX" not in entry.filename:
                    with archive.open(entry) as file:
                        found[name] = _checked(name, file.read(LARGEST_FILE + 1))
    except DataError:
        raise
    except _DAMAGED as error:
        raise DataError(f"{path} is not a zip that can be read: {error}.") from None
    return found


def elements(name: str, content: bytes) -> Iterator[Element]:
    """All elements of an XML file, in the order of their starts.

    Raises:
        DataError: If it is not well-formed, has a document type or an unknown encoding; the
            message names file, line and reason.
    """
    found: list[Element] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        found.append(Element(parser.CurrentLineNumber, tag, attributes))

    def document_type(*_: object) -> None:
        raise DataError(
            f"{name}, line {parser.CurrentLineNumber}: a document type (DOCTYPE) is not read, "
            "because it could bring in entities."
        )

    parser.StartElementHandler = start
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise DataError(f"{name}, line {error.lineno}: not well-formed XML: {reason}.") from None
    except DataError:
        raise
    except (LookupError, ValueError) as error:  # from the encoding that the file declares
        raise DataError(
            f"{name}, line {parser.CurrentLineNumber}: {error}; save the file as UTF-8."
        ) from None
    yield from found
