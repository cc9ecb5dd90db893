"""From photographs of a board to cameras: against OpenCV's own result, and against the truth."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from fusionnet.apps.cli import main
from fusionnet.blocks import Layout
from fusionnet.errors import InputError
from fusionnet.geometry import invert, vector_from_rotation
from fusionnet.geometry.fisheye import FisheyeLens
from fusionnet.randomness import generator
from fusionnet.simulation import SceneRenderer
from fusionnet.views import EnvironmentalView, load_views
from fusionnet.views.calibration import calibrate
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.importing import choose, import_views, set_aside
from fusionnet.views.lighting import estimate_light
from fusionnet.views.photographing import (
    EYE_POSITION,
    chosen_views,
    parted,
    photograph_names,
    photograph_rooms,
    room_errors,
)
from fusionnet.views.photographs import find_boards
from fusionnet.views.pose import (
    GridPlacement,
    estimate_pose,
    facing,
    grid_pose,
    place_deviation,
)
from fusionnet.views.rooms import (
    BOARD,
    PLACEMENT,
    ROOMS,
    RoomPhotographer,
    calibration_pose,
    lens_of,
    looking_at,
)
from view_commands import import_command

SIZE = (480, 270)
MIDDLE = np.array([0.105, 0.105, 0.0])


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A folder of fourteen small photographs of the first room."""
    folder = tmp_path_factory.mktemp("rooms")
    return photograph_rooms(folder, 14, SIZE, rooms=ROOMS[:1])[0]


@pytest.fixture(scope="module")
def calibration(room):
    return calibrate([find_boards(room, BOARD)], BOARD)


def test_a_lens_maps_rays_to_pixels_and_back():
    lens = lens_of(ROOMS[0], SIZE)
    pixels = np.array([[10.0, 20.0], [240.0, 135.0], [470.0, 260.0]])
    rays = np.column_stack([lens.slopes(pixels), np.ones(3)])
    np.testing.assert_allclose(lens.project(rays), pixels, atol=1e-3)


def test_a_straight_line_is_bent_by_the_lens_and_straight_again_undistorted():
    lens = FisheyeLens(320, 240, lens_of(ROOMS[0], (320, 240)).matrix, np.array([-0.1, 0, 0, 0.0]))
    line = np.column_stack([np.linspace(-0.6, 0.6, 50), np.full(50, 0.4), np.ones(50)])
    bent = lens.project(line)
    assert np.ptp(bent[:, 1]) > 3.0
    slopes = lens.slopes(bent)
    assert np.ptp(slopes[:, 1]) < 1e-4


def test_the_cameras_of_a_room_are_found(calibration):
    errors = room_errors(calibration).as_json()
    assert errors["focal_error_largest_percent"] < 0.5
    assert errors["position_error_mean_mm"] < 2.5  # half the resolution, 14 photographs
    assert errors["rotation_error_largest_degrees"] < 0.4
    assert calibration.mean_error < 0.15


def test_corners_have_one_order_however_the_camera_is_turned():
    photographer = RoomPhotographer(ROOMS[0], SIZE)
    lens, rng = lens_of(ROOMS[0], SIZE), generator(0, "turned")
    seen = 0
    for quarter in range(4):
        middle = np.array([0.105, 0.105, 0.0])
        pose = looking_at(middle, np.pi / 2 * quarter + 0.3, 1.0, 0.4, 0.0)
        corners = BOARD.find(photographer.take(pose, rng))
        if corners is None:
            continue
        in_camera = pose @ invert(PLACEMENT.pattern_from_board(BOARD))
        true = lens.project(BOARD.points @ in_camera[:3, :3].T + in_camera[:3, 3])
        assert np.abs(corners - true).max() < 0.6
        seen += 1
    photographer.close()
    assert seen >= 3


