"""Photographs of the six rooms in folders, with the truth beside them, and views made of them."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float

from fusionnet.errors import InputError
from fusionnet.files import write_whole
from fusionnet.geometry import invert, vector_from_rotation
from fusionnet.randomness import generator
from fusionnet.views.calibration import CalibratedEnvironment, Calibration
from fusionnet.views.importing import MOST_UNCERTAIN, deviation_in, pose_in
from fusionnet.views.picture_file import check_size
from fusionnet.views.rooms import (
    PLACEMENT,
    ROOMS,
    Room,
    RoomPhotographer,
    calibration_pose,
    lens_of,
    robot_pose,
    view_poses,
)
from fusionnet.views.view import EnvironmentalView

TRUTH_FILE = "truth.json"
FIRST_VIEWS = ("view-1", "view-2")
"""Photographs of each room that become views to train with: twelve in all."""

ROBOT_VIEW = "robot"
"""Photograph near the robot's own view, which becomes one to validate with."""

ROBOT_VIEW_ROOMS = (ROOMS[0].name, ROOMS[2].name, ROOMS[4].name)
FEWEST, MOST = 10, 500


def photograph_names(room: Room, count: int) -> list[str]:
    """The photographs of a room: those that become views, and others up to `count`."""
    names = [*FIRST_VIEWS, *([ROBOT_VIEW] if room.name in ROBOT_VIEW_ROOMS else [])]
    return names + [f"{index:03}" for index in range(count - len(names))]


def chosen_views() -> list[str]:
    """The names (`environment/file`) of the fifteen photographs that become views."""
    return [
        f"{room.name}/{name}.jpg"
        for room in ROOMS
        for name in photograph_names(room, FEWEST)
        if not name.isdecimal()
    ]


def photograph_rooms(
    folder: Path,
    count: int = 60,
    size: tuple[int, int] = (960, 540),
    seed: int = 0,
    rooms: Sequence[Room] = ROOMS,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Path]:
    """Photograph every room, or go on with it: what is there already is kept.

    Args:
        folder: For one folder a room.
        count: Photographs a room; the thesis took about 60.
        size: Width and height, in pixels; the thesis's were 1920 x 1080.
        seed: Of poses, distractors and sensor noise; the same seed gives the same pictures.
        rooms: Which.
        progress: Called with how many are done, and of how many.

    Returns:
        The rooms' folders.

    Raises:
        InputError: If the count or the size is out of range, the whole grid hardly ever fits into
            a picture of that size, or the folder has photographs of other settings.
        OutputError: If they cannot be written; those that were are whole.
        RenderingError: If pictures cannot be rendered here.
    """
    if not FEWEST <= count <= MOST:
        raise InputError(f"Expected {FEWEST} to {MOST} photographs a room; received {count}.")
    check_size("A photograph", *size)
    total, done = len(rooms) * count, 0
    folders = []
    for room in rooms:
        place = folder / room.name
        settings = {"size": list(size), "seed": seed, "count": count}
        _check_settings(place, settings)
        names = photograph_names(room, count)
        poses = {name: photograph_pose(room, name, size, seed) for name in names}
        truth = {
            **settings,
            "matrix": lens_of(room, size).matrix.tolist(),
            "coefficients": lens_of(room, size).coefficients.tolist(),
            "light_direction": room.light_direction.tolist(),
            "camera_from_board": {name: pose.tolist() for name, pose in poses.items()},
        }
        write_whole(place / TRUTH_FILE, json.dumps(truth, indent=1) + "\n")
        photographer: RoomPhotographer | None = None
        for name in names:
            file = place / f"{name}.jpg"
            if not file.exists():
                photographer = photographer or RoomPhotographer(room, size, seed)
                noise = generator(seed, "sensor noise", room.name, name)
                picture = cv2.cvtColor(photographer.take(poses[name], noise), cv2.COLOR_RGB2BGR)
                _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])
                write_whole(file, jpeg.tobytes())
            done += 1
            progress(done, total)
        if photographer is not None:
            photographer.close()
        folders.append(place)
    return folders


