"""The cell-to-joint table: one smooth posture for each of the 512 cells.

A network regresses these angles, so cell to angles must be one smooth function. Solving
each cell from its neighbour's posture is not smooth: the answer depends on the order of the
cells. Here two steps alternate instead: project the whole table on a polynomial in
(x, y, z), which is smooth but misses the targets by a little, and re-solve every cell from
its projected posture by Newton steps of least norm, which hits the targets and stays near.
The polynomials are quadratic at first, which carries the free joints far, and cubic at last.
"""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import GRID, Cell
from fusionnet.errors import UnreachableError
from fusionnet.files import write_whole
from fusionnet.robots._kinematics import ArmKinematics
from fusionnet.robots._robot import Robot

TOLERANCE = 1e-4
"""Largest accepted distance between pinch and target [m]."""

MAXIMUM_TILT = np.radians(30.0)
"""Largest accepted angle between the hand's direction of approach and straight down [rad]."""

_TILT_GOAL = np.radians(29.5)
_LIMIT_MARGIN = 0.01
_LARGEST_STEP = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class TableQuality:
    """How good a joint table is; everything by joint is in the joint's own unit [rad or m].

    Attributes:
        position_error: Largest distance between the pinch and its target [m].
        tilt: Largest angle between the direction of approach and straight down [rad].
        limit_margin: Smallest distance to a limit, by joint; negative when violated.
        adjacent: Largest difference between two adjacent cells, by joint.
        cubic_residual: Mean distance to the best cubic in (x, y, z), by joint.
        largest_cubic_residual: Largest distance to that cubic, by joint.
    """

    position_error: float
    tilt: float
    limit_margin: Float[np.ndarray, " n"]
    adjacent: Float[np.ndarray, " n"]
    cubic_residual: Float[np.ndarray, " n"]
    largest_cubic_residual: Float[np.ndarray, " n"]


