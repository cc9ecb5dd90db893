"""Where a robot's hand is for given joint values."""

import mujoco
import numpy as np
from jaxtyping import Float

from fusionnet.robots._model import compiled
from fusionnet.robots._robot import Robot


class ArmKinematics:
    """Forward kinematics of one robot's arm, computed by MuJoCo on the robot's own model.

    Holds a model and its state, so one instance serves one thread.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = _skeleton(robot)
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in robot.joint_names]
        self._positions = np.array([joint.qposadr[0] for joint in joints])
        self._velocities = np.array([joint.dofadr[0] for joint in joints])
        self._pinch = self.model.site("pinch").id

    def robot_from_pinch(self, joint_angles: Float[np.ndarray, " n"]) -> Float[np.ndarray, "4 4"]:
        """Pose of the pinch frame, whose z axis is the hand's direction of approach."""
        self._move(joint_angles)
        transform = np.eye(4)
        transform[:3, :3] = self.data.site_xmat[self._pinch].reshape(3, 3)
        transform[:3, 3] = self.data.site_xpos[self._pinch]
        return transform

    def forward(
        self, postures: Float[np.ndarray, "m n"]
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"], Float[np.ndarray, "m 6 n"]]:
        """Pinch positions, directions of approach and Jacobians of many postures at once."""
        positions, approaches = np.empty((len(postures), 3)), np.empty((len(postures), 3))
        jacobians = np.empty((len(postures), 6, self.model.nv))
        for i, posture in enumerate(postures):
            self._move(posture)
            self._differentiate(jacobians[i])
            positions[i] = self.data.site_xpos[self._pinch]
            approaches[i] = self.data.site_xmat[self._pinch, 2::3]
        return positions, approaches, jacobians[:, :, self._velocities]

    def jacobian(self, joint_angles: Float[np.ndarray, " n"]) -> Float[np.ndarray, "6 n"]:
        """Velocity of the pinch (rows 0 to 2) and its angular velocity (3 to 5) per joint rate."""
        self._move(joint_angles)
        jacobian = np.empty((6, self.model.nv))
        self._differentiate(jacobian)
        return jacobian[:, self._velocities]

    def tilt(self, joint_angles: Float[np.ndarray, " n"]) -> float:
        """Angle between the direction of approach and straight down [rad]."""
        down = -self.robot_from_pinch(joint_angles)[2, 2]
        return float(np.arccos(np.clip(down, -1.0, 1.0)))

    def _move(self, joint_angles: np.ndarray) -> None:
        self.data.qpos[self._positions] = joint_angles
        mujoco.mj_kinematics(self.model, self.data)

    def _differentiate(self, jacobian: np.ndarray) -> None:
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_jacSite(self.model, self.data, jacobian[:3], jacobian[3:], self._pinch)


def _skeleton(robot: Robot) -> mujoco.MjModel:
    """The robot's model without shapes and finger joints, which only cost time here."""
    spec = robot.spec()
    for element in (
        *spec.sensors,
        *spec.actuators,
        *spec.equalities,
        *spec.tendons,
        *spec.pairs,
    ):
        spec.delete(element)
    for name in robot.finger_positions:
        spec.delete(spec.joint(name))
    for body in spec.bodies[1:]:
        if not body.explicitinertial:
            body.explicitinertial, body.mass, body.inertia = True, 1.0, np.ones(3)
    for geom in spec.geoms:
        spec.delete(geom)
    return compiled(spec, robot.name)
