"""From calibrated photographs to environmental views (thesis 3.2.3, figure 3.4)."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import BLOCK_SIZE
from fusionnet.errors import InputError
from fusionnet.geometry import invert
from fusionnet.views.calibration import CalibratedEnvironment, Calibration
from fusionnet.views.glints import NO_LAMPS, glints_in, lamp_rays
from fusionnet.views.photographs import Photograph
from fusionnet.views.picture_file import read_picture
from fusionnet.views.pose import (
    GridPlacement,
    estimate_pose,
    facing,
    grid_pose,
    place_deviation,
)
from fusionnet.views.view import EnvironmentalView, check_view
from fusionnet.views.view_files import names_for

MOST_UNCERTAIN = 0.0005
"""Standard deviation (metres) of a camera's place up to which its photograph becomes a view: 19
times of 20 the place then is right to a millimetre."""


@dataclass(frozen=True, eq=False)
class ImportedViews:
    """Views, and what could not become one.

    Attributes:
        views: All from which the whole grid is in the picture.
        left_out: The other photographs, with the reason.
    """

    views: tuple[EnvironmentalView, ...]
    left_out: tuple[Photograph, ...]


def pose_in(
    calibration: Calibration,
    environment: CalibratedEnvironment,
    photograph: Photograph,
    placement: GridPlacement | None = None,
) -> Float[np.ndarray, "4 4"]:
    """`camera_from_board` of a photograph.

    Args:
        calibration: Whose matrix undistorted pictures have.
        environment: Whose lens took it.
        photograph: One in which the board was found.
        placement: Of the grid on the board; by default turned so that x points away from the
            camera, as a robot standing there would name the cells.

    Raises:
        InputError: If no pose explains the corners.
    """
    pixels = _undistorted_corners(calibration, environment, photograph)
    if placement is not None:
        return grid_pose(pixels, calibration.board, calibration.matrix, placement)
    pose = grid_pose(pixels, calibration.board, calibration.matrix)
    turned = GridPlacement(quarter_turns=facing(pose))
    return grid_pose(pixels, calibration.board, calibration.matrix, turned)


def deviation_in(
    calibration: Calibration, environment: CalibratedEnvironment, photograph: Photograph
) -> float:
    """Standard deviation of where the camera of a photograph stands, in metres.

    A square counts as large as a block, as in views.

    Raises:
        InputError: If no pose explains the corners.
    """
    pixels = _undistorted_corners(calibration, environment, photograph)
    board = replace(calibration.board, square=BLOCK_SIZE)
    pose = estimate_pose(pixels, board, calibration.matrix)
    return place_deviation(pixels, board, calibration.matrix, pose)


def lamp_rays_in(
    calibration: Calibration, environment: CalibratedEnvironment
) -> Float[np.ndarray, "k 3"]:
    """The rays of the lamps that the glints in an environment's photographs tell of.

    Returns:
        As `lamp_rays`, in the pattern's frame; none for a board whose ends look alike.

    Raises:
        InputError: If a photograph cannot be read any more, or no pose explains its corners.
    """
    if not calibration.board.oriented:
        return NO_LAMPS
    glints = []
    for photograph in environment.used:
        assert photograph.corners is not None
        pose = _pattern_pose(calibration, environment, photograph)
        picture = read_picture(photograph.file)
        seen = glints_in(picture, photograph.corners, calibration.board, pose)
        glints += [] if seen is None else [seen]
    return lamp_rays(glints)


def _pattern_pose(
    calibration: Calibration, environment: CalibratedEnvironment, photograph: Photograph
) -> Float[np.ndarray, "4 4"]:
    pixels = _undistorted_corners(calibration, environment, photograph)
    return estimate_pose(pixels, calibration.board, calibration.matrix)


def _undistorted_corners(
    calibration: Calibration, environment: CalibratedEnvironment, photograph: Photograph
) -> Float[np.ndarray, "n 2"]:
    assert photograph.corners is not None
    target = calibration.undistorted_to
    slopes = environment.lens.slopes(photograph.corners)
    return slopes * target[[0, 1], [0, 1]] + target[:2, 2]


def view_of(
    calibration: Calibration,
    environment: CalibratedEnvironment,
    photograph: Photograph,
    rays: Float[np.ndarray, "k 3"] = NO_LAMPS,
) -> EnvironmentalView:
    """A photograph as the calibration's one pinhole camera would have taken it, for training.

    The whole grid need not be in the picture.

    Args:
        calibration: Of all environments.
        environment: Whose lens took it.
        photograph: One in which the board was found.
        rays: Of the environment's lamps, in the pattern's frame, as `lamp_rays_in` finds them.

    Raises:
        InputError: If it cannot be read, or no pose explains its corners.
    """
    picture = read_picture(photograph.file)
    pose = pose_in(calibration, environment, photograph)
    pattern_pose = _pattern_pose(calibration, environment, photograph)
    board_from_pattern = np.rint(pose[:3, :3].T @ pattern_pose[:3, :3])
    return EnvironmentalView(
        name=f"{photograph.environment}-{photograph.file.stem}",
        environment=photograph.environment,
        part="train",
        image=environment.lens.undistort(picture, calibration.undistorted_to),
        matrix=calibration.matrix,
        camera_from_board=pose,
        light_directions=rays @ board_from_pattern.T,
    )


def import_views(
    calibration: Calibration,
    only: Collection[str] | None = None,
    most_uncertain: float = MOST_UNCERTAIN,
) -> ImportedViews:
    """Make a view of every calibrated photograph from which the whole grid can be seen.

    Args:
        calibration: Of all environments.
        only: Names (`environment/file`) of the photographs to take; all if left out.
        most_uncertain: Greatest standard deviation of the camera's place, in metres, if a square
            is as large as a block.

    Returns:
        Views for training, called by their folder and file; `set_aside` makes some validate.
    """
    views, left_out = [], list(calibration.left_out)
    for environment in calibration.environments:
        wanted = [p for p in environment.used if only is None or p.name in only]
        rays = lamp_rays_in(calibration, environment) if wanted else NO_LAMPS
        for photograph in wanted:
            try:
                view = view_of(calibration, environment, photograph, rays)
                check_view(view)
                _check_certain(deviation_in(calibration, environment, photograph), most_uncertain)
            except InputError as error:
                left_out.append(replace(photograph, reason=str(error)))
            else:
                views.append(view)
    names = names_for([view.name for view in views])
    named = [replace(view, name=name) for view, name in zip(views, names, strict=True)]
    return ImportedViews(tuple(named), tuple(left_out))


def _check_certain(deviation: float, most: float) -> None:
    if deviation > most:
        raise InputError(
            f"Its corners tell where the camera stands to {1000 * deviation:.1f} mm only "
            f"(standard deviation; at most {1000 * most:.1f} is used). Take it nearer, sharper or "
            "more from above, or allow more (--uncertain)."
        )


def choose(views: tuple[EnvironmentalView, ...], count: int) -> tuple[EnvironmentalView, ...]:
    """The views whose cameras stand farthest apart, in their first order.

    Each next one is the farthest from all chosen before, environments in turn as far as they go.

    Raises:
        InputError: If fewer than one is asked for.
    """
    if count < 1:
        raise InputError(f"At least one view has to be kept; received {count}.")
    if count >= len(views):
        return views
    places = np.array([invert(view.camera_from_board)[:3, 3] for view in views])
    chosen = [0]
    while len(chosen) < count:
        apart = np.linalg.norm(places[:, None] - places[chosen], axis=-1).min(axis=1)
        used = [views[index].environment for index in chosen]
        rarity = np.array([used.count(view.environment) for view in views])
        free = np.setdiff1d(np.arange(len(views)), chosen)
        apart[rarity > rarity[free].min()] -= 1e3
        apart[chosen] = -np.inf
        chosen.append(int(np.argmax(apart)))
    return tuple(views[index] for index in sorted(chosen))


def set_aside(views: tuple[EnvironmentalView, ...], count: int) -> tuple[EnvironmentalView, ...]:
    """Let the last `count` of the views, environments in turn, validate instead of train.

    Raises:
        InputError: If nothing would be left to train with.
    """
    if not 0 <= count < len(views):
        raise InputError(
            f"{count} of {len(views)} views cannot be kept for validation; at least one must be "
            "left for training. Keep fewer, or take more photographs."
        )
    waiting: dict[str, list[int]] = {}
    for index, view in enumerate(views):
        waiting.setdefault(view.environment, []).append(index)
    kept: set[int] = set()
    while len(kept) < count:
        for indices in waiting.values():
            if indices and len(kept) < count:
                kept.add(indices.pop())
    return tuple(
        replace(view, part="val") if index in kept else view for index, view in enumerate(views)
    )
