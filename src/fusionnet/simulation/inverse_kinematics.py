"""Inverse kinematics: joint values that bring a robot's pinch to any position and orientation.

Differential inverse kinematics by mink: each step solves a quadratic program whose
inequalities are the joint limits, so no answer ever violates one. Several starts are tried,
the nearest known posture first, and always the same ones for the same question.

For the 512 cells of the grid use `Robot.joint_angles`, whose answers are a smooth function
of the cell; what is found here depends on the start.
"""

from collections.abc import Iterator
from itertools import islice

import mink
import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import GRID
from fusionnet.errors import InputError, UnreachableError
from fusionnet.randomness import generator
from fusionnet.robots import ArmKinematics, Robot


class InverseKinematics:
    """Finds postures of one robot's arm.

    Holds a model and its state, so one instance serves one thread.

    Args:
        robot: The robot.
        tolerance: Largest accepted distance of the pinch from its target [m].
        angular_tolerance: Largest accepted angle from the asked orientation [rad].
        attempts: Number of start postures to try.
        iterations: Steps from each start.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        tolerance: float = 1e-4,
        angular_tolerance: float = 2e-3,
        attempts: int = 16,
        iterations: int = 60,
    ) -> None:
        self.robot = robot
        self.tolerance = tolerance
        self.angular_tolerance = angular_tolerance
        self.attempts = attempts
        self.iterations = iterations
        self._configuration = mink.Configuration(ArmKinematics(robot).model)
        model = self._configuration.model
        joints = [model.joint(name) for name in robot.joint_names]
        self._addresses = np.array([joint.qposadr[0] for joint in joints])
        self._limits = [mink.ConfigurationLimit(model)]
        self._frame = mink.FrameTask("pinch", "site", position_cost=100.0, orientation_cost=0.0)
        self._approach = mink.AxisAlignTask("pinch", "site", axis=(0.0, 0.0, 1.0), cost=10.0)

    def solve(
        self,
        position: Float[np.ndarray, "3"],
        *,
        rotation: Float[np.ndarray, "3 3"] | None = None,
        maximum_tilt: float | None = None,
        start: Float[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Joint values within limits that bring the pinch to a position.

        Args:
            position: Target of the pinch, in the robot frame [m].
            rotation: Orientation of the pinch frame in the robot frame; free when None.
            maximum_tilt: Largest angle between the hand's direction of approach and straight
                down [rad]; free when None. Not together with `rotation`.
            start: Posture from which to search first, such as the arm's present one; the
                answer is near it where one is.

        Raises:
            InputError: If the target is not finite, or not a rotation.
            UnreachableError: If no start leads to the target; carries the best attempt's
                residual and the number of attempts.
        """
        position = _checked_target(position, rotation, maximum_tilt)
        target = np.eye(4)
        target[:3, 3] = position
        target[:3, :3] = np.eye(3) if rotation is None else rotation
        self._frame.set_orientation_cost(0.0 if rotation is None else 10.0)
        self._frame.set_target(mink.SE3.from_matrix(target))

        best, tried = (np.inf, np.inf), 0
        for posture in islice(self._starts(position, start), self.attempts):
            tried += 1
            distance, angle = self._descend(posture, rotation, maximum_tilt)
            if distance <= self.tolerance and angle <= self.angular_tolerance:
                return self._configuration.q[self._addresses].copy()
            best = min(best, (distance, angle), key=sum)
        raise UnreachableError(
            f"Robot {self.robot.name!r} cannot bring its hand to"
            f" ({', '.join(f'{value:.3f}' for value in position)}) m"
            f"{_wish(rotation, maximum_tilt)}: the best of {tried} attempts ended"
            f" {best[0] * 1000:.1f} mm away and turned {np.degrees(best[1]):.1f} degrees too far."
            " Choose a target nearer to the board or leave the orientation free.",
            residual=best[0],
            attempts=tried,
        )

    def _descend(
        self,
        start: Float[np.ndarray, " n"],
        rotation: Float[np.ndarray, "3 3"] | None,
        maximum_tilt: float | None,
    ) -> tuple[float, float]:
        """Step from a start; the distance [m] and excess angle [rad] at the end."""
        configuration = self._configuration
        values = configuration.q.copy()
        values[self._addresses] = np.clip(start, *self.robot.joint_limits.T)
        configuration.update(values)
        for _ in range(self.iterations):
            distance, angle = self._miss(rotation, maximum_tilt)
            tasks: list[mink.Task] = [self._frame]
            if maximum_tilt is not None and angle > 0:
                inside = maximum_tilt - self.angular_tolerance
                self._approach.set_target(_into_cone(self._direction(), inside))
                tasks.append(self._approach)
            if distance <= self.tolerance / 10 and angle <= self.angular_tolerance / 10:
                break
            try:
                velocity = mink.solve_ik(
                    configuration, tasks, 1.0, "daqp", damping=1e-3, limits=self._limits
                )
            except mink.NoSolutionFound:
                break
            configuration.integrate_inplace(np.clip(velocity, -0.5, 0.5), 1.0)
        return self._miss(rotation, maximum_tilt)

    def _miss(
        self, rotation: Float[np.ndarray, "3 3"] | None, maximum_tilt: float | None
    ) -> tuple[float, float]:
        """How far the present posture is from the target [m], and turned too far [rad]."""
        error = self._frame.compute_error(self._configuration)
        distance = float(np.linalg.norm(error[:3]))
        if rotation is not None:
            return distance, float(np.linalg.norm(error[3:]))
        if maximum_tilt is None:
            return distance, 0.0
        tilt = float(np.arccos(np.clip(-self._direction()[2], -1, 1)))
        return distance, max(0.0, tilt - maximum_tilt)

    def _direction(self) -> Float[np.ndarray, "3"]:
        """The present posture's direction of approach, in the robot frame."""
        pinch = self._configuration.get_transform_frame_to_world("pinch", "site")
        axis: Float[np.ndarray, "3"] = pinch.rotation().as_matrix()[:, 2]
        return axis

    def _starts(
        self, position: Float[np.ndarray, "3"], start: Float[np.ndarray, " n"] | None
    ) -> Iterator[Float[np.ndarray, " n"]]:
        if start is not None:
            yield np.asarray(start, dtype=float)
        origin = self.robot.pinch_position((0, 0, 0))
        pitch = self.robot.pinch_position((1, 1, 1)) - origin
        cell = np.clip(np.round((position - origin) / pitch), 0, GRID - 1).astype(int)
        yield self.robot.joint_table[tuple(cell)]
        yield self.robot.poses["seed"]
        rng = generator(0, "inverse kinematics", self.robot.name)
        while True:
            yield rng.uniform(*self.robot.joint_limits.T)


