"""Where a board is, and the grid of cells on it (thesis 3.2.3)."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks.grid import BLOCK_SIZE, GRID
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera, invert, transform
from fusionnet.views.checkerboard import Checkerboard

INLIER = 2.0
"""Distance (pixels) up to which a corner agrees with a pose."""

MESH_COLOR = (255, 60, 40)


@dataclass(frozen=True)
class GridPlacement:
    """Where the 8x8 grid of cells lies on a checkerboard whose squares are blocks' sizes.

    Attributes:
        along: Squares from the board's outer corner to the grid, along its long side.
        across: The same along its short side. With the thesis's seven rows the last row of
            cells reaches one square beyond the board.
        quarter_turns: Of the grid about its own middle, counted from above.
    """

    along: int = 1
    across: int = 0
    quarter_turns: int = 0

    def pattern_from_board(self, board: Checkerboard) -> Float[np.ndarray, "4 4"]:
        """From the grid's frame (z up) to the pattern's (first inner corner, z into the board).

        The pattern's squares count as one block each, whatever they measure: lengths are in the
        pattern's metres only if its squares are of a block's size.
        """
        half = GRID * BLOCK_SIZE / 2
        middle = (
            (self.along - 1) * BLOCK_SIZE + half,
            (self.across - 1) * BLOCK_SIZE + half,
            0.0,
        )
        # x of the grid along the rows, y along the columns, z out of the board.
        swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
        angle = np.pi / 2 * (self.quarter_turns % 4)
        cosine, sine = np.rint([np.cos(angle), np.sin(angle)])
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return (
            transform(translation=middle)
            @ transform(swap @ turn)
            @ transform(translation=(-half, -half, 0.0))
        )


def estimate_pose(
    corners: Float[np.ndarray, "n 2"], board: Checkerboard, matrix: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "4 4"]:
    """`camera_from_pattern` by RANSAC over perspective-n-point, then all inliers.

    Args:
        corners: Of the board in an undistorted picture, in pixels, in the order of its points.
        board: The board; its points fix the scale.
        matrix: Of the pinhole camera, in pixels.

    Raises:
        InputError: If no pose explains the corners.

    References:
        Fischler and Bolles (1981); OpenCV's solvePnPRansac and solvePnP.
    """
    points = board.points
    pixels = np.ascontiguousarray(corners, dtype=float)
    found, _, _, inliers = cv2.solvePnPRansac(
        points,
        pixels,
        matrix,
        None,
        iterationsCount=1000,
        reprojectionError=INLIER,
        confidence=0.9999,
        flags=cv2.SOLVEPNP_AP3P,  # the default (EPnP) finds no pose of many flat boards
    )
    if not found or inliers is None or len(inliers) < len(points) // 2:
        raise InputError("No pose of the board explains where its corners are seen.")
    chosen = inliers.ravel()
    # From the inliers anew: OpenCV 5.0 returns the mirrored pose of many flat boards here.
    _, turn, shift = cv2.solvePnP(points[chosen], pixels[chosen], matrix, None)
    return transform(cv2.Rodrigues(turn)[0], shift.ravel())


def grid_pose(
    corners: Float[np.ndarray, "n 2"],
    board: Checkerboard,
    matrix: Float[np.ndarray, "3 3"],
    placement: GridPlacement | None = None,
) -> Float[np.ndarray, "4 4"]:
    """`camera_from_board`, the pose of the 8x8x8 grid, with a square as large as a block.

    Raises:
        InputError: As `estimate_pose`.
    """
    scaled = Checkerboard(board.columns, board.rows, BLOCK_SIZE)
    placement = placement or GridPlacement()
    return estimate_pose(corners, scaled, matrix) @ placement.pattern_from_board(scaled)


def place_deviation(
    corners: Float[np.ndarray, "n 2"],
    board: Checkerboard,
    matrix: Float[np.ndarray, "3 3"],
    camera_from_pattern: Float[np.ndarray, "4 4"],
) -> float:
    """Standard deviation of the camera's place (metres), from how far its corners are off.

    Args:
        corners: Of the board in an undistorted picture, in pixels, in the order of its points.
        board: The board; its points fix the scale.
        matrix: Of the pinhole camera, in pixels.
        camera_from_pattern: The pose that explains them best.

    References:
        Hartley and Zisserman (2004), Multiple view geometry, section 5.2: the covariance of a
        least-squares estimate, carried on to the camera's centre.
    """
    rotation, shift = camera_from_pattern[:3, :3], camera_from_pattern[:3, 3]
    turn = cv2.Rodrigues(rotation)[0]
    seen, slopes = cv2.projectPoints(board.points, turn, shift, matrix, None)
    slopes = slopes[:, :6]  # of a rotation vector and a translation
    noise = ((seen.reshape(-1, 2) - corners) ** 2).sum() / (len(slopes) - 6)
    # The centre is -R't: how it moves with the rotation vector (OpenCV gives dR, row by row).
    by_turn = -np.einsum("kij,i->jk", cv2.Rodrigues(turn)[1].reshape(3, 3, 3), shift)
    to_center = np.hstack([by_turn, -rotation.T])
    covariance = to_center @ np.linalg.pinv(slopes.T @ slopes) @ to_center.T
    return float(np.sqrt(noise * np.trace(covariance)))


def facing(camera_from_board: Float[np.ndarray, "4 4"]) -> int:
    """Quarter turns that bring the grid's x axis to point away from the camera.

    Cells then are named as a robot at the camera's place would name them: x 0 is nearest.
    """
    position = invert(camera_from_board)[:2, 3] - GRID * BLOCK_SIZE / 2
    # The camera should stand towards -x of the grid.
    return int(np.rint((np.arctan2(position[1], position[0]) - np.pi) / (np.pi / 2))) % 4


def draw_region(
    image: UInt8[np.ndarray, "h w 3"], camera: PinholeCamera, height: int = GRID
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture with the grasping region: its floor of cells and its levels (figure 3.3 c).

    Args:
        image: Undistorted.
        camera: Whose frame "robot" is the grid's.
        height: Levels of cells, 0 to 8.
    """
    drawn = image.copy()
    edge = GRID * BLOCK_SIZE
    steps = np.arange(GRID + 1) * BLOCK_SIZE
    lines = []
    for step in steps:  # the floor's cells
        lines.append(((step, 0.0, 0.0), (step, edge, 0.0)))
        lines.append(((0.0, step, 0.0), (edge, step, 0.0)))
    top = height * BLOCK_SIZE
    for step in steps[: height + 1]:  # an outline for each level
        around = [(0.0, 0.0), (edge, 0.0), (edge, edge), (0.0, edge), (0.0, 0.0)]
        for (x, y), (other_x, other_y) in zip(around, around[1:], strict=False):
            lines.append(((x, y, step), (other_x, other_y, step)))
    for x in (0.0, edge):
        for y in (0.0, edge):
            lines.append(((x, y, 0.0), (x, y, top)))
    overlay = drawn.copy()
    for line in lines:
        ends = np.rint(camera.project(np.array(line)) * 8).astype(int)
        cv2.line(overlay, ends[0], ends[1], MESH_COLOR, 1, cv2.LINE_AA, 3)
    drawn = cv2.addWeighted(overlay, 0.6, drawn, 0.4, 0.0)
    names = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
    origin = camera.project(np.zeros((1, 3)))[0]
    for index, (name, axis) in enumerate(names.items()):
        end = camera.project(np.array([axis]) * GRID * BLOCK_SIZE * 0.5)[0]
        color = [0, 0, 0]
        color[index] = 255
        first, second = (np.rint(p).astype(int) for p in (origin, end))
        cv2.arrowedLine(drawn, first, second, color, 2, cv2.LINE_AA)
        cv2.putText(drawn, name, second + 4, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 2, cv2.LINE_AA)
    return drawn
