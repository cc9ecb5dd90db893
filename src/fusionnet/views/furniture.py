"""What stands in the rooms: floor, walls, lamps, two tables, toys and fruit of plain shapes."""

from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import BLOCK_SIZE, GRID

_MIDDLE = np.array([GRID, GRID, 0.0]) * BLOCK_SIZE / 2
_TABLE_HEIGHT = 0.72
_FREE_RADIUS = 0.235
"""Nothing but the board lies nearer to the grid's middle, in metres."""

WINDOW_DIRECTION = np.array([-0.2, -0.75, -0.63])
"""Of the rays of the second light, in the frame of the grid; any length."""

_GEOM = mujoco.mjtGeom
_LIGHTS = {
    # name: main lamp, second light and everywhere, each red, green and blue
    "bright": ((0.62, 0.61, 0.58), (0.22, 0.23, 0.25), (0.38, 0.38, 0.38)),
    "dim": ((0.34, 0.31, 0.26), (0.08, 0.08, 0.09), (0.20, 0.19, 0.18)),
    "mixed": ((0.52, 0.44, 0.32), (0.22, 0.26, 0.34), (0.22, 0.22, 0.23)),
}


def add_room(
    spec: mujoco.MjSpec,
    lighting: str,
    light_direction: Float[np.ndarray, "3"],
    lamp_distance: float | None = None,
) -> None:
    """Floor, four walls, a dado, and the lamps of a lighting (the main one throws shadows).

    A lamp at a distance (metres) shines weaker the farther from it, and on the grid's middle as
    one far away does.
    """
    lamp, window, ambient = _LIGHTS[lighting]
    main = spec.worldbody.add_light()
    main.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    main.dir, main.pos = light_direction, _MIDDLE - light_direction
    main.diffuse, main.specular = np.array(lamp), 0.3 * np.array(lamp)
    main.ambient, main.castshadow = np.array(ambient), True
    if lamp_distance is not None:
        main.type = mujoco.mjtLightType.mjLIGHT_SPOT
        main.cutoff, main.exponent = 90.0, 0.0
        main.pos = _MIDDLE - lamp_distance * light_direction
        main.attenuation = np.array([0.0, 0.0, lamp_distance**-2])
        main.castshadow = False
    second = spec.worldbody.add_light()
    second.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    second.dir = WINDOW_DIRECTION
    second.pos = _MIDDLE - second.dir
    second.diffuse, second.specular = np.array(window), 0.2 * np.array(window)
    second.ambient, second.castshadow = np.zeros(3), lighting == "mixed"
    shade = {"bright": 0.78, "dim": 0.60, "mixed": 0.70}[lighting]
    _box(spec, (0.1, 0.1, -_TABLE_HEIGHT - 0.01), (3.0, 3.0, 0.01), (0.36, 0.33, 0.30))
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        place = np.array([0.1, 0.1, 0.6])
        place[axis] += 2.4 * sign
        half = np.array([2.4, 2.4, 1.4])
        half[axis] = 0.02
        tint = np.array([shade, shade * (0.98 - 0.04 * axis), shade * (0.92 + 0.05 * sign)])
        _box(spec, place, half, tint.clip(0, 1))
        dado = place.copy()
        dado[axis] -= 0.03 * sign
        dado[2] = -0.25
        _box(spec, dado, np.where(np.arange(3) == 2, 0.05, half), 0.55 * tint)
    _box(spec, (2.45, 0.5, 0.9), (0.03, 0.5, 0.4), (0.75, 0.85, 0.95))  # a window
    _box(spec, (-2.1, -0.9, -0.1), (0.2, 0.5, 0.62), (0.45, 0.30, 0.20))  # a cupboard
    _box(spec, (0.6, 2.1, 0.25), (0.45, 0.03, 0.3), (0.30, 0.42, 0.36))  # a picture


def add_table(spec: mujoco.MjSpec, kind: str) -> None:
    """A round white or a rectangular black table, its top at height 0."""
    legs = _TABLE_HEIGHT / 2
    if kind == "round-white":
        top = _geom(spec, _GEOM.mjGEOM_CYLINDER, _MIDDLE - [0, 0, 0.0135], (0.84, 0.83, 0.81))
        top.size = np.array([0.45, 0.0125, 0.0])
        foot = _geom(spec, _GEOM.mjGEOM_CYLINDER, _MIDDLE - [0, 0, legs], (0.7, 0.7, 0.7))
        foot.size = np.array([0.04, legs - 0.03, 0.0])
        return
    _box(spec, _MIDDLE - [0, 0, 0.0135], (0.36, 0.55, 0.0125), (0.055, 0.055, 0.06))
    for x in (-0.32, 0.32):
        for y in (-0.5, 0.5):
            at = _MIDDLE + [x, y, -legs]
            _box(spec, at, (0.025, 0.025, legs - 0.03), (0.08, 0.08, 0.08))