def _into_cone(direction: Float[np.ndarray, "3"], maximum_tilt: float) -> Float[np.ndarray, "3"]:
    """The direction itself if it is within a tilt from straight down, else the nearest that is."""
    sideways = direction[:2]
    tilt = np.arctan2(np.linalg.norm(sideways), -direction[2])
    if tilt <= maximum_tilt:
        return direction
    outwards = sideways / max(float(np.linalg.norm(sideways)), 1e-12)
    return np.array([*(np.sin(maximum_tilt) * outwards), -np.cos(maximum_tilt)])


def _checked_target(
    position: Float[np.ndarray, "3"],
    rotation: Float[np.ndarray, "3 3"] | None,
    maximum_tilt: float | None,
) -> Float[np.ndarray, "3"]:
    position = np.asarray(position, dtype=float)
    if not np.isfinite(position).all():
        raise InputError(f"The target position {position} is not finite; give three metres.")
    if rotation is not None:
        if maximum_tilt is not None:
            raise InputError("Give a rotation or a maximum tilt, not both.")
        orthonormal = np.allclose(rotation @ np.transpose(rotation), np.eye(3), atol=1e-6)
        if not orthonormal or np.linalg.det(rotation) < 0:
            raise InputError("The target rotation is not a rotation matrix (orthonormal, det 1).")
    return position


def _wish(rotation: Float[np.ndarray, "3 3"] | None, maximum_tilt: float | None) -> str:
    if rotation is not None:
        return " with the asked orientation"
    if maximum_tilt is not None:
        return f" within {np.degrees(maximum_tilt):.0f} degrees of vertical"
    return ""
