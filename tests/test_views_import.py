"""Views of photographs by a calibration made before, and what is said of bad photographs."""

import json
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from fusionnet.apps.cli import main
from fusionnet.errors import InputError, OutputError
from fusionnet.geometry import transform
from fusionnet.views import EnvironmentalView, load_views
from fusionnet.views.checkerboard import SEARCHED
from fusionnet.views.importing import choose
from fusionnet.views.photographing import photograph_rooms
from fusionnet.views.photographs import find_boards
from fusionnet.views.rooms import BOARD, ROOMS
from view_commands import import_command

SIZE = (480, 270)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A folder of twelve small photographs of the first room."""
    return photograph_rooms(tmp_path_factory.mktemp("rooms"), 12, SIZE, rooms=ROOMS[:1])[0]


@pytest.fixture(scope="module")
def calibrated(room, tmp_path_factory):
    """What `views import` made of that room."""
    out = tmp_path_factory.mktemp("calibrated") / "views"
    assert main(import_command(room, out, "--validation", "0")) == 0
    return out


def refused(arguments: list[str], capsys) -> str:
    """The one line that is said about bad input."""
    capsys.readouterr()
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "Traceback" not in error
    return error


def test_one_photograph_is_enough_with_a_calibration(room, calibrated, tmp_path, capsys):
    folder = tmp_path / "later"
    folder.mkdir()
    shutil.copy(room / "view-1.jpg", folder)
    out = tmp_path / "views"
    arguments = import_command(folder, out, "--validation", "0")
    assert "at least 3 are needed" in refused(arguments, capsys)
    assert main([*arguments, "--calibration", str(calibrated)]) == 0
    (view,) = load_views(out)
    known = next(v for v in load_views(calibrated) if v.name == "round-white-bright-view-1")
    assert view.part == "train" and view.environment == "later"
    np.testing.assert_allclose(view.matrix, known.matrix)
    np.testing.assert_allclose(view.camera_from_board, known.camera_from_board, atol=1e-6)
    first, again = (
        json.loads((place / "calibration.json").read_text()) for place in (calibrated, out)
    )
    errors = {
        photograph["file"]: photograph["pinhole_error"]
        for photograph in first["environments"][room.name]["photographs"]
    }
    found = again["environments"]["later"]["photographs"][0]
    assert found["pinhole_error"] == pytest.approx(errors["view-1.jpg"], abs=0.05)


@pytest.mark.parametrize("wrong", ["none", "damaged", "version", "fields", "size", "unnamed"])
def test_a_calibration_that_does_not_fit_is_refused(wrong, room, calibrated, tmp_path, capsys):
    folder, known = tmp_path / "later", tmp_path / "calibration.json"
    folder.mkdir()
    shutil.copy(room / "view-1.jpg", folder)
    document = json.loads((calibrated / "calibration.json").read_text())
    if wrong == "version":
        document["schema_version"] = 1
    if wrong == "fields":
        document["undistorted_to"] = [[1.0]]
    if wrong == "size":
        document["size"] = [640, 360]
    if wrong == "unnamed":
        lens = document["environments"].pop(room.name)
        document["environments"] = {"kitchen": lens, "office": lens}
    known.write_text("{" if wrong == "damaged" else json.dumps(document))
    source = tmp_path / "nothing" if wrong == "none" else known
    out = tmp_path / "views"
    message = {
        "none": "There is no calibration",
        "damaged": "is damaged, it is not JSON",
        "version": "has schema version 1",
        "fields": "expected 3 x 3 numbers",
        "size": "those of the calibration",
        "unnamed": "its own are kitchen, office",
    }[wrong]
    arguments = import_command(folder, out, "--calibration", str(source))
    assert message in refused([*arguments, "--validation", "0"], capsys)
    assert not out.exists()


def test_any_folder_and_file_may_be_called_as_it_is(room, calibrated, tmp_path):
    folder = tmp_path / "Büro, links"
    folder.mkdir()
    for name in ("IMG 1.jpg", "IMG 1.jpeg"):
        shutil.copy(room / "view-1.jpg", folder / name)
    out = tmp_path / "views"
    arguments = import_command(folder, out, "--validation", "0")
    assert main([*arguments, "--calibration", str(calibrated)]) == 0
    assert [view.name for view in load_views(out)] == ["B-ro--links-IMG-1", "B-ro--links-IMG-1-2"]


def test_photographs_without_the_whole_grid_become_no_views(room, calibrated, tmp_path, capsys):
    views = {view.name.removeprefix("round-white-bright-") for view in load_views(calibrated)}
    document = json.loads((calibrated / "calibration.json").read_text())
    seen = document["environments"]["round-white-bright"]["photographs"]
    near = [p["file"] for p in seen if p["file"].removesuffix(".jpg") not in views]
    folder = tmp_path / "near"
    folder.mkdir()
    shutil.copy(room / near[0], folder)
    out = tmp_path / "views"
    arguments = import_command(folder, out)
    error = refused([*arguments, "--validation", "0", "--calibration", str(calibrated)], capsys)
    assert "leaves the picture" in error and not out.exists()


def upside_down(photograph: Path, out: Path) -> None:
    """The photograph as a camera held upside down stores it: EXIF says how to turn it."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 3
    with Image.open(photograph) as picture:
        turned = picture.transpose(Image.Transpose.ROTATE_180)
    turned.save(out, exif=exif, quality=95)