def test_a_pose_is_found_in_spite_of_corners_that_are_wrong():
    camera = np.array([[500.0, 0, 320.0], [0, 500.0, 240.0], [0, 0, 1.0]])
    pose = calibration_pose(generator(3, "pose"))
    true = pose @ invert(PLACEMENT.pattern_from_board(BOARD))
    points = BOARD.points @ true[:3, :3].T + true[:3, 3]
    pixels = (points @ camera.T)[:, :2] / points[:, 2:]
    pixels[[3, 17, 30]] += 40.0
    found = estimate_pose(pixels, BOARD, camera)
    np.testing.assert_allclose(found, true, atol=1e-4)
    with pytest.raises(InputError, match="No pose of the board"):
        estimate_pose(generator(0, "noise").uniform(0, 500, pixels.shape), BOARD, camera)


@pytest.mark.parametrize("turns", range(4))
def test_a_grid_keeps_its_cells_on_the_squares_however_it_is_turned(turns):
    placement = GridPlacement(quarter_turns=turns)
    pattern_from_board = placement.pattern_from_board(BOARD)
    corner = pattern_from_board[:3, 3] / BOARD.square
    np.testing.assert_allclose(corner, np.rint(corner), atol=1e-9)
    assert np.linalg.det(pattern_from_board[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(pattern_from_board[2, 2], -1.0)


def test_cells_are_named_as_seen_from_the_camera():
    for azimuth in np.linspace(-3.0, 3.0, 13):
        pose = looking_at(np.array([0.105, 0.105, 0.0]), azimuth, 0.7, 0.6, 0.0)
        half = np.array([0.1052, 0.1052, 0.0])
        turn = GridPlacement(quarter_turns=facing(pose)).pattern_from_board(BOARD)
        nominal = GridPlacement().pattern_from_board(BOARD)
        turned = pose @ invert(nominal) @ turn
        position = invert(turned)[:3, 3] - half
        assert position[0] < 0.0 and abs(position[1]) <= abs(position[0]) + 0.02


def test_views_are_made_of_a_room_and_three_are_kept_for_validation(room, calibration):
    imported = import_views(calibration, only=chosen_views(), most_uncertain=0.005)
    assert [view.name for view in parted(imported.views) if view.part == "val"] == [
        "round-white-bright-robot"
    ]
    assert len(imported.views) == 3
    every = import_views(calibration, most_uncertain=0.005)
    assert len(every.views) + len(every.left_out) == 14
    few = choose(every.views, 3)
    assert len(few) == 3 and [v.part for v in set_aside(few, 1)].count("val") == 1
    with pytest.raises(InputError, match="at least one must be"):
        set_aside(few, 3)


def test_a_board_that_was_found_wrongly_does_not_bend_the_lens(room, calibration):
    environment = find_boards(room, BOARD)
    found = environment.usable[3]
    noise = generator(0, "wrong board").normal(0.0, 6.0, found.corners.shape)
    wrong = replace(found, corners=found.corners + noise)
    others = tuple(p for p in environment.photographs if p is not found)
    again = calibrate([replace(environment, photographs=(*others, wrong))], BOARD)
    assert [p.name for p in again.left_out if "wrongly found" in p.reason] == [found.name]
    (lens,), (clean,) = (
        [e.lens.matrix[0, 0] for e in each.environments] for each in (again, calibration)
    )
    assert lens == pytest.approx(clean, rel=0.01)


def test_photographs_that_hardly_tell_where_the_camera_stands_become_no_views(calibration):
    """The room's are small, so that their corners are inexact."""
    imported = import_views(calibration)
    unsure = [p for p in imported.left_out if "tell where the camera stands" in p.reason]
    assert len(unsure) >= 2 and len(imported.views) + len(imported.left_out) == 14


def test_the_deviation_of_a_place_is_that_of_many_noisy_sightings():
    matrix = np.array([[600.0, 0, 479.5], [0, 600.0, 269.5], [0, 0, 1]])
    pose = looking_at(np.array([0.105, 0.105, 0.0]), 2.0, 0.7, 0.6, 0.0)
    turn = cv2.Rodrigues(pose[:3, :3])[0]
    exact = cv2.projectPoints(BOARD.points, turn, pose[:3, 3], matrix, None)[0].reshape(-1, 2)
    rng, places, told = generator(0, "sightings"), [], []
    for _ in range(200):
        seen = exact + rng.normal(0.0, 0.2, exact.shape)
        found = estimate_pose(seen, BOARD, matrix)
        places.append(invert(found)[:3, 3])
        told.append(place_deviation(seen, BOARD, matrix, found))
    spread = np.sqrt(np.var(places, axis=0).sum())
    assert np.mean(told) == pytest.approx(spread, rel=0.15)


def test_the_pose_in_an_undistorted_picture_is_that_of_its_corners(calibration):
    view = import_views(calibration, most_uncertain=0.005).views[0]
    corners = BOARD.find(view.image)
    again = grid_pose(corners, BOARD, calibration.matrix)
    turned = grid_pose(
        corners, BOARD, calibration.matrix, GridPlacement(quarter_turns=facing(again))
    )
    apart = turned[:3, :3] @ view.camera_from_board[:3, :3].T
    assert np.degrees(np.linalg.norm(vector_from_rotation(apart))) < 0.3


def test_a_lamp_near_by_is_found_on_its_side():
    side = 2.0
    out = np.array([0.7 * np.cos(side), 0.7 * np.sin(side), 0.714])
    room = replace(ROOMS[1], lamp=tuple(out), lamp_distance=0.5)
    photographer, pose = RoomPhotographer(room, SIZE), looking_at(MIDDLE, 0.4, 0.8, 0.6, 0.0)
    lens = photographer.lens
    picture = photographer.take(pose, generator(0, "lamp"))
    photographer.close()
    view = EnvironmentalView(
        name="lamp",
        environment="lamp",
        part="train",
        image=lens.undistort(picture, lens.matrix),
        matrix=lens.matrix,
        camera_from_board=pose,
    )
    found = estimate_light(view).light_direction
    turn = np.arctan2(-found[1], -found[0]) - side
    assert abs(np.degrees((turn + np.pi) % (2 * np.pi) - np.pi)) < 10.0


def test_photographs_are_the_same_again_and_kept_when_there(room, tmp_path):
    again = photograph_rooms(tmp_path, 14, SIZE, rooms=ROOMS[:1])[0]
    for name in photograph_names(ROOMS[0], 14)[:4]:
        assert (room / f"{name}.jpg").read_bytes() == (again / f"{name}.jpg").read_bytes()
    marked = again / "000.jpg"
    marked.write_bytes(b"kept")
    photograph_rooms(tmp_path, 14, SIZE, rooms=ROOMS[:1])
    assert marked.read_bytes() == b"kept"
    with pytest.raises(InputError, match="other settings"):
        photograph_rooms(tmp_path, 14, SIZE, seed=1, rooms=ROOMS[:1])


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((0, 0), "is too small, 0 x 0"),
        ((9000, 9000), "is too large"),
        ((960, 200), "does not fit into photographs of 960 x 200"),
    ],
)
def test_rooms_are_not_photographed_at_a_size_that_shows_no_grid(tmp_path, size, message):
    with pytest.raises(InputError, match=message):
        photograph_rooms(tmp_path, 10, size)
    assert list(tmp_path.iterdir()) == []


