"""`fusionnet views ...`: from photographs of a checkerboard to views that blocks are drawn into."""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tyro
from PIL import Image

from fusionnet.apps.progress import Bar, bars
from fusionnet.errors import InputError
from fusionnet.files import check_file, check_new_folder, folder_whole, write_whole
from fusionnet.views.backdrops import Backdrops
from fusionnet.views.calibration import Calibration
from fusionnet.views.calibration import calibrate as calibrate_all
from fusionnet.views.calibration_report import as_json, write_report
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.drawn import drawn_views
from fusionnet.views.importing import (
    MOST_UNCERTAIN,
    ImportedViews,
    choose,
    import_views,
    set_aside,
)
from fusionnet.views.known_calibration import load_calibration
from fusionnet.views.mesh_sheet import mesh_sheet
from fusionnet.views.photographing import chosen_views, parted, photograph_rooms, room_errors
from fusionnet.views.photographs import FEWEST_USABLE, Environment, Photograph, find_boards
from fusionnet.views.rooms import BOARD
from fusionnet.views.view import EnvironmentalView
from fusionnet.views.view_files import load_views, save_views, write_views

Folders = tyro.conf.Positional[tuple[Path, ...]]


@dataclass(frozen=True, kw_only=True)
class CalibrateConfig:
    """Whose photographs, and of which board."""

    folders: Folders
    """One folder an environment: all its photographs share one focus."""
    out: Path = Path("calibration")
    """A new folder for calibration.json and calibration.html."""
    board: tuple[int, int] = (10, 7)
    """Squares (not corners) along the board's long and short side."""
    square: float = BOARD.square
    """Edge of a square, in metres."""


@dataclass(frozen=True, kw_only=True)
class ImportConfig:
    """Whose photographs, and what becomes of them."""

    folders: Folders
    """One folder an environment: all its photographs share one focus."""
    out: Path
    """A new folder for the views, as `dataset build --views` takes it."""
    calibration: Path | None = None
    """Folder of a calibration made before with the same camera and focus, by folders' names; the
    photographs then need not calibrate it, and one is enough."""
    board: tuple[int, int] = (10, 7)
    """Squares (not corners) along the board's long and short side."""
    square: float = BOARD.square
    """Edge of a square, in metres; in the views a square is as large as a block."""
    most: int = 15
    """Views to keep: those whose cameras stand farthest apart."""
    validation: int = 3
    """How many of them are for validation only."""
    uncertain: float = 1000 * MOST_UNCERTAIN
    """Standard deviation of a camera's place up to which its photograph becomes a view, in
    millimetres, if a square is as large as a block."""


@dataclass(frozen=True, kw_only=True)
class RoomsConfig:
    """How many photographs, and where to."""

    out: tyro.conf.Positional[Path]
    """A new folder for the fifteen views."""
    photographs: Path | None = None
    """Folder for the photographs, kept to go on with; OUT-photographs if left out."""
    images: int = 60
    """Photographs a room."""
    size: tuple[int, int] = (960, 540)
    """Their width and height, in pixels."""
    seed: int = 0
    """Of poses, distractors and sensor noise."""


@dataclass(frozen=True, kw_only=True)
class DrawConfig:
    """How many views, and where to."""

    out: tyro.conf.Positional[Path]
    """A new folder for the views."""
    count: int = 300
    """Views in all."""
    validation: int = 30
    """How many of them are for validation only."""
    size: tuple[int, int] = (960, 540)
    """Their width and height, in pixels."""
    photographs: Path | None = None
    """Folder of photographs without blocks, to be seen behind and among what is drawn."""
    seed: int = 0
    """Of cameras, tables, boards and clutter."""


@dataclass(frozen=True, kw_only=True)
class ShowConfig:
    """Which views, and where to."""

    views: tyro.conf.Positional[str]
    """Folder of views, or a shipped name."""
    out: Path = field(default=Path("views.png"))
    """The picture (PNG) that is written."""
    levels: int = 8
    """Levels of the grasping region that are drawn, 0 to 8."""


def calibrate(config: CalibrateConfig) -> dict[str, Any]:
    """Calibrate a camera: a fisheye lens an environment, then one pinhole camera over all.

    Prints errors and what was left out as JSON, and writes them with pictures of the corners.
    """
    check_new_folder(config.out)
    calibration = _calibrated(config.folders, Checkerboard(*config.board, config.square))
    with folder_whole(config.out) as aside:
        write_report(aside, calibration)
    return _summary(calibration, calibration.left_out)