def _check_settings(place: Path, settings: dict[str, Any]) -> None:
    file = place / TRUTH_FILE
    if not file.exists():
        if place.is_dir() and any(place.iterdir()):
            raise InputError(f"{place} holds other files; name a new folder.")
        return
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        same = all(found[name] == value for name, value in settings.items())
    except (OSError, ValueError, KeyError, TypeError):
        same = False
    if not same:
        raise InputError(
            f"{place} holds photographs of other settings than {settings}; name a new folder, or "
            "give the settings that it was begun with."
        )


EYE_POSITION = np.array([-0.1636, 0.0775, 0.2969])
"""NICO's left eye in the frame of the grid, in metres; a test compares it with the robot's."""


def photograph_pose(
    room: Room, name: str, size: tuple[int, int], seed: int
) -> Float[np.ndarray, "4 4"]:
    """The true `camera_from_board` of a room's photograph, by its name without suffix."""
    rng = generator(seed, "pose", room.name, name)
    if name in FIRST_VIEWS:
        return next(view_poses(room, size, rng))
    if name == ROBOT_VIEW:
        return robot_pose(EYE_POSITION, rng)
    return calibration_pose(rng)


def parted(views: tuple[EnvironmentalView, ...]) -> tuple[EnvironmentalView, ...]:
    """The views near the robot's own validate; the others train."""
    return tuple(
        replace(view, part="val") if view.name.endswith(f"-{ROBOT_VIEW}") else view
        for view in views
    )


@dataclass(frozen=True, kw_only=True)
class RoomErrors:
    """How far a calibration of rooms is from the truth.

    Attributes:
        focal: For each room the lens's relative error of the focal length.
        position: For each photograph, of the camera, in metres.
        rotation: For each photograph, of the camera, in radians.
        chosen: For each photograph, whether it is one of the fifteen that become views.
    """

    focal: Float[np.ndarray, " r"]
    position: Float[np.ndarray, " n"]
    rotation: Float[np.ndarray, " n"]
    chosen: Bool[np.ndarray, " n"]

    def as_json(self) -> dict[str, float]:
        """Largest and mean errors in readable units."""
        degrees, millimetres = np.degrees(self.rotation), 1000 * self.position
        views = self.chosen
        return {
            "photographs": float(len(degrees)),
            "focal_error_largest_percent": float(100 * np.abs(self.focal).max()),
            "position_error_mean_mm": float(millimetres.mean()),
            "position_error_largest_mm": float(millimetres.max()),
            "rotation_error_mean_degrees": float(degrees.mean()),
            "position_error_largest_of_views_mm": float(millimetres[views].max(initial=0.0)),
            "position_within_1_mm": float((millimetres <= 1.0).mean()),
            "rotation_error_largest_degrees": float(degrees.max()),
        }


def room_errors(calibration: Calibration) -> RoomErrors:
    """Compare the calibration of photographs that `photograph_rooms` took with the truth.

    Only photographs whose pose would be used are compared: those in which the board was found, and
    seen well enough.
    """
    focal, position, rotation, chosen = [], [], [], []
    views = chosen_views()
    for environment in calibration.environments:
        truth = _truth(environment)
        focal.append(environment.lens.matrix[0, 0] / truth["matrix"][0][0] - 1.0)
        for photograph in environment.used:
            true = np.array(truth["camera_from_board"][photograph.file.stem])
            if deviation_in(calibration, environment, photograph) > MOST_UNCERTAIN:
                continue
            found = pose_in(calibration, environment, photograph, PLACEMENT)
            apart = found[:3, :3] @ true[:3, :3].T
            rotation.append(np.linalg.norm(vector_from_rotation(apart)))
            chosen.append(photograph.name in views)
            position.append(np.linalg.norm(invert(found)[:3, 3] - invert(true)[:3, 3]))
    return RoomErrors(
        focal=np.array(focal),
        position=np.array(position),
        rotation=np.array(rotation),
        chosen=np.array(chosen),
    )


def _truth(environment: CalibratedEnvironment) -> dict[str, Any]:
    file = environment.used[0].file.with_name(TRUTH_FILE)
    truth: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return truth
