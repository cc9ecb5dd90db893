"""Reading a robot's MJCF: what it must hold, and freezing the joints that are not used."""

from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import contextmanager
from enum import IntFlag
from pathlib import Path

import mujoco
import numpy as np

from fusionnet.errors import DataError, FusionNetError


class CollisionBit(IntFlag):
    """Bits of MuJoCo's contype and conaffinity, shared by all robots and the world.

    A robot's model says which kinds its own geoms meet: the arm and the hand meet the world
    and everything of the robot that stays where it is (trunk, head, legs, the other arm). The
    world adds what blocks meet, and the probe: the ball at the pinch, by which alone the hand
    touches blocks (see `docs/grasp-model.md`).
    """

    WORLD = 1
    BLOCK = 2
    ARM = 4
    TRUNK = 8
    HAND = 16
    PROBE = 64


def read_model(file: Path, robot: str) -> mujoco.MjSpec:
    """The model in an MJCF or URDF file.

    Raises:
        DataError: If the file is missing or broken; the message has MuJoCo's reason and line.
    """
    try:
        return mujoco.MjSpec.from_file(str(file))
    except (ValueError, OSError) as error:
        raise DataError(
            f"The model of robot {robot!r} cannot be read: {_in_one_line(error)}"
        ) from error


def compiled(spec: mujoco.MjSpec, robot: str) -> mujoco.MjModel:
    """The compiled model.

    Raises:
        DataError: If MuJoCo cannot compile it; the message has its reason.
    """
    with model_errors(robot):
        return spec.compile()


@contextmanager
def model_errors(robot: str) -> Iterator[None]:
    """Turn what MuJoCo refuses, while a model is added to or compiled, into one line.

    Raises:
        DataError: For MuJoCo's ValueError; the message has its reason. Errors of ours pass.
    """
    try:
        yield
    except FusionNetError:
        raise
    except ValueError as error:
        raise DataError(
            f"The model of robot {robot!r} cannot be compiled: {_in_one_line(error)}"
        ) from error


def _in_one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def check_parts(
    spec: mujoco.MjSpec,
    robot: str,
    *,
    joints: Iterable[str] = (),
    actuators: Iterable[str] = (),
    cameras: Iterable[str] = (),
    sites: Iterable[str] = (),
) -> None:
    """Accept a model that has all the named parts.

    Raises:
        DataError: If some are missing; the message lists them.
    """
    wanted = {"joint": joints, "actuator": actuators, "camera": cameras, "site": sites}
    missing = [
        f"{kind} {name!r}"
        for kind, names in wanted.items()
        for name in names
        if getattr(spec, kind)(name) is None
    ]
    if missing:
        raise DataError(
            f"The model of robot {robot!r} lacks {', '.join(missing)}; add what is missing to it."
        )


def freeze(
    spec: mujoco.MjSpec, robot: str, values: Mapping[str, float], *, moving: Set[str]
) -> None:
    """Fix every joint that does not move: put its body there and delete the joint.

    What drives, couples or measures such a joint goes with it, and so do keyframes.

    Args:
        spec: Changed in place.
        robot: Name, for messages.
        values: Joint values [rad, or m for slides]; 0 for joints not named. Balls and free
            joints stay where the model has them.
        moving: Joints that stay.

    Raises:
        DataError: If MuJoCo cannot compile the model.
    """
    model = compiled(spec, robot)
    data = mujoco.MjData(model)
    joints = [joint for joint in spec.joints if joint.name not in moving]
    for joint in joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            data.qpos[model.jnt_qposadr[joint.id]] = values.get(joint.name, 0.0)
    mujoco.mj_kinematics(model, data)
    _uncouple(spec, {joint.name for joint in joints} - {""})
    for joint in joints:
        body = joint.parent
        posed = data.body(body.id)
        parent = model.body_parentid[body.id]
        parent_from_robot, position, quaternion = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(parent_from_robot, data.xquat[parent])
        mujoco.mju_rotVecQuat(position, posed.xpos - data.xpos[parent], parent_from_robot)
        mujoco.mju_mulQuat(quaternion, parent_from_robot, posed.xquat)
        body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        body.pos, body.quat = position, quaternion
        spec.delete(joint)


def _uncouple(spec: mujoco.MjSpec, joints: Set[str]) -> None:
    """Delete what refers to joints that are about to be deleted."""
    driven = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    unwanted = [
        *(each for each in spec.actuators if each.trntype in driven and each.target in joints),
        *(
            each
            for each in spec.equalities
            if each.type == mujoco.mjtEq.mjEQ_JOINT and joints & {each.name1, each.name2}
        ),
        *(
            each
            for each in spec.sensors
            if each.objtype == mujoco.mjtObj.mjOBJ_JOINT and each.objname in joints
        ),
        *spec.keys,
    ]
    for element in unwanted:
        spec.delete(element)