def make_joint_table(robot: Robot, *, rounds: int = 60) -> Float[np.ndarray, "8 8 8 n"]:
    """The smooth table of a robot, computed anew (about 3 s for NICO).

    Deterministic: it starts at the robot's `seed` pose and draws nothing at random.

    Args:
        robot: Its model, limits, seed pose and board are used; its stored table is not.
        rounds: Alternations of projecting and re-solving.

    Raises:
        UnreachableError: If some cell cannot be reached within 0.1 mm and 30 degrees of
            vertical; the message names the worst cell.
    """
    solver = _AllCells(robot)
    table = np.tile(robot.poses["seed"], (GRID**3, 1))
    table = solver.solve(table, iterations=40)
    for degree, share in ((2, rounds * 2 // 3), (3, rounds - rounds * 2 // 3)):
        smoother = _smoother(degree)
        for _ in range(share):
            previous, table = table, solver.solve(smoother @ table, iterations=8)
            if np.allclose(previous, table, rtol=0.0, atol=1e-9):
                break
    table = solver.solve(table, iterations=20)
    _check(robot, solver, table)
    return table.reshape(GRID, GRID, GRID, -1)


def save_joint_table(robot: Robot, table: Float[np.ndarray, "8 8 8 n"]) -> None:
    """Store the table in the robot's folder, rounded to 1e-7 rad or m.

    Raises:
        OutputError: If the folder cannot be written.
    """
    stream = io.BytesIO()
    np.save(stream, np.round(table, 7), allow_pickle=False)
    write_whole(robot.joint_table_file, stream.getvalue())


def measure_joint_table(robot: Robot, table: Float[np.ndarray, "8 8 8 n"]) -> TableQuality:
    """Measure the laws that a table must keep, on the robot's own model."""
    solver = _AllCells(robot)
    rows = table.reshape(GRID**3, -1)
    positions, approaches, _ = solver.kinematics.forward(rows)
    low, high = robot.joint_limits.T
    steps = [np.abs(np.diff(table, axis=axis)).max(axis=(0, 1, 2)) for axis in range(3)]
    residuals = np.abs(rows - _smoother(3) @ rows)
    return TableQuality(
        position_error=float(np.linalg.norm(positions - solver.targets, axis=1).max()),
        tilt=float(_tilts(approaches).max()),
        limit_margin=np.minimum(rows - low, high - rows).min(axis=0),
        adjacent=np.max(steps, axis=0),
        cubic_residual=residuals.mean(axis=0),
        largest_cubic_residual=residuals.max(axis=0),
    )


class _AllCells:
    """Inverse kinematics of all 512 cells at once: damped Newton steps of least norm."""

    def __init__(self, robot: Robot) -> None:
        self.kinematics = ArmKinematics(robot)
        self.targets = np.array([robot.pinch_position(cell) for cell in _cells()])
        # Stay a little inside the limits, but never by more than a tenth of the range.
        low, high = robot.joint_limits.T
        margin = np.minimum(_LIMIT_MARGIN, (high - low) / 10)
        self.low, self.high = low + margin, high - margin

    def solve(
        self, table: Float[np.ndarray, "512 n"], *, iterations: int
    ) -> Float[np.ndarray, "512 n"]:
        """Step every row towards its target; where the hand tilts too far, also upright."""
        for _ in range(iterations):
            positions, approaches, jacobians = self.kinematics.forward(table)
            velocity, turning = jacobians[:, :3], jacobians[:, 3:]
            transposed = velocity.transpose(0, 2, 1)
            inverse = transposed @ np.linalg.inv(velocity @ transposed + 1e-10 * np.eye(3))
            step = np.einsum("cjk,ck->cj", inverse, self.targets - positions)

            axes = np.cross(approaches, [0.0, 0.0, -1.0])
            axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-9)
            uprighting = np.einsum("ck,ckj->cj", axes, turning)
            free = np.eye(table.shape[1]) - inverse @ velocity
            along = np.einsum("cj,cjk->ck", uprighting, free)
            excess = np.maximum(_tilts(approaches) - _TILT_GOAL, 0.0)
            missing = excess - np.where(excess > 0, np.einsum("cj,cj->c", uprighting, step), 0.0)
            step += along * (missing / (np.sum(along**2, axis=1) + 1e-3))[:, None]

            step = np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            table = np.clip(table + step, self.low, self.high)
            if np.abs(step).max() < 1e-10:
                break
        return table


def _cells() -> Iterator[tuple[int, ...]]:
    return product(range(GRID), repeat=3)


def _tilts(approaches: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, " c"]:
    return np.arccos(np.clip(-approaches[:, 2], -1.0, 1.0))


def _smoother(degree: int) -> Float[np.ndarray, "512 512"]:
    """The matrix that projects a table's column on the polynomials of one degree in (x, y, z)."""
    x, y, z = (np.array(list(_cells())).T - (GRID - 1) / 2) / ((GRID - 1) / 2)
    powers = [p for p in product(range(degree + 1), repeat=3) if sum(p) <= degree]
    basis = np.stack([x**i * y**j * z**k for i, j, k in powers], axis=1)
    return basis @ np.linalg.pinv(basis)


def _check(robot: Robot, solver: _AllCells, table: Float[np.ndarray, "512 n"]) -> None:
    positions, approaches, _ = solver.kinematics.forward(table)
    distances = np.linalg.norm(positions - solver.targets, axis=1)
    tilts = _tilts(approaches)
    bad = (distances > TOLERANCE) | (tilts > MAXIMUM_TILT)
    if bad.any():
        worst = int(np.argmax(np.where(bad, distances + tilts, -1.0)))
        raise UnreachableError(
            f"Robot {robot.name!r} misses {bad.sum()} of {GRID**3} cells; the worst is"
            f" {tuple(Cell.from_index(worst))}: {distances[worst] * 1000:.1f} mm away, hand tilted"
            f" {np.degrees(tilts[worst]):.0f} degrees. Move the board nearer, or change the seed"
            " pose.",
            residual=float(distances[worst]),
            attempts=1,
        )
