"""A calibration made before, used for later photographs of the same camera.

A lens is calibrated once with many photographs; a new arrangement of table and light then needs
only the photographs that become views, even a single one.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from fusionnet.errors import DataError, InputError
from fusionnet.geometry.fisheye import FisheyeLens
from fusionnet.views.calibration import CalibratedEnvironment, Calibration, check_names
from fusionnet.views.calibration_report import CALIBRATION_FILE, KIND, SCHEMA_VERSION
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.photographs import Environment, Photograph
from fusionnet.views.pose import estimate_pose

MOST_BYTES = 20 * 2**20


@dataclass(frozen=True, eq=False)
class KnownCalibration:
    """The lenses of a calibration and its one pinhole camera.

    Attributes:
        file: Where it was read.
        matrix: Of the pinhole camera that undistorted pictures come from, in pixels.
        undistorted_to: The matrix to which pictures are undistorted, in pixels.
        lenses: By the names of environments.
        orientations: How EXIF turned the photographs of each lens, where that is known.
    """

    file: Path
    matrix: Float[np.ndarray, "3 3"]
    undistorted_to: Float[np.ndarray, "3 3"]
    lenses: dict[str, FisheyeLens]
    orientations: dict[str, int | None]

    def applied(self, environments: Sequence[Environment], board: Checkerboard) -> Calibration:
        """The calibration of other photographs that these lenses took.

        An environment takes the lens of its own name; if only one lens is known, all take it.

        Args:
            environments: With the corners that were found.
            board: That was looked for.

        Raises:
            InputError: If two environments have one name, an environment's lens is not known, its
                pictures have another size or were turned otherwise, or the lens explains none of
                them.
        """
        check_names(environments)
        used = [self._environment(environment, board) for environment in environments]
        names = {photograph.name for each in used for photograph in each.used}
        left_out = tuple(
            photograph if photograph.reason else _unexplained(photograph, self.file)
            for environment in environments
            for photograph in environment.photographs
            if photograph.name not in names
        )
        return Calibration(board, tuple(used), self.matrix, self.undistorted_to, left_out)

    def _environment(self, environment: Environment, board: Checkerboard) -> CalibratedEnvironment:
        lens = self._lens(environment)
        used, fisheye, pinhole = [], [], []
        for photograph in environment.usable:
            try:
                errors = self._errors(photograph, lens, board)
            except InputError:
                continue
            used.append(photograph)
            fisheye.append(errors[0])
            pinhole.append(errors[1])
        if not used:
            raise InputError(
                f"The calibration {self.file} explains none of the photographs of "
                f"{environment.name}: it is another camera's or another board's."
            )
        return CalibratedEnvironment(
            environment, lens, tuple(used), np.array(fisheye), np.array(pinhole)
        )

    def _lens(self, environment: Environment) -> FisheyeLens:
        only = next(iter(self.lenses)) if len(self.lenses) == 1 else None
        name = environment.name if environment.name in self.lenses else only
        if name is None:
            raise InputError(
                f"The calibration {self.file} knows no environment {environment.name!r}; its own "
                f"are {', '.join(sorted(self.lenses))}. Call the folder by the one whose focus "
                "the photographs share."
            )
        lens, orientation = self.lenses[name], self.orientations[name]
        if orientation not in (None, environment.orientation):
            raise InputError(
                f"The camera was held otherwise for the photographs of {environment.name} (EXIF "
                f"orientation {environment.orientation}) than for those of the calibration "
                f"{self.file} ({orientation}). Hold it as then, or calibrate it as it is held now."
            )
        if lens.size != environment.size:
            raise InputError(
                "The photographs of {} have {} x {} pixels, those of the calibration {} {} x {}; "
                "take them at the same resolution.".format(
                    environment.name, *environment.size, self.file, *lens.size
                )
            )
        return lens

    def _errors(
        self, photograph: Photograph, lens: FisheyeLens, board: Checkerboard
    ) -> tuple[float, float]:
        """Root mean square errors of the corners, bent and undistorted (pixels)."""
        assert photograph.corners is not None
        target = self.undistorted_to
        pixels = lens.slopes(photograph.corners) * target[[0, 1], [0, 1]] + target[:2, 2]
        pose = estimate_pose(pixels, board, self.matrix)
        turn, shift = cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3]
        straight, _ = cv2.projectPoints(board.points, turn, shift, self.matrix, None)
        # The bent picture, through the same undistortion backwards.
        slopes = (straight.reshape(-1, 2) - target[:2, 2]) / target[[0, 1], [0, 1]]
        bent = lens.project(np.column_stack([slopes, np.ones(len(slopes))]))
        pairs = ((bent, photograph.corners), (straight.reshape(-1, 2), pixels))
        first, second = (float(np.sqrt(((a - b) ** 2).sum(axis=1).mean())) for a, b in pairs)
        return first, second


def load_calibration(source: Path) -> KnownCalibration:
    """The calibration in a folder that `fusionnet views calibrate` or `import` wrote, or its file.

    Raises:
        InputError: If there is none.
        DataError: If it is damaged or of another version.
    """
    file = source / CALIBRATION_FILE if source.is_dir() else source
    if not file.is_file():
        raise InputError(
            f"There is no calibration {file}; `fusionnet views calibrate FOLDER...` makes one."
        )
    if file.stat().st_size > MOST_BYTES:
        raise DataError(f"{file} has more than {MOST_BYTES // 2**20} MiB.")
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{file} is damaged, it is not JSON: {error}.") from error
    if not isinstance(document, dict) or document.get("kind") != KIND:
        raise DataError(f"{file} does not describe a calibration (its kind is not {KIND!r}).")
    if document.get("schema_version") != SCHEMA_VERSION:
        raise DataError(
            f"{file} has schema version {document.get('schema_version')!r}; this release reads "
            f"version {SCHEMA_VERSION}. Calibrate again."
        )
    try:
        width, height = (int(side) for side in document["size"])
        lenses = {
            str(name): FisheyeLens(
                width,
                height,
                _numbers(lens["fisheye_matrix"], (3, 3)),
                _numbers(lens["fisheye_coefficients"], (4,)),
            )
            for name, lens in document["environments"].items()
        }
        orientations = {
            str(name): lens.get("orientation") for name, lens in document["environments"].items()
        }
        matrix = _numbers(document["matrix"], (3, 3))
        undistorted_to = _numbers(document["undistorted_to"], (3, 3))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"{file} is damaged: {error}. Calibrate again.") from error
    if not lenses:
        raise DataError(f"{file} holds no environment. Calibrate again.")
    return KnownCalibration(file, matrix, undistorted_to, lenses, orientations)


def _numbers(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    numbers = np.array(value, dtype=float)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"expected {' x '.join(map(str, shape))} numbers, found {value!r:.60}")
    return numbers


def _unexplained(photograph: Photograph, file: Path) -> Photograph:
    return replace(photograph, corners=None, reason=f"the lens of {file} does not explain it")
