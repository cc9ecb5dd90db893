"""Photographs of a checkerboard, one folder an environment."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fusionnet.errors import InputError
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.picture_file import read_turned

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp")
MOST_PHOTOGRAPHS = 2000
FEWEST_USABLE = 3


@dataclass(frozen=True, eq=False)
class Photograph:
    """One picture of the board.

    Attributes:
        file: Where it lies.
        environment: Name of its room set-up, whose focus it shares.
        corners: Of the board, in pixels; None if the picture cannot be used.
        reason: Why it cannot be used; empty if it can.
        orientation: EXIF's number, 1 to 8, of how it was turned to be upright; 1 is not at all.
    """

    file: Path
    environment: str
    corners: Float[np.ndarray, "n 2"] | None
    reason: str = ""
    orientation: int = 1

    @property
    def name(self) -> str:
        """Environment and file, as reports say them."""
        return f"{self.environment}/{self.file.name}"


@dataclass(frozen=True, eq=False)
class Environment:
    """All photographs with one focus.

    Attributes:
        name: Of the folder.
        size: Width and height of its pictures, in pixels.
        photographs: In the order of their names.
    """

    name: str
    size: tuple[int, int]
    photographs: tuple[Photograph, ...]

    @property
    def usable(self) -> list[Photograph]:
        """Those in which the whole board was found."""
        return [photograph for photograph in self.photographs if photograph.corners is not None]

    @property
    def orientation(self) -> int:
        """EXIF's number of how all usable photographs were turned, and so their lens."""
        return self.usable[0].orientation


def picture_files(folder: Path, enough: str = "60 show a lens well") -> list[Path]:
    """The pictures in a folder, by name.

    Args:
        folder: Where they lie.
        enough: Why fewer will do, said where there are more than `MOST_PHOTOGRAPHS`.

    Raises:
        InputError: If there is no such folder, or no or too many pictures in it.
    """
    try:
        if not folder.is_dir():
            raise InputError(f"There is no folder of photographs {folder}.")
        files = sorted(f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be read: {error.strerror}.") from error
    if not files:
        raise InputError(
            f"The folder {folder} holds no photographs; expected files {', '.join(SUFFIXES)}."
        )
    if len(files) > MOST_PHOTOGRAPHS:
        raise InputError(
            f"The folder {folder} holds {len(files)} photographs, more than {MOST_PHOTOGRAPHS}; "
            f"{enough}."
        )
    return files


def find_boards(
    folder: Path,
    board: Checkerboard,
    each: Callable[[list[Path]], Iterator[Path]] = iter,
    fewest: int = FEWEST_USABLE,
) -> Environment:
    """Look for the board in every picture of a folder.

    Args:
        folder: Of one environment; its name is the environment's.
        board: What to look for.
        each: Goes through the files; a progress bar may stand here.
        fewest: Photographs of the whole board that are needed.

    Raises:
        InputError: If pictures differ in size, or fewer than `fewest` show the whole board; the
            message names files and reasons.
    """
    name = folder.resolve().name
    photographs: list[Photograph] = []
    size: tuple[int, int] | None = None
    first = folder
    for file in each(picture_files(folder)):
        try:
            image, orientation = read_turned(file)
        except InputError as error:
            photographs.append(Photograph(file, name, None, str(error)))
            continue
        height, width = image.shape[:2]
        if size is None:
            size, first = (width, height), file
        elif size != (width, height):
            raise InputError(
                f"{file} has {width} x {height} pixels, {first.name} beside it {size[0]} x "
                f"{size[1]}; all photographs of one folder come from one camera at one "
                "resolution. Move it to a folder of its own."
            )
        corners = board.find(image)
        reason = "" if corners is not None else f"no whole board of {_inner(board)} inner corners"
        photographs.append(Photograph(file, name, corners, reason, orientation))
    photographs = _turned_alike(photographs)
    usable = sum(photograph.corners is not None for photograph in photographs)
    if size is None or usable < fewest:
        reasons = [f"{p.file.name}: {p.reason}" for p in photographs if p.reason]
        squares = f"{board.columns} x {board.rows} squares"
        why = f" ({'; '.join(reasons[:3])}). Is the board one of {squares}?" if reasons else "."
        raise InputError(
            f"Of {len(photographs)} photographs in {folder} {usable} can be used, at least "
            f"{fewest} {'is' if fewest == 1 else 'are'} needed{why}"
        )
    return Environment(name, size, tuple(photographs))


def _turned_alike(photographs: list[Photograph]) -> list[Photograph]:
    """The photographs, of which those turned otherwise than most cannot be used.

    In a picture that was turned the lens is turned, too: its middle lies elsewhere.
    """
    turns = Counter(p.orientation for p in photographs if p.corners is not None)
    most = max(turns, key=turns.__getitem__, default=1)
    return [
        photograph
        if photograph.corners is None or photograph.orientation == most
        else replace(photograph, corners=None, reason=_turned_otherwise(photograph, most))
        for photograph in photographs
    ]


def _turned_otherwise(photograph: Photograph, most: int) -> str:
    return (
        f"the camera was held otherwise (EXIF orientation {photograph.orientation}) than for most "
        f"of its folder ({most}); move it to a folder of its own"
    )


def _inner(board: Checkerboard) -> str:
    return "{} x {}".format(*board.inner)