def add_distractors(spec: mujoco.MjSpec, rng: np.random.Generator) -> None:
    """Toys and fruit around the board, never above the grid."""
    things: list[Callable[[mujoco.MjSpec, np.ndarray, float], None]] = [
        _apple, _banana, _orange, _car, _duck, _cup, _ball, _pencil
    ]  # fmt: skip
    start = rng.uniform(0.0, 2.0 * np.pi)
    for index, which in enumerate(rng.permutation(len(things))):
        angle = start + 2.0 * np.pi * (index + rng.uniform(-0.2, 0.2)) / len(things)
        distance = _FREE_RADIUS + rng.uniform(0.0, 0.05)
        place = _MIDDLE + distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        things[which](spec, place, float(rng.uniform(0.0, 2.0 * np.pi)))


def _turned(place: np.ndarray, angle: float, x: float, y: float, z: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return place + np.array([cosine * x - sine * y, sine * x + cosine * y, z])


def _apple(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    _sphere(spec, place + [0, 0, 0.033], 0.034, (0.72, 0.10, 0.09))
    _capsule(spec, place + [0, 0, 0.064], place + [0.006, 0, 0.076], 0.002, (0.3, 0.2, 0.1))


def _orange(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    _sphere(spec, place + [0, 0, 0.035], 0.036, (0.95, 0.50, 0.08))


def _banana(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    bend = np.linspace(-1.0, 1.0, 7)
    spine = [_turned(place, angle, 0.07 * b, 0.03 * b * b, 0.016) for b in bend]
    for at, (first, second) in enumerate(zip(spine, spine[1:], strict=False)):
        radius = 0.009 if at in (0, 5) else 0.014
        _capsule(spec, first, second, radius, (0.93, 0.80, 0.16))


def _car(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    quaternion = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    _box(spec, place + [0, 0, 0.020], (0.040, 0.018, 0.010), (0.10, 0.45, 0.70), quaternion)
    _box(spec, place + [0, 0, 0.037], (0.020, 0.016, 0.008), (0.75, 0.85, 0.90), quaternion)
    for x in (-0.025, 0.025):
        for y in (-0.019, 0.019):
            _sphere(spec, _turned(place, angle, x, y, 0.010), 0.010, (0.05, 0.05, 0.05))


def _duck(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    body = _geom(spec, _GEOM.mjGEOM_ELLIPSOID, place + [0, 0, 0.024], (0.96, 0.84, 0.10))
    body.size = np.array([0.034, 0.026, 0.024])
    _sphere(spec, _turned(place, angle, 0.022, 0.0, 0.055), 0.018, (0.96, 0.84, 0.10))
    _sphere(spec, _turned(place, angle, 0.041, 0.0, 0.053), 0.007, (0.92, 0.45, 0.05))


def _cup(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    cup = _geom(spec, _GEOM.mjGEOM_CYLINDER, place + [0, 0, 0.042], (0.20, 0.55, 0.50))
    cup.size = np.array([0.034, 0.042, 0.0])
    inside = _geom(spec, _GEOM.mjGEOM_CYLINDER, place + [0, 0, 0.0835], (0.13, 0.09, 0.06))
    inside.size = np.array([0.030, 0.001, 0.0])


def _ball(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    _sphere(spec, place + [0, 0, 0.028], 0.028, (0.25, 0.25, 0.75))


def _pencil(spec: mujoco.MjSpec, place: np.ndarray, angle: float) -> None:
    first, second = (_turned(place, angle, x, 0.0, 0.004) for x in (-0.06, 0.06))
    _capsule(spec, first, second, 0.0035, (0.85, 0.25, 0.20))


def _geom(spec: mujoco.MjSpec, kind: object, place: object, color: object) -> mujoco.MjsGeom:
    geom = spec.worldbody.add_geom()
    geom.type, geom.pos = kind, np.asarray(place, dtype=float)
    geom.rgba = np.append(np.asarray(color, dtype=float), 1.0)
    return geom


def _box(
    spec: mujoco.MjSpec,
    place: object,
    half: object,
    color: object,
    quaternion: np.ndarray | None = None,
) -> None:
    geom = _geom(spec, _GEOM.mjGEOM_BOX, place, color)
    geom.size = np.asarray(half, dtype=float)
    if quaternion is not None:
        geom.quat = quaternion


def _sphere(spec: mujoco.MjSpec, place: np.ndarray, radius: float, color: object) -> None:
    _geom(spec, _GEOM.mjGEOM_SPHERE, place, color).size = np.array([radius, 0.0, 0.0])


def _capsule(
    spec: mujoco.MjSpec, first: np.ndarray, second: np.ndarray, radius: float, color: object
) -> None:
    geom = spec.worldbody.add_geom()
    geom.type = _GEOM.mjGEOM_CAPSULE
    geom.rgba = np.append(np.asarray(color, dtype=float), 1.0)
    geom.fromto = np.concatenate([first, second])
    geom.size = np.array([radius, 0.0, 0.0])
