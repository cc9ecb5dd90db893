"""Laws of transforms and cameras."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fusionnet.geometry import (
    PinholeCamera,
    PointBehindCameraError,
    apply,
    compose,
    invert,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    transform,
    vector_from_rotation,
)

lengths = st.floats(-2.0, 2.0, allow_nan=False, width=32)
vectors = arrays(float, 3, elements=lengths)
points = arrays(float, (5, 3), elements=lengths)


def pose(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    return transform(rotation_from_vector(rotation), translation)


@given(vectors, vectors)
def test_a_transform_and_its_inverse_cancel(rotation, translation):
    a_from_b = pose(rotation, translation)
    np.testing.assert_allclose(compose(a_from_b, invert(a_from_b)), np.eye(4), atol=1e-9)


@given(vectors, vectors, vectors, vectors, points)
def test_composing_is_applying_one_after_the_other(r, t, s, u, where):
    a_from_b, b_from_c = pose(r, t), pose(s, u)
    together = apply(compose(a_from_b, b_from_c), where)
    np.testing.assert_allclose(together, apply(a_from_b, apply(b_from_c, where)), atol=1e-9)


def test_composing_nothing_is_the_identity():
    np.testing.assert_array_equal(compose(), np.eye(4))


@given(vectors)
def test_rotations_survive_quaternions_and_vectors(vector):
    rotation = rotation_from_vector(vector)
    quaternion = quaternion_from_rotation(rotation)
    assert np.linalg.norm(quaternion) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), rotation, atol=1e-7)
    np.testing.assert_allclose(
        rotation_from_vector(vector_from_rotation(rotation)), rotation, atol=1e-6
    )


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.8, 0.0]]]))
def test_half_turns_have_a_quaternion(axis):
    rotation = 2.0 * np.outer(axis, axis) - np.eye(3)
    np.testing.assert_allclose(
        rotation_from_quaternion(quaternion_from_rotation(rotation)), rotation, atol=1e-12
    )


@given(vectors, vectors, arrays(float, (4, 2), elements=st.floats(0, 500, width=32)))
def test_projecting_what_was_unprojected_gives_the_pixels(rotation, translation, pixels):
    camera = PinholeCamera.from_vertical_view((640, 480), 0.9, pose(rotation, translation))
    seen = camera.unproject(pixels, np.array([0.2, 0.5, 1.0, 3.0]))
    np.testing.assert_allclose(camera.project(seen), pixels, atol=1e-6)


@given(vectors, vectors)
def test_a_point_straight_ahead_is_in_the_middle_of_the_picture(rotation, translation):
    camera = PinholeCamera.from_vertical_view((641, 481), 0.9, pose(rotation, translation))
    ahead = apply(invert(camera.camera_from_robot), np.array([[0.0, 0.0, 0.7]]))
    np.testing.assert_allclose(camera.project(ahead), [[320.0, 240.0]], atol=1e-6)
    np.testing.assert_allclose(
        camera.position, apply(invert(camera.camera_from_robot), np.zeros(3)), atol=1e-9
    )


def test_the_field_of_view_reaches_the_edges_of_the_picture():
    camera = PinholeCamera.from_vertical_view((100, 50), np.deg2rad(60.0), np.eye(4))
    top = np.array([[0.0, -np.tan(np.deg2rad(30.0)), 1.0]])
    np.testing.assert_allclose(camera.project(top), [[49.5, -0.5]], atol=1e-9)


def test_a_point_behind_the_camera_is_refused():
    camera = PinholeCamera.from_vertical_view((100, 50), 1.0, np.eye(4))
    with pytest.raises(PointBehindCameraError, match="Point 1 lies 0.500 m behind"):
        camera.project(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -0.5]]))
