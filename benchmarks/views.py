r"""How near calibration, poses and the estimated light come to the truth.

    MUJOCO_GL=egl OMP_NUM_THREADS=1 python benchmarks/views.py --photographs FOLDER --images 60 \
        --others 60

prints six things as JSON. Photographs (with `--photographs`, of a board of 10 x 7 squares of
2.5 cm, OpenCV's samples): the calibration's reprojection error, and its focal length against
`cv2.calibrateCamera`'s own. Rooms (with `--images`, photographs a room): the six rooms are
photographed and calibrated, and lenses, poses, and lamps found by their glints compared with the
true ones. Other rooms (with `--others`): lamps found by their glints where surfaces are duller or
lamps near. Rooms' light: the lamp of overlays in the fifteen shipped views. Rooms' light by one
picture: the same without what other photographs tell of lamps; they are far away, so that the
board is evenly bright. Near lamps: by one picture, with a lamp half a metre from the board.
"""

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from jaxtyping import Float

from fusionnet.geometry import apply, invert
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.views import EnvironmentalView, load_views
from fusionnet.views.calibration import calibrate
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.furniture import WINDOW_DIRECTION
from fusionnet.views.glints import NO_LAMPS, glints_in, lamp_rays
from fusionnet.views.importing import import_views, lamp_rays_in
from fusionnet.views.lighting import estimate_light
from fusionnet.views.photographing import (
    chosen_views,
    photograph_names,
    photograph_pose,
    photograph_rooms,
    room_errors,
)
from fusionnet.views.photographs import find_boards
from fusionnet.views.pose import GridPlacement, facing
from fusionnet.views.rooms import BOARD, PLACEMENT, ROOMS, Room, RoomPhotographer, view_poses

