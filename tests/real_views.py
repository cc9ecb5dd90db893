"""The real photographs of a checkerboard as environmental views, for tests of overlays."""

from pathlib import Path

import cv2
import numpy as np

from fusionnet.blocks.grid import BLOCK_SIZE
from fusionnet.geometry import transform
from fusionnet.views.view import EnvironmentalView

CORNERS = (9, 6)


def real_view(folder: Path, name: str) -> EnvironmentalView:
    """A photograph, undistorted by OpenCV's own calibration, its grid on the board's squares.

    The scale of one photograph is free: the squares, in truth 2.5 cm, are taken to be as
    large as blocks, so that cells and squares coincide. The grid begins one square in
    from the board's long side's end.
    """
    file = cv2.FileStorage(str(folder / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    matrix = file.getNode("camera_matrix").mat()
    distortion = file.getNode("distortion_coefficients").mat()
    file.release()
    grey = cv2.imread(str(folder / f"{name}.jpg"), cv2.IMREAD_GRAYSCALE)
    grey = cv2.undistort(grey, matrix, distortion)
    found, corners = cv2.findChessboardCorners(grey, CORNERS)
    assert found
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
    corners = cv2.cornerSubPix(grey, corners, (7, 7), (-1, -1), criteria)
    columns, rows = np.meshgrid(np.arange(CORNERS[0]), np.arange(CORNERS[1]))
    # The pattern's z axis points into the board; the grid's points out of it.
    points = np.column_stack([rows.ravel(), columns.ravel(), np.zeros(rows.size)]) * BLOCK_SIZE
    found, rotation, translation = cv2.solvePnP(points, corners, matrix, None)
    assert found
    camera_from_pattern = transform(cv2.Rodrigues(rotation)[0], translation.ravel())
    pattern_from_board = transform(translation=(-BLOCK_SIZE, 0.0, 0.0))
    return EnvironmentalView(
        name=name,
        environment="office",
        part="train",
        image=cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB),
        matrix=matrix,
        camera_from_board=camera_from_pattern @ pattern_from_board,
    )
