"""The simulated arm and hand in motion: follows paths, closes, opens, feels when it pushes."""

from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import Float

from fusionnet.robots import Robot
from fusionnet.simulation.motion import Motion
from fusionnet.simulation.physics import (
    GATE,
    TIME_STEP,
    UPRIGHT_DAMPING,
    UPRIGHT_STIFFNESS,
    Physics,
)
from fusionnet.simulation.tabletop import BLOCK_HALF

PUSH_LIMIT = 3.0
"""A careful motion stops when the hand pushes harder, in newtons (a block weighs 0.12)."""

PUSH_SECONDS = 0.02
"""Time over which pushing is averaged: a block that yields is knocked aside, a tower is not."""

REST_SPEED = 5e-3
"""A block that moves and turns slower than this rests, in m/s and rad/s."""

FRAMES_PER_SECOND = 25
"""Of recorded states."""

_STEPS_PER_FEEL = 10
"""The arm is asked every so many steps whether it touches something."""

_STEPS_PER_FRAME = round(1.0 / FRAMES_PER_SECOND / TIME_STEP)


class Hand:
    """One robot's arm and hand in one simulated world.

    Attributes:
        held: Index of the block in the hand, or None.
        closed: Whether the hand is closed (with or without a block).
        frames: Recorded joint positions of the whole model, if recording.
        on_frame: Called 25 times a simulated second, if set.
        touched: Obstacles that the arm or the hand has touched (`OBSTACLES`).
    """

    def __init__(self, robot: Robot, physics: Physics, data: mujoco.MjData) -> None:
        self.robot = robot
        self.physics = physics
        self.data = data
        self.held: int | None = None
        self.closed = False
        self.frames: list[Float[np.ndarray, " q"]] | None = None
        self.on_frame: Callable[[], None] | None = None
        self.touched: set[str] = set()
        self._steps = 0
        self._held_orientation = np.array([1.0, 0.0, 0.0, 0.0])

    @property
    def posture(self) -> Float[np.ndarray, " n"]:
        """The arm's joints now."""
        return self.data.qpos[self.physics.arm].copy()

    @property
    def target(self) -> Float[np.ndarray, " n"]:
        """Where the arm's joints were last told to be."""
        return self.data.ctrl[self.physics.arm_actuators].copy()

    @property
    def pinch(self) -> Float[np.ndarray, "3"]:
        """Where the pinch is now, in the robot frame, in metres."""
        return self.data.site_xpos[self.physics.pinch].copy()

    @property
    def seconds(self) -> float:
        """Simulated time."""
        return float(self.data.time)

    def jump(self, posture: Float[np.ndarray, " n"], *, closed: bool) -> None:
        """Put the arm somewhere at once, at rest; only for the beginning of a world."""
        self._command(posture)
        self.data.qpos[self.physics.arm] = posture
        self._command_fingers(closed)
        joints = self.physics.model.actuator_trnid[self.physics.finger_actuators, 0]
        addresses = self.physics.model.jnt_qposadr[joints]
        self.data.qpos[addresses] = self.data.ctrl[self.physics.finger_actuators]
        mujoco.mj_forward(self.physics.model, self.data)

    def follow(self, motion: Motion, *, careful: bool = False) -> bool:
        """Move the arm along a motion.

        Args:
            motion: Samples at every time step.
            careful: Stop where the hand, or the block in it, pushes on something.

        Returns:
            Whether the end was reached; False after a careful stop.
        """
        pushing, share = 0.0, TIME_STEP / PUSH_SECONDS
        servos, controls = self.physics.arm_actuators, self.data.ctrl
        for command in motion.positions + self.physics.lead * motion.velocities:
            controls[servos] = command
            self._step()
            if careful:
                pushing += share * (self.push() - pushing)
                if pushing > PUSH_LIMIT:
                    self._command(self.posture)
                    return False
        if len(motion):
            self._command(motion.positions[-1])
        return True

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TIME_STEP)):
            self._step()

    def at_rest(self) -> bool:
        """Whether no block moves, but for the one in the hand."""
        velocities = self.physics.block_velocities[:, None] + np.arange(6)
        speeds = np.abs(self.data.qvel[velocities]).max(axis=1, initial=0.0)
        if self.held is not None:
            speeds[self.held] = 0.0
        return bool(speeds.max(initial=0.0) < REST_SPEED)

    def push(self) -> float:
        """Force with which the hand, or the block in it, pushes on something, in newtons."""
        force = float(self.data.sensordata[self.physics.touch])
        if self.held is not None:
            ties = self.data.efc_id[: self.data.ne] == self.physics.hold  # equalities come first
            pull = self.data.efc_force[: self.data.ne][ties]
            force = max(force, float(np.linalg.norm(pull)))
        return force

    def lean(self) -> Float[np.ndarray, "2"]:
        """Towards which side the held block is pushed up, and by how much, in radians.

        Along x and y of the robot. A hand feels it: it is the turn against which the hand keeps
        the block upright. Zero without a block.
        """
        if self.held is None:
            return np.zeros(2)
        first = self.physics.block_positions[self.held] + 3
        turn, world_turn = np.empty(3), np.empty(3)
        mujoco.mju_subQuat(turn, self.data.qpos[first : first + 4], self._held_orientation)
        mujoco.mju_rotVecQuat(world_turn, turn, self._held_orientation)
        return np.array([-world_turn[1], world_turn[0]])

    def close(self, seconds: float = 0.25) -> float | None:
        """Close the hand; it holds the block whose grasp point is within the gate, if there is one.

        Returns:
            Distance from the pinch to the nearest block's grasp point, in metres.
        """
        was_closed, self.closed = self.closed, True
        self._command_fingers(True)
        self.wait(seconds)
        if len(self.physics.blocks) == 0:
            return None
        tops = self.data.xpos[self.physics.blocks] + [0.0, 0.0, BLOCK_HALF[2]]
        distances = np.linalg.norm(
            tops + [0.0, 0.0, self.robot.pinch_clearance] - self.pinch, axis=1
        )
        nearest = int(np.argmin(distances))
        if self.held is None and not was_closed and distances[nearest] <= GATE:
            self.hold(nearest)
        return float(distances[nearest])

    def open(self, seconds: float = 0.25) -> None:
        """Open the hand and let go of what it holds."""
        self.closed = False
        self._command_fingers(False)
        if self.held is not None:
            self.data.eq_active[self.physics.hold] = 0
            self.data.xfrc_applied[self.physics.blocks[self.held]] = 0.0
            self.physics.let_touch_hand(self.held, True)
            self.held = None
        self.wait(seconds)

    def hold(self, block: int) -> None:
        """Tie a block to the pinch, where it is now."""
        physics, data = self.physics, self.data
        model, body = physics.model, physics.blocks[block]
        palm = model.site_bodyid[physics.pinch]
        model.eq_obj2id[physics.hold] = body
        for anchor, owner in ((slice(0, 3), palm), (slice(3, 6), body)):
            rotation = data.xmat[owner].reshape(3, 3)
            model.eq_data[physics.hold, anchor] = rotation.T @ (self.pinch - data.xpos[owner])
        data.eq_active[physics.hold] = 1
        physics.let_touch_hand(block, False)
        self._held_orientation = data.xquat[body].copy()
        self.held, self.closed = block, True

    def _step(self) -> None:
        if self.held is not None:
            self._keep_orientation()
        mujoco.mj_step(self.physics.model, self.data)
        self._steps += 1
        if self._steps % _STEPS_PER_FEEL == 0 and self.data.ncon:
            self.touched |= self.physics.touched(self.data)
        if self._steps % _STEPS_PER_FRAME == 0:
            if self.frames is not None:
                self.frames.append(self.data.qpos.astype(np.float32))
            if self.on_frame is not None:
                self.on_frame()

    def _keep_orientation(self) -> None:
        block = self.held
        assert block is not None
        body = self.physics.blocks[block]
        first = self.physics.block_positions[block] + 3
        orientation = self.data.qpos[first : first + 4]
        turn = np.empty(3)
        mujoco.mju_subQuat(turn, self._held_orientation, orientation)
        first = self.physics.block_velocities[block] + 3
        rate = self.data.qvel[first : first + 3]
        torque = UPRIGHT_STIFFNESS * turn - UPRIGHT_DAMPING * rate
        mujoco.mju_rotVecQuat(self.data.xfrc_applied[body, 3:], torque, orientation)

    def _command(self, posture: Float[np.ndarray, " n"]) -> None:
        self.data.ctrl[self.physics.arm_actuators] = posture

    def _command_fingers(self, closed: bool) -> None:
        self.data.ctrl[self.physics.finger_actuators] = self.physics.finger_range[:, int(closed)]
