"""A robot with its table, put into postures."""

import mujoco
import numpy as np

from fusionnet.robots import CollisionBit, Robot


class AtTheTable:
    """One robot, and its table, which collides with everything that moves."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        spec, top = robot.spec(), robot.table_top
        half = [(top.x[1] - top.x[0]) / 2, (top.y[1] - top.y[0]) / 2, 0.0125]
        spec.worldbody.add_geom(
            name="table",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            pos=[sum(top.x) / 2, sum(top.y) / 2, top.height - half[2]],
            contype=CollisionBit.WORLD,
            conaffinity=CollisionBit.ARM | CollisionBit.HAND,
        )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def take(self, joints: np.ndarray, closed: float = 0.0) -> None:
        """Put the robot into a posture."""
        for name, value in zip(self.robot.joint_names, joints, strict=True):
            self.data.joint(name).qpos = value
        for name, (opened, shut) in self.robot.finger_positions.items():
            self.data.joint(name).qpos = opened + closed * (shut - opened)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def touching(self) -> set[frozenset[str]]:
        """The bodies that touch; the table belongs to the body `world`."""
        mujoco.mj_collision(self.model, self.data)
        return {
            frozenset(self.model.body(self.model.geom_bodyid[geom]).name for geom in contact.geom)
            for contact in self.data.contact
            if contact.dist < 0
        }
