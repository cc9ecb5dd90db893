"""What every robot offers: model, joints, limits, poses, the board's place and a joint table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import SupportsIndex

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from fusionnet.blocks.grid import BLOCK_SIZE, GRID, Cell
from fusionnet.errors import DataError, InputError
from fusionnet.robots._model import check_parts, compiled, freeze, read_model

POSES = ("seed", "prepare", "ready")
"""Arm postures that every robot names."""

CellLike = Sequence[SupportsIndex] | np.ndarray
"""Three whole numbers x, y, z: a `Cell`, a tuple or an array."""


@dataclass(frozen=True, kw_only=True)
class TableTop:
    """The rectangle on which the board lies, in the robot frame [m]."""

    height: float
    x: tuple[float, float]
    y: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """One robot: its model and everything that is known about using it.

    The *robot frame* is the root frame of the model: z up, metres. The *pinch* is the
    point between the fingers that goes to a block; its site's z axis is the direction
    from which the hand approaches (downwards over the table).

    Attributes:
        name: Name in the catalogue.
        model_file: MJCF with the bodies, the cameras `left_eye` and `right_eye`, the site
            `pinch`, and a position actuator named after each arm and finger joint.
        joint_names: The arm's joints, in the order of every joint vector.
        finger_positions: For each finger joint its (open, closed) value.
        head_angles: Head joints, which stay where they are, and their angles.
        resting_angles: Further joints that stay where they are, such as the other arm's.
        poses: Named arm postures: `seed` (where searches start), `prepare` (the hand is
            outside both eyes' views) and `ready` (above the board).
        board_origin: Outer corner of cell (0, 0) on the table top, in the robot frame.
            The grid's axes are parallel to the robot's.
        table_top: The table under the board.
        pinch_clearance: Height of the pinch above the top of the block that it grasps [m].
        kinematics_source: Where the model's numbers come from.

    Raises:
        DataError: If a pose is missing, or has another number of values than there are joints.
    """

    name: str
    model_file: Path
    joint_names: tuple[str, ...]
    finger_positions: Mapping[str, tuple[float, float]]
    head_angles: Mapping[str, float] = field(default_factory=dict)
    resting_angles: Mapping[str, float] = field(default_factory=dict)
    poses: Mapping[str, Float[np.ndarray, " n"]]
    board_origin: tuple[float, float, float]
    table_top: TableTop
    pinch_clearance: float
    kinematics_source: str

    def __post_init__(self) -> None:
        missing = [pose for pose in POSES if pose not in self.poses]
        if missing:
            raise DataError(f"Robot {self.name!r} lacks the poses {', '.join(missing)}; add them.")
        for pose, values in self.poses.items():
            if np.shape(values) != (len(self.joint_names),):
                raise DataError(
                    f"Pose {pose!r} of robot {self.name!r} has shape {np.shape(values)}; it needs"
                    f" a value for each of {', '.join(self.joint_names)}."
                )

    def spec(self, head_angles: Mapping[str, float] | None = None) -> mujoco.MjSpec:
        """A fresh model of the robot alone, to be attached to a world at its origin.

        Only the arm's and the fingers' joints move in it; all others are frozen at their head
        or resting angle, or else at 0, which keeps the simulation small.

        Args:
            head_angles: Other angles for some of the head joints [rad].

        Raises:
            DataError: If the model file is missing or broken (the message has the line), or
                lacks a joint, actuator, camera or site that every robot needs.
        """
        frozen = {**self.resting_angles, **self.head_angles, **(head_angles or {})}
        spec = self.complete_spec()
        check_parts(spec, self.name, joints=frozen)
        freeze(spec, self.name, frozen, moving={*self.joint_names, *self.finger_positions})
        return spec

    def complete_spec(self) -> mujoco.MjSpec:
        """The model file as it is, with every joint movable.

        Raises:
            DataError: As for `spec`.
        """
        spec = read_model(self.model_file, self.name)
        moving = (*self.joint_names, *self.finger_positions)
        check_parts(
            spec,
            self.name,
            joints=moving,
            actuators=moving,
            cameras=("left_eye", "right_eye"),
            sites=("pinch",),
        )
        return spec

    @cached_property
    def joint_limits(self) -> Float[np.ndarray, "n 2"]:
        """Lowest and highest value of each arm joint, from the model [rad, or m for slides].

        Raises:
            DataError: As for `spec`, or if a joint has no range.
        """
        model = compiled(self.complete_spec(), self.name)
        limits = np.array([model.joint(name).range for name in self.joint_names])
        for name, (low, high) in zip(self.joint_names, limits, strict=True):
            if not low < high:
                raise DataError(
                    f"Joint {name!r} of robot {self.name!r} has the range {low:g} to {high:g};"
                    " give it one in the model, from its lower to its upper limit."
                )
        return _read_only(limits)

    @cached_property
    def robot_from_board(self) -> Float[np.ndarray, "4 4"]:
        """Pose of the board frame: x, y, z of the grid, origin at cell (0, 0)'s outer corner."""
        transform = np.eye(4)
        transform[:3, 3] = self.board_origin
        return _read_only(transform)

    def cell_position(self, cell: CellLike) -> Float[np.ndarray, "3"]:
        """Centre of a block in the cell, in the robot frame [m]; cells off the grid are allowed."""
        return np.asarray(self.board_origin) + (np.asarray(cell, dtype=float) + 0.5) * BLOCK_SIZE

    def pinch_position(self, cell: CellLike) -> Float[np.ndarray, "3"]:
        """Where the pinch goes to grasp or place a block in the cell, in the robot frame [m]."""
        return self.cell_position(cell) + [0.0, 0.0, BLOCK_SIZE / 2 + self.pinch_clearance]

    @property
    def joint_table_file(self) -> Path:
        """Where the cell-to-joint table lies: `joint_table.npy` beside the model."""
        return self.model_file.with_name("joint_table.npy")

    @cached_property
    def joint_table(self) -> Float[np.ndarray, "8 8 8 n"]:
        """Arm posture for each cell; a smooth function of the cell [rad, or m].

        Raises:
            DataError: If the table is missing or has another shape than the robot needs.
        """
        try:
            table = np.load(self.joint_table_file, allow_pickle=False)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise DataError(
                f"Robot {self.name!r} has no usable joint table"
                f" at {self.joint_table_file}: {reason}."
                " Make it with fusionnet.robots.make_joint_table."
            ) from error
        shape = (GRID, GRID, GRID, len(self.joint_names))
        if table.shape != shape:
            raise DataError(
                f"{self.joint_table_file} has shape {table.shape};"
                f" robot {self.name!r} needs {shape}."
            )
        return _read_only(table)

    def joint_angles(self, cell: CellLike) -> Float[np.ndarray, " n"]:
        """The arm posture that brings the pinch to a cell's block [rad, or m].

        Raises:
            InputError: If the cell is not on the grid.
        """
        if not Cell(*cell).on_grid:
            raise InputError(f"Cell {tuple(cell)} is not on the grid; x, y and z go from 0 to 7.")
        return self.joint_table[tuple(cell)].copy()

    def scale(self, values: Float[np.ndarray, "... k"]) -> Float[np.ndarray, "... k"]:
        """Joint values to 0 (lower limit) ... 1 (upper limit).

        Args:
            values: n joint values, or 2n + 2 targets (grasp joints, grasp gripper, place
                joints, place gripper), whose gripper values stay as they are.
        """
        low, span = self._limits_like(values)
        return (np.asarray(values) - low) / span

    def unscale(self, scaled: Float[np.ndarray, "... k"]) -> Float[np.ndarray, "... k"]:
        """The inverse of `scale`."""
        low, span = self._limits_like(scaled)
        return np.asarray(scaled) * span + low

    def check_joint_angles(self, joint_angles: Float[np.ndarray, " n"]) -> None:
        """Accept a posture that the arm can take.

        Raises:
            InputError: If the length is wrong, a value is not finite, or one is outside its
                limits (by more than rounding); the message names the joint.
        """
        values = np.asarray(joint_angles, dtype=float)
        if values.shape != (len(self.joint_names),):
            raise InputError(
                f"Robot {self.name!r} takes {len(self.joint_names)} joint values"
                f" ({', '.join(self.joint_names)}); received an array of shape {values.shape}."
            )
        for name, value, (low, high) in zip(
            self.joint_names, values, self.joint_limits, strict=True
        ):
            if not np.isfinite(value):
                raise InputError(f"Joint {name!r} was given {value}; a finite number is needed.")
            if not low - 1e-6 <= value <= high + 1e-6:
                given, lowest, highest = (self.with_unit(name, v, 2) for v in (value, low, high))
                raise InputError(
                    f"Joint {name!r} cannot go to {given}; its limits are {lowest} to {highest}."
                )

    @cached_property
    def sliding_joints(self) -> frozenset[str]:
        """The arm joints that are measured in metres rather than radians."""
        slide = mujoco.mjtJoint.mjJNT_SLIDE
        spec = self.complete_spec()
        return frozenset(name for name in self.joint_names if spec.joint(name).type == slide)

    @cached_property
    def turning(self) -> Bool[np.ndarray, " n"]:
        """For each arm joint whether it turns; the others slide."""
        return _read_only(np.array([name not in self.sliding_joints for name in self.joint_names]))

    @property
    def joint_units(self) -> list[str]:
        """For each arm joint what its values are measured in: "rad", or "m" if it slides."""
        return ["rad" if turns else "m" for turns in self.turning]

    def with_unit(self, joint: str, value: float, digits: int = 1) -> str:
        """A joint's value for people: in degrees, or in millimetres if it slides.

        Args:
            joint: Name of an arm joint.
            value: In radians, or metres.
            digits: Decimals to show.
        """
        if joint in self.sliding_joints:
            return f"{value * 1000:.{digits}f} mm"
        return f"{np.degrees(value):.{digits}f}\N{DEGREE SIGN}"

    def _limits_like(
        self, values: Float[np.ndarray, "... k"]
    ) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        low, high = self.joint_limits.T
        n, k = len(low), np.shape(values)[-1]
        if k == 2 * n + 2:
            low = np.concatenate([low, [0.0], low, [0.0]])
            high = np.concatenate([high, [1.0], high, [1.0]])
        elif k != n:
            raise InputError(
                f"Robot {self.name!r} has {n} joints: {n} joint values or {2 * n + 2} targets"
                f" can be scaled; received {k}."
            )
        return low, high - low


def _read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array
