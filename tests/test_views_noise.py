"""Noise stays within its ranges, and boxes, masks and cameras follow a moved picture."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.blocks.grid import Color
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera, transform
from fusionnet.randomness import generator
from fusionnet.simulation import BLOCK_COLORS, Appearance, View
from fusionnet.views.noise import Look, SensorNoise, level_one
from fusionnet.views.transformation import (
    CROP_FACTORS,
    LevelTwo,
    crop_around,
    cropped,
    transformed,
)

SIZE = (240, 135)
SEEDS = st.integers(0, 2**31)


def view_of_discs(*, masks: bool = True) -> View:
    """Three discs, and the camera that sees their middles at depth one."""
    middles = np.array([[60.0, 60.0], [120.0, 67.0], [190.0, 40.0]])
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    block_at = np.full((SIZE[1], SIZE[0]), -1, np.int16)
    for index, (x, y) in enumerate(middles):
        block_at[(columns - x) ** 2 + (rows - y) ** 2 < 12**2] = index
    image = np.repeat((80 + 50 * (block_at + 1)).astype(np.uint8)[..., None], 3, axis=2)
    boxes = np.concatenate([middles - 11, middles + 12], axis=1)
    visible = np.bincount(block_at.ravel() + 1, minlength=4)[1:]
    matrix = np.array([[200.0, 0.0, 118.0], [0.0, 210.0, 70.0], [0.0, 0.0, 1.0]])
    camera = PinholeCamera(*SIZE, matrix, transform(translation=(0.1, -0.2, 0.3)))
    shares = np.array([1.0, 0.5, 0.2])
    order = np.arange(3)
    return View(image, camera, boxes, order, order, visible, shares, block_at if masks else None)


@given(SEEDS)
def test_level_one_stays_within_the_thesis_s_ranges(seed):
    look = level_one().sample(generator(seed, "look"), 30)
    assert np.abs(look.scales - 1.0).max() <= 0.10
    assert np.all(np.abs(np.rad2deg(look.turns)) <= [6.0, 6.0, 10.0])
    assert np.abs(look.shifts).max() <= 0.01
    values = [look.contrast, look.lightness, look.light_contrast, look.light, *look.intensities]
    assert 0.8 <= min(values) and max(values) <= 1.2


def test_level_one_reaches_its_ranges_and_repeats():
    looks = [level_one().sample(generator(1, "look", i), 8) for i in range(200)]
    assert max(np.abs(look.shifts).max() for look in looks) > 0.0095
    assert np.ptp([look.lightness for look in looks]) > 0.35
    again = level_one().sample(generator(1, "look", 3), 8)
    np.testing.assert_array_equal(looks[3].turns, again.turns)


def test_strength_weakens_the_geometry_and_nothing_else():
    weak = level_one(0.1).sample(generator(1, "look"))
    assert np.abs(weak.shifts).max() <= 0.001 and np.ptp(weak.intensities) > 0.3


@pytest.mark.parametrize("strength", [-0.1, 1.5])
def test_a_strength_out_of_range_is_refused(strength):
    with pytest.raises(InputError, match="0 to 1"):
        level_one(strength)


def test_an_intensity_of_zero_is_grey_and_of_one_the_colour_itself():
    for color in Color:
        plain = np.array(BLOCK_COLORS[color])
        grey = plain * Look(intensities=np.zeros(1)).tint(BLOCK_COLORS[color], 0)
        assert np.ptp(grey) < 1e-9
        np.testing.assert_allclose(Look().tint(BLOCK_COLORS[color], 0), 1.0)


def test_contrast_and_lightness_follow_the_thesis_s_scale():
    image = generator(0, "image").integers(60, 180, (40, 50, 3), dtype=np.uint8)
    assert np.ptp(Look(contrast=0.0).on_photograph(image)) == 0
    assert Look(lightness=0.0).on_photograph(image).max() == 0
    assert Look().on_photograph(image) is image
    assert Look(contrast=1.2).on_photograph(image).std() == pytest.approx(1.2 * image.std(), 0.02)


def test_less_contrast_moves_light_from_the_lamp_to_the_surroundings():
    light = Look(light_contrast=0.8).on_light(Appearance())
    assert np.all(light.light < Appearance().light)
    assert np.all(light.ambient > Appearance().ambient)


def test_light_can_be_turned_to_come_from_anywhere():
    level = replace(level_one(), lamp_turn=180.0)
    lights = [level.sample(generator(i, "turn"), 1).on_light(Appearance()) for i in range(50)]
    directions = np.array([light.light_direction for light in lights])
    np.testing.assert_allclose(directions[:, 2], Appearance().light_direction[2])
    assert np.all(np.ptp(directions[:, :2], axis=0) > 0.9)
    still = level_one().sample(generator(0, "turn")).on_light(Appearance())
    np.testing.assert_allclose(still.light_direction, Appearance().light_direction)


@given(SEEDS)
@settings(max_examples=40)
def test_camera_masks_and_boxes_follow_level_two(seed):
    """A point that the old camera projects into a pixel is projected to the pixel's new place."""
    view = view_of_discs()
    new_from_old = LevelTwo().sample(generator(seed, "level two"), SIZE)
    new = transformed(view, new_from_old)
    points = view.camera.unproject(view.boxes[:, :2], np.array([0.5, 1.0, 2.0]))
    expected = view.boxes[:, :2] @ new_from_old[:2, :2].T + new_from_old[:2, 2]
    np.testing.assert_allclose(new.camera.project(points), expected, atol=1e-6)
    roll = new.camera.camera_from_robot[:3, :3]
    np.testing.assert_allclose(roll @ roll.T, np.eye(3), atol=1e-9)
    assert np.abs(np.tril(new.camera.matrix, -1)).max() < 1e-9
    corners = transformed(view_of_discs(masks=False), new_from_old)
    for mask, box, index in zip(new.masks, new.boxes, new.indices, strict=True):
        rows, columns = np.nonzero(mask)
        edges = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        np.testing.assert_array_equal(box, edges)
        around = corners.boxes[corners.indices == index][0]
        assert np.all(around[:2] <= box[:2] + 1.0) and np.all(around[2:] >= box[2:] - 1.0)
        middle = np.array([columns.mean(), rows.mean()])
        cut = box[0] == 0 or box[1] == 0 or box[2] == SIZE[0] or box[3] == SIZE[1]
        old = np.array([[60.0, 60.0], [120.0, 67.0], [190.0, 40.0]])[index]
        if not cut:
            moved = new_from_old[:2, :2] @ old + new_from_old[:2, 2]
            np.testing.assert_allclose(middle, moved, atol=0.5)
            assert new.shares[index] == pytest.approx(view.shares[index], rel=0.1)


