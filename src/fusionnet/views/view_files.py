"""Environmental views in a folder: pictures beside one `views.json`, whole or not at all."""

import io
import json
import re
from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fusionnet.errors import DataError, InputError
from fusionnet.files import check_new_folder, folder_whole
from fusionnet.views.picture_file import check_size, read_picture
from fusionnet.views.view import MOST_VIEWS, EnvironmentalView, check_view

VIEWS_FILE = "views.json"
KIND = "fusionnet views"
SCHEMA_VERSION = 2
READABLE_VERSIONS = (1, 2)
"""Views of version 1 say nothing of lamps."""

MOST_BYTES = 10 * 2**20

SHIPPED = {"rooms": Path(__file__).with_name("rooms15")}
"""Views that come with the package, by name."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_LONGEST = 90
"""Characters of a name that is made of a file's, which leaves room for a number and a suffix."""

_FIELDS = {"name", "environment", "part", "file", "matrix", "camera_from_board"}
_ALL_FIELDS = _FIELDS | {"light_directions"}


def save_views(
    folder: Path | str, views: tuple[EnvironmentalView, ...], quality: int | None = 95
) -> None:
    """Write views into a new folder, which is there whole or not at all.

    Args:
        folder: Where to; must not exist yet, or be empty.
        views: What to write; their names become the names of files.
        quality: Of JPEG pictures, 1 to 95; None writes PNG, which loses nothing.

    Raises:
        InputError: If there are no views or too many, two have one name, a name cannot be a
            file's, a picture is too small or too large to be read again, or a view shows only a
            part of the grid.
        OutputError: If the folder holds files already or cannot be written.
    """
    check_new_folder(Path(folder))
    with folder_whole(Path(folder)) as aside:
        write_views(aside, views, quality)


def write_views(
    folder: Path, views: tuple[EnvironmentalView, ...], quality: int | None = 95
) -> None:
    """Write views beside what else is in a folder; `save_views` is for those alone.

    Raises:
        InputError: As `save_views`.
    """
    if not 1 <= len(views) <= MOST_VIEWS:
        raise InputError(f"A folder holds 1 to {MOST_VIEWS} views; received {len(views)}.")
    _check_names([view.name for view in views])
    suffix = "png" if quality is None else "jpg"
    entries = []
    for view in views:
        check_view(view)
        height, width = view.image.shape[:2]
        check_size(f"The picture of the view {view.name!r}", width, height)
        file = f"{view.name}.{suffix}"
        (folder / file).write_bytes(_encoded(view.image, quality))
        entries.append(
            {
                "name": view.name,
                "environment": view.environment,
                "part": view.part,
                "file": file,
                "matrix": view.matrix.tolist(),
                "camera_from_board": view.camera_from_board.tolist(),
                "light_directions": view.light_directions.tolist(),
            }
        )
    document = {"kind": KIND, "schema_version": SCHEMA_VERSION, "views": entries}
    (folder / VIEWS_FILE).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def load_views(source: Path | str) -> tuple[EnvironmentalView, ...]:
    """The views in a folder, or those shipped under a name.

    Args:
        source: A folder that `save_views` wrote, or the name of a shipped one ("rooms").

    Raises:
        InputError: If there is no such folder or name.
        DataError: If the folder holds no views, or they are damaged or of another version.
    """
    folder = Path(source)
    if not folder.exists():
        if str(source) not in SHIPPED:
            raise InputError(
                f"There is no folder of views {source}; name one, or a shipped one: "
                f"{', '.join(SHIPPED)}. `fusionnet views rooms OUT` makes one."
            )
        folder = SHIPPED[str(source)]
    entries = _entries(folder / VIEWS_FILE)
    views = tuple(_view(folder, entry, index) for index, entry in enumerate(entries))
    try:
        _check_names([view.name for view in views])
    except InputError as error:
        raise DataError(f"{folder / VIEWS_FILE}: {error}") from None
    return views


