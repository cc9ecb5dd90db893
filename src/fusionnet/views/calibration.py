"""From photographs of a checkerboard to cameras, in the two stages of thesis 3.2.2.

First every environment gets its own fisheye lens, because its focus is its own. With it all of
its photographs are undistorted. Then one pinhole camera is calibrated over the undistorted
photographs of all environments together.

One thing is ours: every environment is undistorted to the same pinhole matrix, the mean of the
lenses'. If each kept its own, pictures with different focal lengths would meet in the second
stage, which can only answer with their mean; so it has one true answer, and finds it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from fusionnet.errors import InputError
from fusionnet.geometry.fisheye import FisheyeLens
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.photographs import Environment, Photograph

_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-8)
_FLAGS = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2
"""Where the flags of the fisheye calibration stand: they moved with OpenCV 5."""

_FISHEYE = (
    _FLAGS.CALIB_RECOMPUTE_EXTRINSIC
    + _FLAGS.CALIB_FIX_SKEW
    + _FLAGS.CALIB_CHECK_COND
    + _FLAGS.CALIB_USE_INTRINSIC_GUESS
)
_UNDISTORTED = cv2.CALIB_ZERO_TANGENT_DIST + cv2.CALIB_FIX_K1 + cv2.CALIB_FIX_K2 + cv2.CALIB_FIX_K3


WRONG = 1.0
"""Reprojection error (pixels) up to which no photograph is taken for a wrongly found board."""


@dataclass(frozen=True, eq=False)
class CalibratedEnvironment:
    """What the first stage found for one environment.

    Attributes:
        environment: Its photographs.
        lens: Its fisheye lens.
        used: The photographs that it was calibrated with.
        fisheye_errors: Root mean square distance of corners from where the lens puts them, for
            each used photograph, in pixels.
        pinhole_errors: The same in the second stage, in undistorted pictures.
    """

    environment: Environment
    lens: FisheyeLens
    used: tuple[Photograph, ...]
    fisheye_errors: Float[np.ndarray, " n"]
    pinhole_errors: Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class Calibration:
    """Cameras of all environments.

    Attributes:
        board: That was seen.
        environments: In the order given.
        matrix: Of the one pinhole camera that undistorted pictures come from, in pixels.
        undistorted_to: The matrix to which pictures were undistorted; `matrix` is what the second
            stage finds in the result, and what poses are estimated with.
        left_out: Photographs that could not be used, with the reason.
    """

    board: Checkerboard
    environments: tuple[CalibratedEnvironment, ...]
    matrix: Float[np.ndarray, "3 3"]
    undistorted_to: Float[np.ndarray, "3 3"]
    left_out: tuple[Photograph, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all pictures, in pixels."""
        return self.environments[0].environment.size

    @property
    def mean_error(self) -> float:
        """Mean over photographs of the second stage's error, in pixels."""
        return float(np.concatenate([e.pinhole_errors for e in self.environments]).mean())


def calibrate(environments: Sequence[Environment], board: Checkerboard) -> Calibration:
    """Calibrate all environments' lenses, then one camera over all (thesis 3.2.2).

    Raises:
        InputError: If pictures of environments differ in size, two environments have one name,
            or an environment's photographs do not determine a lens; the message says which.
    """
    if not environments:
        raise InputError("There are no photographs; name at least one folder.")
    _check(environments)
    stages = [_fisheye(environment, board) for environment in environments]
    target = np.mean([lens.matrix for lens, _, _ in stages], axis=0)
    undistorted = [_undistorted(lens, used, target) for lens, used, _ in stages]
    every = [corners for group in undistorted for corners in group]
    matrix, errors = _pinhole(every, board, environments[0].size, target)
    cuts = np.cumsum([len(group) for group in undistorted])[:-1]
    calibrated = [
        CalibratedEnvironment(environment, lens, tuple(used), fisheye, pinhole)
        for environment, (lens, used, fisheye), pinhole in zip(
            environments, stages, np.split(errors, cuts), strict=True
        )
    ]
    used_names = {photograph.name for _, used, _ in stages for photograph in used}
    left_out = [
        photograph if photograph.reason else _rejected(photograph)
        for environment in environments
        for photograph in environment.photographs
        if photograph.name not in used_names
    ]
    return Calibration(board, tuple(calibrated), matrix, target, tuple(left_out))


def check_names(environments: Sequence[Environment]) -> None:
    """Accept environments that can be told apart.

    Raises:
        InputError: If two have one name.
    """
    names = [environment.name for environment in environments]
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise InputError(f"Several folders are called {double[0]!r}; each needs its own name.")