def test_photographs_whose_camera_was_held_otherwise_are_left_out(room, tmp_path):
    for name in ("view-2.jpg", "robot.jpg", "001.jpg"):
        shutil.copy(room / name, tmp_path)
    upside_down(room / "view-1.jpg", tmp_path / "0-turned.jpg")
    environment = find_boards(tmp_path, BOARD, fewest=1)
    turned = environment.photographs[0]
    assert turned.corners is None and "held otherwise (EXIF orientation 3)" in turned.reason
    assert len(environment.usable) >= 2 and environment.orientation == 1


def test_a_calibration_is_of_one_way_to_hold_the_camera(room, calibrated, tmp_path, capsys):
    folder, out = tmp_path / "later", tmp_path / "views"
    folder.mkdir()
    upside_down(room / "view-1.jpg", folder / "turned.jpg")
    arguments = import_command(folder, out, "--calibration", str(calibrated), "--validation", "0")
    assert "held otherwise for the photographs of later" in refused(arguments, capsys)
    known = json.loads((calibrated / "calibration.json").read_text())
    del known["environments"][room.name]["orientation"]
    (tmp_path / "older.json").write_text(json.dumps(known))
    arguments[arguments.index(str(calibrated))] = str(tmp_path / "older.json")
    assert main(arguments) == 0


def test_two_folders_of_one_name_are_not_merged(room, calibrated, tmp_path, capsys):
    folders = [tmp_path / place / "table" for place in ("one", "two")]
    for folder in folders:
        folder.mkdir(parents=True)
        shutil.copy(room / "view-1.jpg", folder)
    arguments = import_command(folders[0], tmp_path / "views", "--validation", "0")
    arguments.insert(3, str(folders[1]))
    error = refused([*arguments, "--calibration", str(calibrated)], capsys)
    assert "Several folders are called 'table'" in error


def test_views_are_chosen_of_environments_in_turn_as_far_as_they_go():
    """One environment has a single view; of the two others the first one's stand far apart."""
    places = {"alone": [0.0], "far": [10.0, 20.0, 30.0, 40.0], "near": [1.0, 1.1, 1.2, 1.3]}
    views = tuple(
        EnvironmentalView(
            name=f"{environment}-{number}",
            environment=environment,
            part="train",
            image=np.zeros((64, 64, 3), np.uint8),
            matrix=np.eye(3),
            camera_from_board=transform(translation=(place, 0.0, 0.0)),
        )
        for environment, seen in places.items()
        for number, place in enumerate(seen)
    )
    chosen = [view.environment for view in choose(views, 7)]
    assert sorted(chosen) == ["alone", *["far"] * 3, *["near"] * 3]
    for count in (0, -3):
        with pytest.raises(InputError, match="At least one view has to be kept"):
            choose(views, count)


def test_a_photograph_cut_short_is_listed_and_the_others_are_used(room, tmp_path, capsys):
    folder = tmp_path / "mine"
    shutil.copytree(room, folder)
    whole = (room / "000.jpg").read_bytes()
    (folder / "000.jpg").write_bytes(whole[: len(whole) // 2])
    capsys.readouterr()
    out = tmp_path / "calibration"
    assert main(["views", "calibrate", str(folder), "--out", str(out)]) == 0
    left_out = json.loads(capsys.readouterr().out)["left_out"]
    assert "is damaged" in left_out["mine/000.jpg"]


def test_an_unreadable_folder_is_named(room, tmp_path, capsys, monkeypatch):
    def forbidden(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "iterdir", forbidden)
    out = str(tmp_path / "out" / "calibration")
    error = refused(["views", "calibrate", str(room), "--out", out], capsys)
    assert "cannot be read: Permission denied" in error


def test_a_full_disk_keeps_the_photographs_that_were_finished(room, tmp_path, monkeypatch):
    replace, written = os.replace, []

    def full(source, target):
        if len(written) == 4:
            raise OSError(28, "No space left on device")
        written.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OutputError, match="No space left on device"):
        photograph_rooms(tmp_path, 12, SIZE, rooms=ROOMS[:1])
    monkeypatch.undo()
    place = tmp_path / room.name
    assert sorted(file.name for file in place.iterdir()) == sorted(written)
    photograph_rooms(tmp_path, 12, SIZE, rooms=ROOMS[:1])
    for file in room.iterdir():
        assert (place / file.name).read_bytes() == file.read_bytes()


def test_corners_of_a_large_photograph_are_those_of_the_small_one(room):
    small = cv2.cvtColor(cv2.imread(str(room / "view-1.jpg")), cv2.COLOR_BGR2RGB)
    factor = 5
    large = cv2.resize(small, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    assert large.shape[1] > SEARCHED
    corners = (BOARD.find(large) + 0.5) / factor - 0.5
    assert np.abs(corners - BOARD.find(small)).max() < 0.5