def names_for(texts: Sequence[str]) -> list[str]:
    """Names that views can have, after any texts: each its own, and the text itself if it can be.

    Other characters than letters, digits, '.', '_' and '-' become '-', and what comes again is
    numbered: 'IMG', 'IMG-2', 'IMG-3'.
    """
    names: list[str] = []
    for text in texts:
        plain = re.sub(r"[^A-Za-z0-9._-]", "-", text).lstrip("._-")[:_LONGEST] or "view"
        numbered = (f"{plain}-{number}" for number in count(2))
        names.append(next(name for name in chain([plain], numbered) if name not in names))
    return names


def _check_names(names: list[str]) -> None:
    for name in names:
        if not _NAME.fullmatch(name):
            raise InputError(
                f"A view cannot be called {name!r}; use letters, digits, '-', '_' and '.'."
            )
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise InputError(f"Several views are called {double[0]!r}; each needs its own name.")


def _encoded(image: np.ndarray, quality: int | None) -> bytes:
    content = io.BytesIO()
    picture = Image.fromarray(image)
    if quality is None:
        picture.save(content, "PNG", compress_level=4)
    else:
        picture.save(content, "JPEG", quality=quality, optimize=True)
    return content.getvalue()


def _entries(file: Path) -> list[Any]:
    if not file.is_file():
        raise DataError(f"{file.parent} holds no views: it has no {VIEWS_FILE}.")
    if file.stat().st_size > MOST_BYTES:
        raise DataError(f"{file} has more than {MOST_BYTES // 2**20} MiB.")
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{file} is damaged, it is not JSON: {error}.") from error
    if not isinstance(document, dict) or document.get("kind") != KIND:
        raise DataError(f"{file} does not describe views (its kind is not {KIND!r}).")
    version = document.get("schema_version")
    if version not in READABLE_VERSIONS:
        raise DataError(
            f"{file} has schema version {version!r}; this release reads versions "
            f"{' and '.join(map(str, READABLE_VERSIONS))}. Make the views again."
        )
    entries = document.get("views")
    if not isinstance(entries, list) or not 1 <= len(entries) <= MOST_VIEWS:
        raise DataError(f"{file} needs a list 'views' of 1 to {MOST_VIEWS} views.")
    return entries


def _view(folder: Path, entry: Any, index: int) -> EnvironmentalView:
    where = f"{folder / VIEWS_FILE}, view {index + 1}"
    if not isinstance(entry, dict) or not _FIELDS <= set(entry) <= _ALL_FIELDS:
        raise DataError(f"{where}: expected an object with {', '.join(sorted(_ALL_FIELDS))}.")
    name, environment, part, file = (
        entry[field] for field in ("name", "environment", "part", "file")
    )
    if not all(isinstance(text, str) for text in (name, environment, file)):
        raise DataError(f"{where}: 'name', 'environment' and 'file' are texts.")
    if part not in ("train", "val"):
        raise DataError(f"{where}: 'part' is 'train' or 'val', not {part!r}.")
    if not _NAME.fullmatch(file):
        raise DataError(f"{where}: 'file' is the name of a picture beside it, not {file!r}.")
    try:
        view = EnvironmentalView(
            name=name,
            environment=environment,
            part=part,
            image=read_picture(folder / file),
            matrix=_matrix(entry["matrix"], (3, 3), where),
            camera_from_board=_matrix(entry["camera_from_board"], (4, 4), where),
            light_directions=_light_directions(entry.get("light_directions", []), where),
        )
        check_view(view)
    except InputError as error:
        raise DataError(f"{where}: {error}") from None
    return view


def _light_directions(value: Any, where: str) -> np.ndarray:
    count = len(value) if isinstance(value, list) else 1
    return np.zeros((0, 3)) if value == [] else _matrix(value, (count, 3), where)


def _matrix(value: Any, shape: tuple[int, int], where: str) -> np.ndarray:
    try:
        matrix = np.array(value, dtype=float)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != shape:
        raise DataError(
            f"{where}: expected {shape[0]} rows of {shape[1]} numbers, found {value!r:.60}."
        )
    return matrix