def _check(environments: Sequence[Environment]) -> None:
    check_names(environments)
    first = environments[0]
    for environment in environments[1:]:
        if environment.size != first.size:
            raise InputError(
                f"The photographs of {environment.name} have {environment.size[0]} x "
                f"{environment.size[1]} pixels, those of {first.name} {first.size[0]} x "
                f"{first.size[1]}; one camera at one resolution is calibrated over all. "
                "Calibrate them one by one."
            )


def _rejected(photograph: Photograph) -> Photograph:
    reason = "its corners fit no fisheye lens (wrongly found, too slanted or too near the edge)"
    return Photograph(photograph.file, photograph.environment, photograph.corners, reason)


def _fisheye(
    environment: Environment, board: Checkerboard
) -> tuple[FisheyeLens, list[Photograph], np.ndarray]:
    """Stage one: a lens, the photographs it rests on, and their errors (pixels).

    OpenCV refuses photographs whose extrinsics are ill conditioned and names the first; it is
    left out and the rest calibrated again. So is a photograph that fits much worse than the
    others: one board that was found wrongly would bend the lens of all.
    """
    used = environment.usable
    width, height = environment.size
    points = board.points[None]
    guess = _first_guess(used, board, environment.size)
    while len(used) >= 3:
        corners = [np.ascontiguousarray(p.corners, dtype=float)[None] for p in used]
        try:
            _, matrix, coefficients, turns, shifts = cv2.fisheye.calibrate(
                [points] * len(used),
                corners,
                environment.size,
                guess.copy(),
                np.zeros((4, 1)),
                flags=_FISHEYE,
                criteria=_STOP,
            )
        except cv2.error as error:
            named = re.search(r"input array (\d+)", str(error))
            used = [p for i, p in enumerate(used) if i != (int(named[1]) if named else 0)]
            continue
        lens = FisheyeLens(width, height, matrix, coefficients.ravel())
        errors = [
            _distance(
                cv2.fisheye.projectPoints(
                    points, turn.reshape(3, 1), shift.reshape(3, 1), matrix, coefficients
                )[0],
                seen,
            )
            for turn, shift, seen in zip(turns, shifts, corners, strict=True)
        ]
        worst = int(np.argmax(errors))
        if errors[worst] <= max(WRONG, 5 * float(np.median(errors))):
            return lens, used, np.array(errors)
        used = used[:worst] + used[worst + 1 :]
    raise InputError(
        f"The photographs of {environment.name} do not determine a fisheye lens; take at least "
        "three, better 20 to 60, with the board tilted, near and far, and in every corner."
    )


def _first_guess(
    used: list[Photograph], board: Checkerboard, size: tuple[int, int]
) -> Float[np.ndarray, "3 3"]:
    """A pinhole calibration with radial distortion: near enough for the fisheye's to converge."""
    seen = [np.asarray(p.corners, np.float32)[:, None] for p in used]
    points = [board.points.astype(np.float32)] * len(used)
    flags = cv2.CALIB_ZERO_TANGENT_DIST + cv2.CALIB_FIX_K3 + cv2.CALIB_FIX_ASPECT_RATIO
    start = np.array(
        [[size[0], 0.0, (size[0] - 1) / 2], [0.0, size[0], (size[1] - 1) / 2], [0, 0, 1]]
    )
    _, matrix, *_ = cv2.calibrateCamera(
        points, seen, size, start, None, flags=flags + cv2.CALIB_USE_INTRINSIC_GUESS
    )
    return matrix


def _undistorted(
    lens: FisheyeLens, used: list[Photograph], matrix: Float[np.ndarray, "3 3"]
) -> list[Float[np.ndarray, "n 2"]]:
    """Where the corners lie in undistorted pictures.

    The corners are mapped, not looked for again: undistortion interpolates, which would cost
    them a tenth of a pixel.
    """
    focal, center = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    return [lens.slopes(p.corners) * focal + center for p in used if p.corners is not None]


def _pinhole(
    corners: list[Float[np.ndarray, "n 2"]],
    board: Checkerboard,
    size: tuple[int, int],
    start: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " m"]]:
    """Stage two: one camera without distortion, and the error of each photograph (pixels)."""
    points = board.points.astype(np.float32)
    seen = [c.astype(np.float32)[:, None] for c in corners]
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        [points] * len(seen),
        seen,
        size,
        start.copy(),
        np.zeros(5),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS + _UNDISTORTED,
        criteria=_STOP,
    )
    errors = [
        _distance(cv2.projectPoints(points, turn, shift, matrix, distortion)[0], each)
        for turn, shift, each in zip(turns, shifts, seen, strict=True)
    ]
    return matrix, np.array(errors)


def _distance(first: np.ndarray, second: np.ndarray) -> float:
    """Root mean square distance between points (pixels)."""
    apart = first.reshape(-1, 2) - second.reshape(-1, 2)
    return float(np.sqrt((apart**2).sum(axis=1).mean()))
