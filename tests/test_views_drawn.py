"""Views that are drawn: different, exact, and the same from the same seed."""

import cv2
import numpy as np
import pytest

from fusionnet.blocks import BLOCK_SIZE, GRID
from fusionnet.errors import InputError
from fusionnet.randomness import generator
from fusionnet.views import drawn as module
from fusionnet.views import drawn_view, drawn_views, load_views, save_views
from fusionnet.views.view import check_view

SIZE = (320, 240)


def test_views_depend_on_the_seed_and_their_number_alone():
    few, more = drawn_views(2, seed=5, size=SIZE), drawn_views(4, seed=5, size=SIZE, validation=1)
    for one, same in zip(few, more, strict=False):
        np.testing.assert_array_equal(one.image, same.image)
        np.testing.assert_array_equal(one.camera_from_board, same.camera_from_board)
    assert [view.part for view in more] == ["train", "train", "train", "val"]
    assert len({view.image.tobytes() for view in more}) == 4


def test_the_whole_grid_is_in_every_view_and_cameras_stand_everywhere():
    views = [drawn_view(generator(seed, "test"), SIZE) for seed in range(60)]
    for view in views:
        check_view(view)
    centers = np.array([-v.camera_from_board[:3, :3].T @ v.camera_from_board[:3, 3] for v in views])
    middle = np.array([GRID / 2, GRID / 2, 0]) * BLOCK_SIZE
    sides = (centers - middle) / np.linalg.norm(centers - middle, axis=1, keepdims=True)
    assert (sides[:, 2] > 0).all()
    assert sides[:, 2].min() < 0.5 and sides[:, 2].max() > 0.9
    assert (np.histogram2d(sides[:, 0] > 0, sides[:, 1] > 0, bins=2)[0] >= 5).all()


@pytest.mark.parametrize("size", [(32, 640), (640, 32), (32, 32)])
def test_pictures_of_any_shape_show_the_whole_grid(size):
    check_view(drawn_view(generator(0, "shape"), size))


def test_the_board_lies_where_the_pose_says(monkeypatch):
    """Corners of squares under the grid's cells are found where they are projected."""
    monkeypatch.setattr(module, "_clutter", lambda *_: None)
    monkeypatch.setattr(module, "_add_table", lambda *_: None)
    found = 0
    for seed in range(12):
        view = drawn_view(generator(seed, "board"), (640, 480))
        axis = np.arange(1, GRID) * BLOCK_SIZE
        corners = np.stack([*np.meshgrid(axis, axis), np.zeros((GRID - 1, GRID - 1))], axis=-1)
        expected = view.camera.project(corners.reshape(-1, 3)).astype(np.float32)
        gray = cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY)
        seen = expected.reshape(-1, 1, 2).copy()
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
        cv2.cornerSubPix(gray, seen, (4, 4), (-1, -1), criteria)
        off = np.linalg.norm(seen[:, 0] - expected, axis=1)
        found += bool(np.median(off) < 0.3)
    assert found >= 3  # about half of the boards lie under the cells


def test_views_survive_the_disk(tmp_path):
    views = drawn_views(2, size=SIZE, validation=1)
    save_views(tmp_path / "views", views, quality=None)
    for view, again in zip(views, load_views(tmp_path / "views"), strict=True):
        np.testing.assert_array_equal(view.image, again.image)
        assert (view.name, view.part) == (again.name, again.part)


@pytest.mark.parametrize("count, validation", [(0, 0), (3, 3), (3, -1), (10_001, 0)])
def test_impossible_numbers_are_refused(count, validation):
    with pytest.raises(InputError, match="at least one is for training"):
        drawn_views(count, validation=validation)


@pytest.mark.parametrize("size", [(63, 640), (10_000, 4_001)])
def test_views_of_a_size_that_cannot_be_read_again_are_not_drawn(size):
    with pytest.raises(InputError, match="A view is too (small|large)"):
        drawn_views(1, size=size)
