"""Views move under their boxes; pictures of the eye keep their place."""

from dataclasses import replace

import numpy as np
import pytest

from fusionnet.dataset.pictures import Labels
from fusionnet.randomness import generator
from fusionnet.training.empty_pictures import empty_picture, shaded_leaves
from fusionnet.training.picture_variation import varied, varied_view

SIZE = (352, 304)


def one_square(by_eye: bool) -> tuple[np.ndarray, Labels]:
    """A bright square on a dark ground, and its box."""
    image = np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)
    image[140:170, 150:200] = 220
    _, nothing = empty_picture(generator(0, "test"), SIZE)
    box = np.array([[150.0, 140.0, 200.0, 170.0]])
    labels = replace(nothing, boxes=box, classes=np.array([3]), hidden=np.zeros(1, bool))
    return image, replace(labels, by_eye=by_eye)


@pytest.mark.parametrize("seed", range(12))
def test_boxes_stay_around_their_blocks(seed):
    image, labels = varied(*one_square(by_eye=False), generator(seed, "varied"))
    rows, columns = np.nonzero(image[..., 0] > 130)
    if not len(labels.boxes):
        assert len(rows) < 0.4 * 30 * 50 * 2  # moved out of the picture
        return
    around = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    np.testing.assert_allclose(labels.boxes[0], around, atol=1.5)
    assert labels.classes.tolist() == [3]


def test_pictures_of_the_eye_keep_their_place():
    places = set()
    for seed in range(8):
        image, labels = varied(*one_square(by_eye=True), generator(seed, "varied"))
        rows, columns = np.nonzero(image[..., 0] > 130)
        places.add((columns.min(), rows.min(), columns.max(), rows.max()))
        np.testing.assert_array_equal(labels.boxes, one_square(by_eye=True)[1].boxes)
    assert places == {(150, 140, 199, 169)}


def test_empty_pictures_differ_and_hold_nothing():
    pictures = [empty_picture(generator(seed, "empty"), SIZE) for seed in range(6)]
    assert len({int(image.sum()) for image, _ in pictures}) == 6
    assert all(image.shape == (304, 352, 3) and not len(t.boxes) for image, t in pictures)
    again, _ = empty_picture(generator(0, "empty"), SIZE)
    np.testing.assert_array_equal(again, pictures[0][0])


@pytest.mark.parametrize("seed", range(12))
def test_views_alone_come_from_larger_pictures_at_any_size(seed):
    image, labels = one_square(by_eye=False)
    size = (SIZE[0] // 2, SIZE[1] // 2)
    image, labels = varied_view(image, labels, size, generator(seed, "wide"))
    assert image.shape == (size[1], size[0], 3) and not labels.by_eye
    rows, columns = np.nonzero(image[..., 0] > 130)
    if not len(labels.boxes):
        return
    around = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    np.testing.assert_allclose(labels.boxes[0], around, atol=1.5)


def test_views_alone_show_blocks_from_half_to_twice_as_large():
    size, widths = (SIZE[0] // 2, SIZE[1] // 2), []
    for seed in range(60):
        _, labels = varied_view(*one_square(by_eye=False), size, generator(seed, "widths"))
        widths += list(labels.boxes[:, 2] - labels.boxes[:, 0])
    assert min(widths) < 0.6 * 25 and max(widths) > 2 * 25


def test_leaves_are_of_all_sizes_and_shaded():
    pictures = [shaded_leaves(generator(seed, "leaves"), SIZE) for seed in range(8)]
    assert all(picture.shape == (304, 352, 3) for picture in pictures)
    assert any((p.max(axis=2) - p.min(axis=2)).mean() < 10 for p in pictures)  # without colour
    assert any((p.max(axis=2) - p.min(axis=2)).mean() > 30 for p in pictures)
    assert min(p.std() for p in pictures) > 20
    again = shaded_leaves(generator(0, "leaves"), SIZE)
    np.testing.assert_array_equal(again, pictures[0])