def import_(config: ImportConfig) -> dict[str, Any]:
    """Make environmental views of a person's own photographs of a checkerboard.

    Prints what became of them as JSON.
    """
    check_new_folder(config.out)
    board = Checkerboard(*config.board, config.square)
    if config.calibration is None:
        calibration = _calibrated(config.folders, board)
    else:
        known = load_calibration(config.calibration)
        calibration = known.applied(_found(config.folders, board, fewest=1), board)
    imported = import_views(calibration, most_uncertain=config.uncertain / 1000)
    _check_some(imported)
    views = set_aside(choose(imported.views, config.most), config.validation)
    with folder_whole(config.out) as aside:
        write_views(aside, views)
        write_report(aside, calibration)
    found = {"views": len(views), "lamps_found": _lamps_found(views)}
    return {**found, **_summary(calibration, imported.left_out)}


def rooms(config: RoomsConfig) -> dict[str, Any]:
    """Render six rooms, calibrate their photographs, and make fifteen views of them.

    Prints how far the calibration is from the truth as JSON.
    """
    check_new_folder(config.out)
    out = config.out.resolve()
    photographs = config.photographs or out.with_name(f"{out.name}-photographs")
    with bars() as bar:
        folders = photograph_rooms(
            photographs, config.images, config.size, config.seed, progress=bar("photographs")
        )
    calibration = _calibrated(tuple(folders), BOARD)
    imported = import_views(calibration, only=chosen_views())
    _check_some(imported)
    errors = room_errors(calibration).as_json()
    with folder_whole(config.out) as aside:
        write_views(aside, parted(imported.views))
        write_report(aside, calibration)
    found = {"views": len(imported.views), "lamps_found": _lamps_found(imported.views)}
    return {**found, **errors, **_summary(calibration, imported.left_out)}


def draw(config: DrawConfig) -> dict[str, Any]:
    """Draw views instead of photographing them: any camera, table and board, among clutter.

    Prints how many there are as JSON.
    """
    check_new_folder(config.out)
    backdrops = None if config.photographs is None else Backdrops.of_folder(config.photographs)
    with bars() as bar:
        views = drawn_views(
            config.count,
            config.seed,
            config.size,
            config.validation,
            backdrops=backdrops,
            progress=bar("views"),
        )
    save_views(config.out, views)
    return {"views": len(views)}


def show(config: ShowConfig) -> None:
    """Draw views with the mesh of the grasping region (thesis figure 3.3)."""
    if not 0 <= config.levels <= 8:
        raise InputError(f"The region has 0 to 8 levels; received {config.levels}.")
    check_file(config.out)
    picture = io.BytesIO()
    Image.fromarray(mesh_sheet(load_views(config.views), config.levels)).save(picture, "PNG")
    write_whole(config.out, picture.getvalue())
    print(config.out)


def _check_some(imported: ImportedViews) -> None:
    if not imported.views:
        reason = imported.left_out[-1].reason if imported.left_out else "none was taken"
        raise InputError(f"No photograph can become a view ({reason})")


def _calibrated(folders: tuple[Path, ...], board: Checkerboard) -> Calibration:
    return calibrate_all(_found(folders, board), board)


def _found(
    folders: tuple[Path, ...], board: Checkerboard, fewest: int = FEWEST_USABLE
) -> list[Environment]:
    if not folders:
        raise InputError("Name at least one folder of photographs of a checkerboard.")
    with bars() as bar:
        return [
            find_boards(folder, board, _counted(bar(f"corners in {folder.name}")), fewest)
            for folder in folders
        ]


def _counted(bar: Bar) -> Callable[[list[Path]], Iterator[Path]]:
    def each(files: list[Path]) -> Iterator[Path]:
        for index, file in enumerate(files):
            bar(index, len(files))
            yield file
        bar(len(files), len(files))

    return each


def _lamps_found(views: tuple[EnvironmentalView, ...]) -> dict[str, int]:
    """How many lamps each environment's photographs tell of; without one the light is nominal."""
    return {view.environment: len(view.light_directions) for view in views}


def _summary(calibration: Calibration, left_out: tuple[Photograph, ...]) -> dict[str, Any]:
    found = as_json(calibration)
    return {
        "mean_reprojection_error_px": round(found["mean_reprojection_error"], 4),
        "matrix": found["matrix"],
        "environments": {
            name: {
                "photographs_used": len(lens["photographs"]),
                "focal_lengths": [lens["fisheye_matrix"][i][i] for i in (0, 1)],
                "coefficients": lens["fisheye_coefficients"],
            }
            for name, lens in found["environments"].items()
        },
        "left_out": {photograph.name: photograph.reason for photograph in left_out},
    }
