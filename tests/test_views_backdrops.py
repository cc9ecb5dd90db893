"""Photographs without blocks, behind what is drawn and in its place."""

import numpy as np
import pytest
from PIL import Image

from fusionnet.errors import InputError
from fusionnet.randomness import generator
from fusionnet.training.empty_pictures import empty_picture
from fusionnet.views import Backdrops, drawn_view
from fusionnet.views.backdrops import LONGEST_SIDE

SIZE = (96, 80)


def half_red() -> np.ndarray:
    """Red on the left, blue on the right: nothing that we draw looks like that."""
    photograph = np.zeros((120, 200, 3), np.uint8)
    photograph[:, :100, 0], photograph[:, 100:, 2] = 250, 250
    return photograph


def test_crops_show_parts_of_any_size_and_both_ways():
    backdrops = Backdrops([half_red()])
    crops = [backdrops.crop(generator(seed, "crop"), SIZE) for seed in range(60)]
    assert {crop.shape for crop in crops} == {(SIZE[1], SIZE[0], 3)}
    left_is_red = [crop[40, 0, 0] > 200 > crop[40, -1, 0] for crop in crops]
    left_is_blue = [crop[40, 0, 2] > 200 > crop[40, -1, 2] for crop in crops]
    assert any(left_is_red) and any(left_is_blue)
    same = backdrops.crop(generator(0, "crop"), SIZE)
    np.testing.assert_array_equal(same, crops[0])


def test_large_photographs_are_kept_smaller(tmp_path):
    Image.new("RGB", (3 * LONGEST_SIDE, LONGEST_SIDE), (10, 200, 30)).save(tmp_path / "a.png")
    Image.new("L", (200, 100), 90).save(tmp_path / "b.jpg")
    backdrops = Backdrops.of_folder(tmp_path)
    assert len(backdrops) == 2
    assert backdrops.crop(generator(1, "crop"), (900, 900)).shape == (900, 900, 3)


def test_folders_without_photographs_are_refused(tmp_path):
    with pytest.raises(InputError, match="no photographs"):
        Backdrops.of_folder(tmp_path)
    (tmp_path / "a.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match="not a picture"):
        Backdrops.of_folder(tmp_path)
    with pytest.raises(InputError, match="at least one"):
        Backdrops([])


def test_more_photographs_than_fit_into_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fusionnet.views.photographs.MOST_PHOTOGRAPHS", 1)
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(InputError, match="holds 2 photographs, more than 1; all are kept in mem"):
        Backdrops.of_folder(tmp_path)


def test_photographs_are_behind_some_drawn_views():
    backdrops = Backdrops([half_red()])
    views = [
        drawn_view(generator(seed, "backdrop"), (192, 160), backdrops=backdrops).image
        for seed in range(12)
    ]
    vivid = [np.mean(np.ptp(image.astype(int), axis=2) > 150) for image in views]
    assert 2 <= sum(share > 0.2 for share in vivid) <= 10


def test_some_empty_pictures_are_photographs_and_hold_nothing():
    backdrops = Backdrops([half_red()])
    pictures = [empty_picture(generator(seed, "empty"), SIZE, backdrops) for seed in range(20)]
    assert all(not len(labels.boxes) for _, labels in pictures)
    flat = [len(np.unique(image.reshape(-1, 3), axis=0)) < 60 for image, _ in pictures]
    assert 4 <= sum(flat) <= 16