def test_the_robots_eye_is_where_the_rooms_say():
    renderer = SceneRenderer()
    camera = renderer.view(Layout(()), "left_eye", labels=False).camera
    board_from_robot = invert(renderer.robot.robot_from_board)
    place = board_from_robot[:3, :3] @ camera.position + board_from_robot[:3, 3]
    renderer.close()
    np.testing.assert_allclose(place, EYE_POSITION, atol=0.02)


def test_real_photographs_calibrate_as_well_as_by_opencv_itself(data_folder):
    board = Checkerboard(10, 7, 0.025)
    environment = find_boards(data_folder / "checkerboard", board)
    assert len(environment.usable) == 13
    calibration = calibrate([environment], board)
    assert calibration.mean_error <= 0.45
    seen = [p.corners.astype(np.float32)[:, None] for p in environment.usable]
    points = [board.points.astype(np.float32)] * len(seen)
    _, matrix, *_ = cv2.calibrateCamera(points, seen, environment.size, None, None)
    published = 535.9
    for focal in (calibration.matrix[0, 0], calibration.matrix[1, 1]):
        assert focal == pytest.approx(matrix[0, 0], rel=0.01)
        assert focal == pytest.approx(published, rel=0.01)


def test_calibrate_import_and_show_from_the_command_line(room, tmp_path, capsys):
    folder = tmp_path / "mine"
    shutil.copytree(room, folder)
    (folder / "broken.jpg").write_bytes(b"\xff\xd8 not a jpeg")
    cv2.imwrite(str(folder / "wall.png"), np.full((SIZE[1], SIZE[0], 3), 128, np.uint8))
    assert main(["views", "calibrate", str(folder), "--out", str(tmp_path / "calibration")]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert "no whole board" in printed["left_out"]["mine/wall.png"]
    assert "mine/broken.jpg" in printed["left_out"]
    assert (tmp_path / "calibration" / "calibration.html").stat().st_size > 10_000
    found = json.loads((tmp_path / "calibration" / "calibration.json").read_text())
    assert (
        len(found["environments"]["mine"]["photographs"])
        == printed["environments"]["mine"]["photographs_used"]
    )
    out = tmp_path / "views"
    arguments = import_command(folder, out, "--most", "3")
    assert main([*arguments, "--validation", "1"]) == 0
    assert [view.part for view in load_views(out)].count("val") == 1
    assert main(["views", "show", str(out), "--out", str(tmp_path / "mesh.png")]) == 0
    assert cv2.imread(str(tmp_path / "mesh.png")).shape[1] == 1440


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("missing", "There is no folder of photographs"),
        ("empty", "holds no photographs"),
        ("another size", "has 100 x 100 pixels"),
        ("two", "2 can be used, at least 3 are needed"),
        ("no board", "0 can be used"),
        ("another board", "0 can be used, at least 3"),
    ],
)
def test_photographs_that_cannot_be_used_are_named(wrong, message, room, tmp_path, capsys):
    folder = tmp_path / "photographs"
    board = ["--board", "10", "7"]
    if wrong != "missing":
        folder.mkdir()
    if wrong in ("another size", "another board"):
        for name in ("view-1.jpg", "view-2.jpg", "robot.jpg"):
            shutil.copy(room / name, folder)
    if wrong == "another size":
        cv2.imwrite(str(folder / "z.png"), np.zeros((100, 100, 3), np.uint8))
    if wrong == "two":
        for name in ("view-1.jpg", "view-2.jpg"):
            shutil.copy(room / name, folder)
    if wrong == "no board":
        for index in range(4):
            cv2.imwrite(str(folder / f"{index}.png"), np.full((120, 160, 3), 90, np.uint8))
    if wrong == "another board":
        board = ["--board", "12", "9"]
    out = tmp_path / "out"
    assert main(["views", "calibrate", str(folder), *board, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not out.exists()


def test_views_of_one_name_twice_or_of_two_sizes_are_refused(room, tmp_path):
    environment = find_boards(room, BOARD)
    with pytest.raises(InputError, match="Several folders are called"):
        calibrate([environment, environment], BOARD)
    small = tmp_path / "small"
    small.mkdir()
    for name in ("view-1", "view-2", "robot"):
        picture = cv2.imread(str(room / f"{name}.jpg"))
        cv2.imwrite(str(small / f"{name}.png"), cv2.resize(picture, (432, 243)))
    with pytest.raises(InputError, match="432 x 243"):
        calibrate([environment, find_boards(small, BOARD)], BOARD)


@pytest.mark.slow
def test_six_rooms_calibrate_within_a_millimetre_on_average(tmp_path):
    folders = photograph_rooms(tmp_path, 60)
    calibration = calibrate([find_boards(folder, BOARD) for folder in folders], BOARD)
    errors = room_errors(calibration).as_json()
    assert errors["focal_error_largest_percent"] < 0.5
    assert errors["position_error_mean_mm"] < 1.0
    assert errors["rotation_error_largest_degrees"] < 0.2
    assert len(import_views(calibration, only=chosen_views()).views) == 15
