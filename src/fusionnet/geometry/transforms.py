"""Rigid transforms as 4x4 matrices, named `target_from_source`.

So `camera_from_robot @ robot_from_block` visibly composes. Rotations in poses for
MuJoCo are unit quaternions in the order (w, x, y, z).
"""

import numpy as np
from jaxtyping import Float

Matrix = Float[np.ndarray, "4 4"]


def transform(
    rotation: Float[np.ndarray, "3 3"] | None = None,
    translation: Float[np.ndarray, "3"] | tuple[float, float, float] | None = None,
) -> Matrix:
    """A transform from a rotation matrix and a translation in metres; what is left out is none."""
    result = np.eye(4)
    if rotation is not None:
        result[:3, :3] = rotation
    if translation is not None:
        result[:3, 3] = translation
    return result


def compose(*transforms: Matrix) -> Matrix:
    """The product `a_from_b @ b_from_c @ ...`; the identity when nothing is given."""
    result = np.eye(4)
    for each in transforms:
        result = result @ each
    return result


def invert(target_from_source: Matrix) -> Matrix:
    """`source_from_target`, using that the rotation part is orthogonal."""
    rotation = target_from_source[:3, :3]
    return transform(rotation.T, -rotation.T @ target_from_source[:3, 3])


def apply(
    target_from_source: Matrix, points: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3"]:
    """The same points in the target frame, in metres."""
    return np.asarray(points) @ target_from_source[:3, :3].T + target_from_source[:3, 3]


def rotation_from_vector(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rodrigues' formula: the rotation about `vector` by its length in radians."""
    vector = np.asarray(vector, dtype=float)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def vector_from_rotation(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """The inverse of `rotation_from_vector`, with a length of at most pi."""
    quaternion = quaternion_from_rotation(rotation)
    length = float(np.linalg.norm(quaternion[1:]))
    if length < 1e-12:
        return np.zeros(3)
    return quaternion[1:] / length * 2.0 * np.arctan2(length, quaternion[0])


def quaternion_from_rotation(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """The unit quaternion (w, x, y, z) of a rotation matrix, with w >= 0.

    References:
        Shepperd (1978), Quaternion from rotation matrix: divides by the largest component.
    """
    m = np.asarray(rotation, dtype=float)
    four_squares = 1.0 + np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) @ np.diag(m)
    largest = int(np.argmax(four_squares))
    w_terms = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    if largest == 0:
        quaternion = np.array([four_squares[0], *w_terms])
    else:
        i = largest - 1
        products = m[i] + m[:, i]
        products[i] = four_squares[largest]
        quaternion = np.array([w_terms[i], *products])
    quaternion /= np.linalg.norm(quaternion)
    return quaternion if quaternion[0] >= 0.0 else -quaternion


def rotation_from_quaternion(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """The rotation matrix of a quaternion (w, x, y, z), which is normalised first."""
    w, x, y, z = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
