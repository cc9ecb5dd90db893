"""NICO's model against the URDF that its numbers come from."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from fusionnet import robots
from fusionnet.randomness import generator


@pytest.fixture(scope="module")
def urdf_model(data_folder: Path) -> mujoco.MjModel:
    """MuJoCo's own loading of NICO's URDF, without the meshes that are missing."""
    file = data_folder / "nico.urdf"
    if not file.exists():
        pytest.skip(f"NICO's URDF is not at {file}")
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", file.read_text(), flags=re.DOTALL)
    compiler = (
        '<compiler fusestatic="false" boundmass="1e-3" boundinertia="1e-6" balanceinertia="true"/>'
    )
    text = text.replace(
        '<robot name="complete">', f'<robot name="complete"><mujoco>{compiler}</mujoco>'
    )
    return mujoco.MjModel.from_xml_string(text)


def joint_names(model: mujoco.MjModel) -> list[str]:
    return [model.joint(i).name for i in range(model.njnt)]


def test_every_joint_stands_where_the_urdf_puts_it(urdf_model):
    model = robots.load("nico").complete_spec().compile()
    shared = [name for name in joint_names(urdf_model) if name in joint_names(model)]
    assert len(shared) == model.njnt == 32
    rng = generator(0, "nico against its URDF")
    data, urdf_data = mujoco.MjData(model), mujoco.MjData(urdf_model)
    bodies = [model.joint(name).bodyid[0] for name in shared]
    urdf_bodies = [urdf_model.joint(name).bodyid[0] for name in shared]
    for _ in range(300):
        for name in shared:
            angle = rng.uniform(*urdf_model.joint(name).range)
            data.joint(name).qpos = urdf_data.joint(name).qpos = angle
        mujoco.mj_kinematics(model, data)
        mujoco.mj_kinematics(urdf_model, urdf_data)
        np.testing.assert_allclose(data.xpos[bodies], urdf_data.xpos[urdf_bodies], atol=1e-6)
        np.testing.assert_allclose(data.xmat[bodies], urdf_data.xmat[urdf_bodies], atol=1e-6)


def test_freezing_the_other_joints_leaves_the_arm_where_the_urdf_puts_it(urdf_model):
    robot = robots.load("nico")
    model = robot.spec().compile()
    rng = generator(1, "nico against its URDF")
    data, urdf_data = mujoco.MjData(model), mujoco.MjData(urdf_model)
    for name, angle in {**robot.head_angles, **robot.resting_angles}.items():
        urdf_data.joint(name).qpos = angle
    palm = model.body("left_palm").id
    urdf_palm = urdf_model.joint("l_wrist_x").bodyid[0]
    head = model.body("head").id
    urdf_head = urdf_model.joint("head_y").bodyid[0]
    right = model.body("right_thumb_3").id
    urdf_right = urdf_model.joint("r_thumb_2nd_x").bodyid[0]
    for _ in range(50):
        for name in robot.joint_names:
            angle = rng.uniform(*urdf_model.joint(name).range)
            data.joint(name).qpos = urdf_data.joint(name).qpos = angle
        mujoco.mj_kinematics(model, data)
        mujoco.mj_kinematics(urdf_model, urdf_data)
        for ours, theirs in ((palm, urdf_palm), (head, urdf_head), (right, urdf_right)):
            np.testing.assert_allclose(data.xpos[ours], urdf_data.xpos[theirs], atol=1e-6)
            np.testing.assert_allclose(data.xmat[ours], urdf_data.xmat[theirs], atol=1e-6)


def test_joint_limits_are_the_urdfs(urdf_model):
    robot = robots.load("nico")
    for name, limits in zip(robot.joint_names, robot.joint_limits, strict=True):
        np.testing.assert_allclose(limits, urdf_model.joint(name).range)
