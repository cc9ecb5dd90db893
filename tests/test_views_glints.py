"""Lamps found by the glints on a board: against the truth of rooms, and where there are none."""

from dataclasses import replace

import numpy as np
import pytest

from fusionnet.geometry import apply, invert
from fusionnet.randomness import generator
from fusionnet.views import EnvironmentalView
from fusionnet.views.calibration import calibrate
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.furniture import WINDOW_DIRECTION
from fusionnet.views.glints import FEWEST, Glints, glints_in, lamp_rays
from fusionnet.views.importing import lamp_rays_in, view_of
from fusionnet.views.lighting import PAPER, estimate_light
from fusionnet.views.photographing import photograph_pose, photograph_rooms
from fusionnet.views.photographs import find_boards
from fusionnet.views.rooms import (
    BOARD,
    PLACEMENT,
    ROOMS,
    Room,
    RoomPhotographer,
    calibration_pose,
    looking_at,
)

SIZE = (480, 270)
PATTERN_FROM_BOARD = PLACEMENT.pattern_from_board(BOARD)
MIXED = ROOMS[2]


def degrees(first: np.ndarray, second: np.ndarray) -> float:
    cosine = first @ second / (np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def seen(room: Room, count: int = 40, exposures: float = 0.0) -> list[Glints]:
    """Glints in photographs from known poses, each exposed by its own factor."""
    photographer, rng, found = RoomPhotographer(room, SIZE), generator(0, "glints"), []
    while len(found) < count:
        pose = calibration_pose(rng) @ invert(PATTERN_FROM_BOARD)
        corners = photographer.lens.project(apply(pose, BOARD.points))
        if corners.min() < 0 or (corners > np.array(SIZE) - 1).any():
            continue
        image = photographer.take(pose @ PATTERN_FROM_BOARD, rng)
        image = (image * (1.0 - exposures * rng.random())).astype(np.uint8)
        glints = glints_in(image, corners, BOARD, pose)
        if glints is not None:
            found.append(glints)
    photographer.close()
    return found


@pytest.fixture(scope="module")
def mixed() -> list[Glints]:
    """Of a room with two lamps, in photographs whose exposure varies by half."""
    return seen(MIXED, exposures=0.5)


def test_both_lamps_of_a_room_are_found_whatever_the_exposure(mixed):
    rays = lamp_rays(mixed) @ PATTERN_FROM_BOARD[:3, :3]
    assert len(rays) == 2
    assert degrees(rays[0], MIXED.light_direction) < 5.0
    assert degrees(rays[1], WINDOW_DIRECTION) < 8.0


def test_a_lamp_half_a_metre_away_is_found_too():
    out = (0.5, -0.4, 0.75)
    rays = lamp_rays(seen(replace(ROOMS[1], lamp=out, lamp_distance=0.5), 30))
    assert degrees(rays[0] @ PATTERN_FROM_BOARD[:3, :3], -np.array(out)) < 10.0


def test_a_matt_room_tells_nothing():
    assert lamp_rays(seen(replace(MIXED, gloss=0.0), 20)).shape == (0, 3)


def test_a_board_that_moves_or_is_seen_too_seldom_tells_nothing(mixed):
    assert lamp_rays(mixed[: FEWEST - 1]).shape == (0, 3)
    order = generator(0, "moved").permutation(len(mixed))
    moved = [
        replace(each, brightness=mixed[other].brightness)
        for each, other in zip(mixed, order, strict=True)
    ]
    assert lamp_rays(moved).shape == (0, 3)


def test_an_overexposed_photograph_is_left_out():
    white = np.full((*SIZE[::-1], 3), 255, np.uint8)
    pose = looking_at(np.array([0.1, 0.1, 0.0]), 0.3, 0.9, 0.5, 0.0) @ invert(PATTERN_FROM_BOARD)
    corners = np.full((54, 2), 100.0)
    assert glints_in(white, corners, BOARD, pose) is None


def test_real_photographs_of_a_board_that_is_moved_tell_nothing(data_folder):
    board = Checkerboard(10, 7, 0.025)
    calibration = calibrate([find_boards(data_folder / "checkerboard", board)], board)
    assert lamp_rays_in(calibration, calibration.environments[0]).shape == (0, 3)


def test_views_know_the_lamps_of_their_environment_and_are_lit_by_them(tmp_path):
    folders = photograph_rooms(tmp_path, 32, SIZE, rooms=[MIXED])
    calibration = calibrate([find_boards(folders[0], BOARD)], BOARD)
    environment = calibration.environments[0]
    rays = lamp_rays_in(calibration, environment)
    assert degrees(rays[0] @ PATTERN_FROM_BOARD[:3, :3], MIXED.light_direction) < 5.0
    sides = set()
    for photograph in environment.used:
        view = view_of(calibration, environment, photograph, rays)
        # The camera sees one light, however its view's grid is turned.
        in_camera = view.light_directions @ view.camera_from_board[:3, :3].T
        pose = photograph_pose(MIXED, photograph.file.stem, SIZE, 0)
        assert degrees(in_camera[0], pose[:3, :3] @ MIXED.light_direction) < 6.0
        sides.add(tuple(np.sign(view.light_directions[0, :2])))
        light = estimate_light(view)
        np.testing.assert_array_equal(light.light_direction, view.light_directions[0])
    assert len(sides) > 2


@pytest.mark.parametrize("count", [1, 2])
def test_paper_is_as_bright_under_lamps_that_are_known(count):
    image = np.full((*SIZE[::-1], 3), 150, np.uint8)
    pose = looking_at(np.array([0.105, 0.105, 0.0]), 0.3, 0.9, 0.5, 0.0)
    view = EnvironmentalView(
        name="known",
        environment="known",
        part="train",
        image=image,
        matrix=np.array([[300.0, 0, 239.5], [0, 300.0, 134.5], [0, 0, 1]]),
        camera_from_board=pose,
        light_directions=np.array([[0.6, 0.0, -0.8], [0.0, -0.8, -0.6]])[:count],
    )
    light = estimate_light(view)
    np.testing.assert_array_equal(light.light_direction, [0.6, 0.0, -0.8])
    rays = [(light.light_direction, light.light), (light.fill_direction, light.fill)]
    on_table = light.ambient + sum(-d[2] / np.linalg.norm(d) * s for d, s in rays)
    np.testing.assert_allclose(PAPER * on_table, 150 / 255)
    if count == 2:
        np.testing.assert_array_equal(light.fill_direction, [0.0, -0.8, -0.6])