@given(SEEDS)
@settings(max_examples=60)
def test_level_two_stays_within_the_thesis_s_ranges(seed):
    new_from_old = LevelTwo().sample(generator(seed, "level two"), SIZE)
    middle = np.array([0.5 * (SIZE[0] - 1), 0.5 * (SIZE[1] - 1), 1.0])
    shift = (new_from_old @ middle - middle)[:2]
    assert np.all(np.abs(shift) <= 0.1 * np.array(SIZE) + 1e-9)
    area = np.linalg.det(new_from_old[:2, :2])
    assert 0.64 <= area <= 1.44 + 1e-9  # shears keep areas


def test_a_map_that_changes_nothing_changes_nothing():
    view = view_of_discs()
    same = transformed(view, np.eye(3))
    np.testing.assert_array_equal(same.image, view.image)
    np.testing.assert_array_equal(same.boxes, view.boxes)
    np.testing.assert_array_equal(same.block_at, view.block_at)
    np.testing.assert_array_equal(same.shares, view.shares)


def test_what_leaves_the_picture_has_no_box():
    away = np.eye(3)
    away[0, 2] = 90.0
    for masks in (True, False):
        new = transformed(view_of_discs(masks=masks), away)
        assert list(new.indices) == [0, 1]
        assert new.visible[2] == 0 and new.shares[2] == 0.0


def test_a_mirror_is_refused():
    with pytest.raises(InputError, match="mirrored"):
        transformed(view_of_discs(), np.diag([-1.0, 1.0, 1.0]))


@given(
    st.lists(
        st.tuples(st.integers(0, 900), st.integers(0, 500), st.integers(1, 60), st.integers(1, 40)),
        max_size=8,
    )
)
def test_a_crop_holds_all_boxes_and_no_smaller_factor_could(places):
    boxes = np.array([(x, y, x + w, y + h) for x, y, w, h in places], float).reshape(-1, 4)
    left, top, right, bottom = crop_around(boxes, (960, 540))
    assert 0 <= left < right <= 960 and 0 <= top < bottom <= 540
    factor = (right - left) / 960
    assert min(abs(factor - f) for f in CROP_FACTORS) < 1e-3
    assert (right - left) / (bottom - top) == pytest.approx(16 / 9, rel=0.01)
    if len(boxes):
        assert np.all(boxes[:, :2] >= [left, top]) and np.all(boxes[:, 2:] <= [right, bottom])
        extent = (boxes[:, 2:].max(axis=0) - boxes[:, :2].min(axis=0)) / [960, 540]
        smaller = [f for f in CROP_FACTORS if f < factor - 1e-3]
        assert not smaller or extent.max() > max(smaller) - 2e-3
    else:
        assert factor == 1.0


def test_a_cropped_and_resized_view_keeps_its_labels():
    view = view_of_discs()
    crop = crop_around(view.boxes, SIZE)
    for size in (None, (120, 67), (480, 270)):
        part = cropped(view, crop, size)
        width, height = size or (crop[2] - crop[0], crop[3] - crop[1])
        assert part.image.shape == (height, width, 3)
        factor = np.array([width / (crop[2] - crop[0]), height / (crop[3] - crop[1])])
        expected = (view.boxes - np.tile(crop[:2], 2)) * np.tile(factor, 2)
        np.testing.assert_allclose(part.boxes, expected, atol=1.0 * factor.max())
        points = view.camera.unproject(view.boxes[:, :2] - 0.5, np.ones(3))
        np.testing.assert_allclose(part.camera.project(points) + 0.5, expected[:, :2])


@pytest.mark.parametrize("crop", [(10, 10, 10, 50), (-1, 0, 50, 50), (0, 0, 241, 20)])
def test_a_crop_outside_the_picture_is_refused(crop):
    with pytest.raises(InputError, match="240x135"):
        cropped(view_of_discs(), crop)


def test_sensor_noise_repeats_and_keeps_the_picture():
    image = view_of_discs().image
    one, two = (SensorNoise().apply(image, generator(3, "sensor")) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert one.shape == image.shape and 0.3 < np.abs(one.astype(int) - image).mean() < 40
    still = SensorNoise(
        blur=(0.0, 0.0), noise=(0.0, 0.0), white_balance=(1.0, 1.0), gamma=(1.0, 1.0), quality=None
    ).apply(image, generator(3, "sensor"))
    np.testing.assert_array_equal(still, image)
