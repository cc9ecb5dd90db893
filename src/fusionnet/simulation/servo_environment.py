"""The same task in a closed loop: joint targets at 20 Hz, new pictures at every step."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from fusionnet.errors import InputError
from fusionnet.simulation.environment import PickPlace

RATE = 20
"""Steps a second."""

LONGEST = 20.0
"""An episode is cut off after this many simulated seconds."""

SETTLED = 0.2
"""For this long every block must rest where it should, with the hand left as it is, in seconds."""


class PickPlaceServo(PickPlace):
    """A sentence says which block to move where; every action moves the arm a little.

    ## Action
    Target of every arm joint and the gripper: 7 values for NICO. Angles in radians within the
    joints' limits, to which the targets go evenly within the step (a twentieth of a second);
    the servos follow as they can. A gripper value from 0.5 closes the hand at the end of the
    step; it then holds a block whose grasp point is within the gate.

    ## Observation
    As `PickPlace`, with both eyes' pictures of this moment, and `gripper` (1 when closed).

    ## Start
    As `PickPlace`, with the hand beside the table (or around the block that it holds).

    ## Reward
    1 in the step in which every block has rested for 0.2 seconds where the command wants it, and
    the hand has held what it should, without closing or opening; else 0.

    ## End
    Terminated with the reward; truncated after 400 steps (20 seconds). `info` has `success`,
    `reason`, `touched` (see `Episode`) and `seconds`.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": RATE}

    def __init__(self, robot: str = "nico", **options: Any) -> None:
        super().__init__(robot, **options)
        low, high = self.robot.joint_limits.T
        self.action_space = spaces.Box(np.r_[low, 0.0], np.r_[high, 1.0], dtype=np.float64)
        gripper = spaces.Box(0.0, 1.0, (1,), np.float64)
        self.observation_space = spaces.Dict(
            {**self.observation_space.spaces, "gripper": gripper}  # type: ignore[attr-defined]
        )
        self._steps = 0
        self._settled = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Set up a command's layout; see `PickPlace.reset`."""
        self._steps = self._settled = 0
        return super().reset(seed=seed, options=options)

    def step(
        self, action: Float[np.ndarray, " k"]
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Let a twentieth of a second pass.

        Raises:
            InputError: If the action has the wrong length, is not finite, or exceeds a limit.
        """
        if self._world is None or self._command is None or self._expected is None:
            raise gymnasium.error.ResetNeeded("Call reset before step.")
        values = np.asarray(action, dtype=float)
        if values.shape != self.action_space.shape or not np.isfinite(values).all():
            raise InputError(
                f"An action is {len(self.robot.joint_names) + 1} finite numbers, "
                f"{', '.join(self.robot.joint_names)} and the gripper; received {values.tolist()}."
            )
        closed = bool(values[-1] >= 0.5)
        changes = closed != self._world.hand_closed
        self._world.drive(values[:-1], closed, 1.0 / RATE)
        self._steps += 1
        wrong = self._world.differences(self._expected)
        self._settled = 0 if wrong or changes else self._settled + 1
        success = self._settled >= round(SETTLED * RATE)
        if not wrong and not success:
            wrong = [f"every block has yet to rest for {SETTLED:g} seconds"]
        info = {
            "command": self._command.id,
            "success": success,
            "reason": "; ".join(wrong[:3]) or "every block is where it should be",
            "touched": self._world.touched,
            "seconds": self._steps / RATE,
        }
        over = not success and self._steps >= LONGEST * RATE
        return self._observation(), float(success), success, over, info

    def _observation(self) -> dict[str, Any]:
        assert self._world is not None
        closed = float(self._world.hand_closed)
        return {**super()._observation(), "gripper": np.array([closed])}
