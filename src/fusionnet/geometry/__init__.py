"""Rigid transforms and camera models, in metres, radians and pixels."""

from fusionnet.geometry.cameras import PinholeCamera, PointBehindCameraError
from fusionnet.geometry.transforms import (
    apply,
    compose,
    invert,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    transform,
    vector_from_rotation,
)

__all__ = [
    "PinholeCamera",
    "PointBehindCameraError",
    "apply",
    "compose",
    "invert",
    "quaternion_from_rotation",
    "rotation_from_quaternion",
    "rotation_from_vector",
    "transform",
    "vector_from_rotation",
]
