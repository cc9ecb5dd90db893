"""Paths of the arm: straight lines of the hand, turned into smooth joint motions.

Only two postures of an episode are given, grasp and place. What lies between (up, across
at a height that clears the towers on the way, down) is found here by damped least squares
from the neighbouring posture, so that the hand arrives in exactly the given angles.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline, PchipInterpolator

from fusionnet.robots import ArmKinematics

Posture = Float[np.ndarray, " n"]

LEAST_SECONDS = 0.35
"""Shortest motion."""

MEAN_JOINT_SPEED = 0.9
"""Of the fastest joint in the air, in radians a second; the peak is 1.9 times this."""

MEAN_HAND_SPEED = 0.28
"""Of the hand in the air, in metres a second."""

MEAN_APPROACH_SPEED = 0.10
"""Of the hand on its last way down to a block, in metres a second."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A smooth motion through postures, at rest at both ends.

    Attributes:
        positions: Arm joints at each time step, in radians (metres for slides).
        velocities: Their rates.
    """

    positions: Float[np.ndarray, "t n"]
    velocities: Float[np.ndarray, "t n"]

    def __len__(self) -> int:
        return len(self.positions)


def even_motion(start: Posture, end: Posture, seconds: float, step: float) -> Motion:
    """At one speed from a posture to another, as a controller's targets go."""
    count = max(1, round(seconds / step))
    share = np.arange(1, count + 1)[:, None] / count
    speed = (end - start) / (count * step)
    return Motion(start + share * (end - start), np.repeat(speed[None], count, axis=0))


class PathPlanner:
    """Finds postures along straight lines of the pinch.

    Args:
        kinematics: Of the robot's arm.
    """

    def __init__(self, kinematics: ArmKinematics) -> None:
        self.kinematics = kinematics
        self._low, self._high = kinematics.robot.joint_limits.T

    def pinch(self, posture: Posture) -> Float[np.ndarray, "3"]:
        """Where the pinch is, in the robot frame, in metres."""
        return self.kinematics.robot_from_pinch(posture)[:3, 3]

    def reach(self, target: Float[np.ndarray, "3"], start: Posture) -> tuple[Posture, float]:
        """The posture near `start` that brings the pinch to `target`, and what is missing (m).

        References:
            Buss (2004), Introduction to inverse kinematics, section 8 (damped least squares).
        """
        posture = np.array(start, dtype=float)
        for _ in range(25):
            error = target - self.pinch(posture)
            if np.linalg.norm(error) < 2e-5:
                break
            jacobian = self.kinematics.jacobian(posture)[:3]
            damped = jacobian @ jacobian.T + 1e-5 * np.eye(3)
            change = jacobian.T @ np.linalg.solve(damped, error)
            change *= min(1.0, 0.2 / max(float(np.abs(change).max()), 1e-9))
            posture = np.clip(posture + change, self._low, self._high)
        return posture, float(np.linalg.norm(target - self.pinch(posture)))

    def upwards(self, start: Posture, height: float) -> Float[np.ndarray, "k n"]:
        """Postures on the way from `start` straight up (or down) until the pinch is at `height`.

        The way ends early where the arm reaches no further.
        """
        bottom = self.pinch(start)
        steps = max(1, int(np.ceil(abs(height - bottom[2]) / 0.025)))
        postures = [np.array(start, dtype=float)]
        for z in np.linspace(bottom[2], height, steps + 1)[1:]:
            posture, missing = self.reach(np.array([bottom[0], bottom[1], z]), postures[-1])
            if missing > 0.01:
                break
            postures.append(posture)
        return np.array(postures)

    def across(self, start: Posture, end: Posture) -> Float[np.ndarray, "k n"]:
        """Postures whose pinch goes on a straight line from one posture's to the other's."""
        from_point, to_point = self.pinch(start), self.pinch(end)
        steps = max(2, int(np.ceil(np.linalg.norm(to_point - from_point) / 0.05)))
        postures = []
        for share in np.linspace(0.0, 1.0, steps + 1):
            blend = start + share * (end - start)
            if 0.0 < share < 1.0:
                blend, _ = self.reach(from_point + share * (to_point - from_point), blend)
            postures.append(blend)
        return np.array(postures)

    def motion(self, postures: Float[np.ndarray, "k n"], step: float, approach: float) -> Motion:
        """Drive through the postures with one smooth acceleration and braking.

        Args:
            postures: At least one; the first is where the arm is.
            step: Seconds between samples.
            approach: Metres before the end that are to be driven slowly.
        """
        keep = np.r_[True, np.abs(np.diff(postures, axis=0)).max(axis=1) > 1e-6]
        postures = postures[keep]
        if len(postures) == 1:
            return Motion(np.empty((0, postures.shape[1])), np.empty((0, postures.shape[1])))
        places = np.array([self.pinch(p) for p in postures])
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
        turns = np.abs(np.diff(postures, axis=0)).max(axis=1)
        passages = np.maximum(lengths / MEAN_HAND_SPEED, turns / MEAN_JOINT_SPEED)
        left = np.cumsum(lengths[::-1])[::-1]
        slow = np.clip((approach - left + lengths) / np.maximum(lengths, 1e-9), 0.0, 1.0)
        passages = np.maximum(passages, slow * lengths / MEAN_APPROACH_SPEED)
        times = np.r_[0.0, np.cumsum(passages)]
        count = int(np.ceil(max(LEAST_SECONDS, times[-1]) / step))
        share = np.arange(1, count + 1) / count
        # Minimum jerk (Flash and Hogan, 1985): at rest, and without acceleration, at both ends.
        clock = times[-1] * (10 * share**3 - 15 * share**4 + 6 * share**5)
        rate = times[-1] / (count * step) * 30 * share**2 * (1 - share) ** 2
        # Shape and timing apart: a spline along the way's length never swings past its knots
        # because some of them are driven slowly.
        marks = np.r_[0.0, np.cumsum(np.maximum(lengths, 0.2 * turns))]
        along = PchipInterpolator(times, marks)
        shape = CubicSpline(marks, postures) if len(postures) > 2 else _Line(marks, postures)
        where = along(clock)
        return Motion(shape(where), shape(where, 1) * (along(clock, 1) * rate)[:, None])


class _Line:
    """Straight interpolation between two postures, with its derivative."""

    def __init__(self, marks: np.ndarray, postures: np.ndarray) -> None:
        self._start = postures[0]
        self._slope = (postures[1] - postures[0]) / marks[1]

    def __call__(self, where: np.ndarray, order: int = 0) -> np.ndarray:
        if order:
            return np.broadcast_to(self._slope, (len(where), len(self._slope)))
        return self._start + where[:, None] * self._slope