ROOM = {room.name: room for room in ROOMS}
OTHER_ROOMS: dict[str, dict[str, Any]] = {
    "a third of the gloss": {"gloss": 0.3},
    "a tenth of the gloss": {"gloss": 0.1},
    "no gloss": {"gloss": 0.0},
    "main lamp at half a metre": {"lamp_distance": 0.5},
}


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        photographs: Folder of real photographs; left out, only rooms are measured.
        images: Photographs a room, which take minutes; 0 leaves the calibration of rooms out.
        rooms: Folder for these photographs, kept to go on with; none are kept if left out.
        others: Photographs a room with other surfaces and lamps, of the three with a black table.
        lamps: Places of a near lamp, around the board.
        seed: Of the cameras' poses.
    """

    photographs: Path | None = None
    images: int = 0
    rooms: Path | None = None
    others: int = 0
    lamps: int = 12
    seed: int = 0


def photographs_against_opencv(folder: Path) -> dict[str, Any]:
    """Reprojection error and focal lengths of real photographs."""
    board = Checkerboard(10, 7, 0.025)
    environment = find_boards(folder, board)
    calibration = calibrate([environment], board)
    seen = [
        np.asarray(photograph.corners, np.float32)[:, None] for photograph in environment.usable
    ]
    points = [board.points.astype(np.float32)] * len(seen)
    error, matrix, *_ = cv2.calibrateCamera(points, seen, environment.size, None, None)
    ours, theirs = calibration.matrix[[0, 1], [0, 1]], matrix[[0, 1], [0, 1]]
    return {
        "used": len(environment.usable),
        "of": len(environment.photographs),
        "mean_reprojection_error_px": round(calibration.mean_error, 4),
        "focal_lengths_px": ours.round(2).tolist(),
        "focal_lengths_by_calibrateCamera_px": theirs.round(2).tolist(),
        "reprojection_error_by_calibrateCamera_px": round(float(error), 4),
        "focal_lengths_apart_percent": round(100 * float(np.abs(ours / theirs - 1).max()), 3),
        "showing_the_whole_grid": len(import_views(calibration).views),
    }


def rooms_against_truth(images: int, seed: int, kept: Path | None = None) -> dict[str, Any]:
    """Errors of lenses, poses and lamps of the six rooms, photographed where none are kept."""
    with tempfile.TemporaryDirectory() as folder:
        places = photograph_rooms(kept or Path(folder), images, seed=seed)
        calibration = calibrate([find_boards(place, BOARD) for place in places], BOARD)
        return {
            "photographs_taken": images * len(places),
            "mean_reprojection_error_px": round(calibration.mean_error, 4),
            **{name: round(x, 4) for name, x in room_errors(calibration).as_json().items()},
            "views": len(import_views(calibration, only=chosen_views()).views),
            "lamps": lamps_against_truth(
                {
                    environment.environment.name: lamp_rays_in(calibration, environment)
                    for environment in calibration.environments
                }
            ),
        }


def lamps_against_truth(rays: dict[str, Float[np.ndarray, "k 3"]]) -> dict[str, Any]:
    """How far the rays found in rooms (pattern's frame) are from the true ones, in degrees.

    A lamp that is not found has no error; one that is not there counts with its angle to the true.
    """
    turn = PLACEMENT.pattern_from_board(BOARD)[:3, :3]
    errors = {
        name: [
            round(angle(ray, turn @ true), 1)
            for ray, true in zip(
                found, (ROOM[name].light_direction, WINDOW_DIRECTION), strict=False
            )
        ]
        for name, found in rays.items()
    }
    found: dict[str, Any] = {"errors_degrees": errors}
    for index, lamp in enumerate(("main_lamp", "second_lamp")):
        known = [each[index] for each in errors.values() if len(each) > index]
        found[lamp] = {"rooms": len(known)}
        if known:
            found[lamp] |= {"mean": round(float(np.mean(known)), 1), "largest": max(known)}
    return found


def other_rooms(images: int, seed: int) -> dict[str, Any]:
    """Errors of lamps in rooms with other surfaces and lamps, where every pose is exact."""
    return {
        name: lamps_against_truth(
            {room.name: _rays(replace(room, **changes), images, seed) for room in ROOMS[3:]}
        )
        for name, changes in OTHER_ROOMS.items()
    }


def _rays(room: Room, images: int, seed: int) -> Float[np.ndarray, "k 3"]:
    photographer = RoomPhotographer(room, seed=seed)
    lens, glints = photographer.lens, []
    for name in photograph_names(room, images):
        pose = photograph_pose(room, name, lens.size, seed)
        pattern_pose = pose @ invert(PLACEMENT.pattern_from_board(BOARD))
        corners = lens.project(apply(pattern_pose, BOARD.points))
        if corners.min() < 0 or (corners > np.array(lens.size) - 1).any():
            continue
        image = photographer.take(pose, generator(seed, "sensor noise", room.name, name))
        glints.append(glints_in(image, corners, BOARD, pattern_pose))
    photographer.close()
    return lamp_rays([each for each in glints if each is not None])


def angle(first: Float[np.ndarray, "3"], second: Float[np.ndarray, "3"]) -> float:
    """Between two directions of any length, in degrees."""
    cosine = first @ second / (np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def lamp_error(view: EnvironmentalView, ray: np.ndarray) -> dict[str, float]:
    """How far the estimated lamp is from the true one.

    Args:
        view: With the lamp's light on its board.
        ray: The lamp's direction of shining, in the view's own grid.
    """
    found = estimate_light(view).light_direction
    found, true = found / np.linalg.norm(found), ray / np.linalg.norm(ray)
    sides = [np.arctan2(each[1], each[0]) for each in (found, true)]
    turn = (sides[0] - sides[1] + np.pi) % (2 * np.pi) - np.pi
    return {
        "side_degrees": abs(float(np.degrees(turn))),
        "height_degrees": abs(float(np.degrees(np.arcsin(-found[2]) - np.arcsin(-true[2])))),
        "angle_degrees": angle(found, true),
    }


def turned(ray: np.ndarray, quarter_turns: int) -> np.ndarray:
    """A direction of the rooms' grid in that of a view, whose x points away from its camera."""
    turn = GridPlacement(quarter_turns=quarter_turns).pattern_from_board(BOARD)
    return (invert(turn) @ PLACEMENT.pattern_from_board(BOARD))[:3, :3] @ ray


def errors_in(views: Sequence[EnvironmentalView]) -> list[dict[str, float]]:
    """Errors in the views of rooms: lamps far away."""
    found = []
    truth = {room: _poses(ROOM[room]) for room in ROOM}
    for view in views:
        pose = truth[view.environment][view.name.removeprefix(f"{view.environment}-")]
        ray = ROOM[view.environment].light_direction
        found.append(lamp_error(view, turned(ray, facing(pose))))
    return found


def _poses(room: Room) -> dict[str, np.ndarray]:
    return {
        name: photograph_pose(room, name, (960, 540), 0)
        for name in photograph_names(room, 10)
        if not name.isdecimal()
    }


def near_lamps(count: int, seed: int) -> list[dict[str, float]]:
    """Errors with a lamp half a metre from the grid's middle, on the white and the black table."""
    found = []
    for index in range(count):
        rng = generator(seed, "lamp", index)
        side, height = 2 * np.pi * index / count, np.deg2rad(rng.uniform(35, 65))
        out = np.array(
            [np.cos(height) * np.cos(side), np.cos(height) * np.sin(side), np.sin(height)]
        )
        room = Room(
            name=f"lamp-{index}",
            table="round-white" if index % 2 else "rectangular-black",
            lighting="dim",
            distractors=False,
            focus=1.0,
            lamp=tuple(out),
            lamp_distance=0.5,
        )
        photographer = RoomPhotographer(room)
        pose = next(view_poses(room, photographer.lens.size, rng))
        image = photographer.lens.undistort(photographer.take(pose, rng), photographer.lens.matrix)
        photographer.close()
        quarter = facing(pose)
        placed = GridPlacement(quarter_turns=quarter).pattern_from_board(BOARD)
        view = EnvironmentalView(
            name=room.name,
            environment=room.name,
            part="train",
            image=image,
            matrix=photographer.lens.matrix,
            camera_from_board=pose @ invert(PLACEMENT.pattern_from_board(BOARD)) @ placed,
        )
        found.append(lamp_error(view, turned(room.light_direction, quarter)))
    return found


def summary(errors: list[dict[str, float]]) -> dict[str, Any]:
    """Mean and largest of each error."""
    return {
        "views": len(errors),
        **{
            name: {
                "mean": round(float(np.mean([each[name] for each in errors])), 1),
                "largest": round(max(each[name] for each in errors), 1),
            }
            for name in errors[0]
        },
    }


def measure(config: Config) -> dict[str, Any]:
    """All of it, and what it was measured with."""
    begun = time.perf_counter()
    real = photographs_against_opencv(config.photographs) if config.photographs else None
    views = load_views("rooms")
    alone = [replace(view, light_directions=NO_LAMPS) for view in views]
    images, others, seed = config.images, config.others, config.seed
    return {
        "photographs": real,
        "rooms": rooms_against_truth(images, seed, config.rooms) if images else None,
        "lamps_of_other_rooms": other_rooms(others, seed) if others else None,
        "light_of_rooms": summary(errors_in(views)),
        "light_of_rooms_by_one_picture": summary(errors_in(alone)),
        "light_of_near_lamps": summary(near_lamps(config.lamps, config.seed)),
        "command": "python benchmarks/views.py --photographs FOLDER "
        f"--images {images} --others {others} --seed {seed}",
        "seed": seed,
        "duration_seconds": round(time.perf_counter() - begun, 1),
        **provenance(),
    }


if __name__ == "__main__":
    print(json.dumps(measure(tyro.cli(Config)), indent=1))
