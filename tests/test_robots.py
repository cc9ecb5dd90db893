"""What every robot in the catalogue must keep."""

import sys

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusionnet import robots
from fusionnet.blocks import apply
from fusionnet.blocks.grid import BLOCK_SIZE, Block, Cell, Color, Layout, Move, Shape
from fusionnet.catalogue import Catalogue
from fusionnet.errors import DataError, InputError, UnknownNameError
from fusionnet.randomness import generator
from fusionnet.simulation import World, joint_targets

every_robot = pytest.mark.parametrize("name", robots.names())


def test_nico_is_there():
    assert "nico" in robots.names()


def test_an_unknown_robot_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="No robot called 'nyco'.*Did you mean 'nico'"):
        robots.load("nyco")


@every_robot
def test_the_model_offers_what_the_simulation_needs(name):
    robot = robots.load(name)
    model = robot.spec().compile()
    assert robot.name == name
    assert {"left_eye", "right_eye"} <= {model.camera(i).name for i in range(model.ncam)}
    assert model.site("pinch").id >= 0
    movable = (*robot.joint_names, *robot.finger_positions)
    assert [model.joint(i).name for i in range(model.njnt)] == sorted(
        movable, key=lambda joint: model.joint(joint).id
    )
    assert {model.actuator(i).name for i in range(model.nu)} == set(movable)


@every_robot
def test_the_model_can_be_attached_to_a_world(name):
    robot = robots.load(name)
    world = mujoco.MjSpec()
    world.attach(robot.spec(), frame=world.worldbody.add_frame(), prefix="robot/")
    model = world.compile()
    data = mujoco.MjData(model)
    alone = robots.ArmKinematics(robot)
    for joint, value in zip(robot.joint_names, robot.poses["ready"], strict=True):
        data.joint("robot/" + joint).qpos = value
    mujoco.mj_kinematics(model, data)
    pinch = alone.robot_from_pinch(robot.poses["ready"])
    np.testing.assert_allclose(data.site("robot/pinch").xpos, pinch[:3, 3], atol=1e-9)


@every_robot
def test_poses_and_fingers_are_within_limits(name):
    robot = robots.load(name)
    assert {"seed", "prepare", "ready"} <= set(robot.poses)
    for pose in robot.poses.values():
        robot.check_joint_angles(pose)
    model = robot.spec().compile()
    for joint, positions in robot.finger_positions.items():
        low, high = model.joint(joint).range
        assert all(low - 1e-9 <= position <= high + 1e-9 for position in positions)


@every_robot
def test_the_jacobian_agrees_with_finite_differences(name):
    robot = robots.load(name)
    kinematics = robots.ArmKinematics(robot)
    rng = generator(0, "jacobian", name)
    low, high = robot.joint_limits.T
    for _ in range(5):
        joints = rng.uniform(low, high)
        jacobian = kinematics.jacobian(joints)
        here = kinematics.robot_from_pinch(joints)[:3, :3]
        for j in range(len(joints)):
            change = np.zeros(len(joints))
            change[j] = 1e-6
            after = kinematics.robot_from_pinch(joints + change)
            before = kinematics.robot_from_pinch(joints - change)
            difference = (after - before) / 2e-6
            np.testing.assert_allclose(jacobian[:3, j], difference[:3, 3], atol=1e-7)
            spin = difference[:3, :3] @ here.T
            expected = [spin[2, 1], spin[0, 2], spin[1, 0]]
            np.testing.assert_allclose(jacobian[3:, j], expected, atol=1e-7)


@every_robot
def test_cells_stand_on_the_table_top_and_one_block_apart(name):
    robot = robots.load(name)
    corner = robot.cell_position((0, 0, 0)) - BLOCK_SIZE / 2
    np.testing.assert_allclose(corner, robot.robot_from_board[:3, 3])
    assert corner[2] == robot.table_top.height
    for axis in range(3):
        neighbour = np.eye(3, dtype=int)[axis]
        apart = robot.cell_position(neighbour) - robot.cell_position((0, 0, 0))
        np.testing.assert_allclose(apart, neighbour * BLOCK_SIZE)
    far = robot.cell_position((7, 7, 0)) + BLOCK_SIZE / 2
    assert robot.table_top.x[0] < corner[0] < far[0] < robot.table_top.x[1]
    assert robot.table_top.y[0] < corner[1] < far[1] < robot.table_top.y[1]
    above = robot.pinch_position((3, 4, 5)) - robot.cell_position((3, 4, 5))
    np.testing.assert_allclose(above, [0, 0, BLOCK_SIZE / 2 + robot.pinch_clearance])


@every_robot
def test_the_shipped_table_keeps_its_laws(name):
    robot = robots.load(name)
    quality = robots.measure_joint_table(robot, robot.joint_table)
    assert quality.position_error <= 1e-4
    assert np.degrees(quality.tilt) <= 30
    assert np.all(quality.limit_margin >= 0)
    turning = np.array([joint not in robot.sliding_joints for joint in robot.joint_names])
    assert np.all(np.degrees(quality.adjacent[turning]) <= 15)
    assert np.all(quality.adjacent[~turning] <= BLOCK_SIZE + 1e-6)
    if turning.any():
        assert np.degrees(quality.cubic_residual[turning].mean()) <= 0.3
    assert np.all(quality.cubic_residual[~turning] <= 1e-5)


@every_robot
def test_the_shipped_table_is_what_the_command_makes(name):
    robot = robots.load(name)
    np.testing.assert_allclose(robots.make_joint_table(robot), robot.joint_table, atol=1e-5)


@every_robot
def test_table_rows_come_out_as_copies(name):
    robot = robots.load(name)
    robot.joint_angles((1, 2, 3))[:] = 0
    np.testing.assert_array_equal(robot.joint_angles((1, 2, 3)), robot.joint_table[1, 2, 3])
    with pytest.raises(ValueError, match="read-only"):
        robot.joint_table[0, 0, 0] = 0
    with pytest.raises(InputError, match="not on the grid"):
        robot.joint_angles((0, 0, 8))


@every_robot
@given(data=st.data())
def test_unscaling_inverts_scaling(name, data):
    robot = robots.load(name)
    n = len(robot.joint_names)
    width = data.draw(st.sampled_from([n, 2 * n + 2]))
    unit = st.floats(0, 1)
    scaled = np.array(data.draw(st.lists(unit, min_size=width, max_size=width)))
    values = robot.unscale(scaled)
    np.testing.assert_allclose(robot.scale(values), scaled, atol=1e-12)
    if width == n:
        robot.check_joint_angles(values)
    else:
        np.testing.assert_array_equal(values[[n, -1]], scaled[[n, -1]])


@every_robot
def test_scaling_refuses_another_robots_width(name):
    robot = robots.load(name)
    with pytest.raises(InputError, match="can be scaled; received 5"):
        robot.scale(np.zeros((2, 5)))


@every_robot
def test_postures_that_the_arm_cannot_take_are_refused(name):
    robot = robots.load(name)
    good = robot.poses["ready"]
    with pytest.raises(InputError, match=r"received an array of shape \(\d+,\)"):
        robot.check_joint_angles(np.append(good, 0.0))
    for index, joint in enumerate(robot.joint_names):
        bad = good.copy()
        bad[index] = np.nan
        with pytest.raises(InputError, match=f"{joint!r} was given nan"):
            robot.check_joint_angles(bad)
        bad[index] = robot.joint_limits[index, 1] + 0.1
        with pytest.raises(
            InputError, match=f"{joint!r} cannot go to .*(\N{DEGREE SIGN}|mm); its limits"
        ):
            robot.check_joint_angles(bad)


def test_values_are_shown_in_degrees_or_millimetres():
    nico, gantry = robots.load("nico"), robots.load("gantry")
    assert nico.with_unit(nico.joint_names[0], np.pi / 4) == "45.0\N{DEGREE SIGN}"
    assert gantry.with_unit("gantry_x", 0.0125, 2) == "12.50 mm"
    assert nico.joint_units == ["rad"] * 6 and gantry.joint_units == ["m"] * 3


def renamed(robot: robots.Robot, tmp_path, **changes) -> robots.Robot:
    """The robot as a newcomer would write it, in a folder of their own."""
    from dataclasses import replace

    return replace(robot, name="mine", model_file=tmp_path / "model.xml", **changes)


def test_a_broken_model_is_reported_with_its_line(tmp_path):
    robot = renamed(robots.load("nico"), tmp_path)
    with pytest.raises(DataError, match="robot 'mine' cannot be read"):
        robot.spec()
    robot.model_file.write_text("<mujoco>\n<worldbody>\n<bodie/></worldbody></mujoco>")
    with pytest.raises(DataError, match="bodie.*line 3|line 3.*bodie"):
        robot.spec()


def test_a_model_without_its_parts_names_them(tmp_path):
    robot = renamed(robots.load("nico"), tmp_path)
    text = robots.load("nico").model_file.read_text()
    robot.model_file.write_text(text.replace('"left_eye"', '"third_eye"'))
    with pytest.raises(DataError, match="robot 'mine' lacks camera 'left_eye'"):
        robot.spec()
    poses = {pose: values[:2] for pose, values in robot.poses.items()}
    joints = ("l_shoulder_z", "l_tail")
    robot = renamed(robots.load("nico"), tmp_path, joint_names=joints, poses=poses)
    with pytest.raises(DataError, match="lacks joint 'l_tail', actuator 'l_tail'"):
        _ = robot.joint_limits
    robot.model_file.write_text(text.replace('material name="grey"', 'material name="pink"'))
    with pytest.raises(DataError, match="robot 'mine' cannot be compiled.*grey"):
        renamed(robots.load("nico"), tmp_path).spec()


@pytest.mark.parametrize(
    ("written", "reason"),
    [
        ("\nROBOT = (", r"'\(' was never closed \(.*zoo.mine.__init__.py, line 2\)"),
        ("from json import nothing", r"cannot import name 'nothing'.*__init__.py, line 1\)"),
        ("\n\nROBOT = Robot()", r"'Robot' is not defined \(.*__init__.py, line 3\)"),
        ("\nx = {}['arm']", r"KeyError.'arm'. \(.*__init__.py, line 2\)"),
        ("int('six')", r"invalid literal .* \(.*__init__.py, line 1\)"),
        ("open('/no/such/table')", r"No such file .* \(.*__init__.py, line 1\)"),
        ("ROBBOT = 1", "__init__.py lacks ROBOT; define it there"),
    ],
)
def test_a_broken_folder_is_reported_with_its_line(written, reason, tmp_path, monkeypatch):
    (tmp_path / "zoo" / "mine").mkdir(parents=True)
    (tmp_path / "zoo" / "__init__.py").touch()
    (tmp_path / "zoo" / "mine" / "__init__.py").write_text(written)
    monkeypatch.syspath_prepend(tmp_path)
    for module in ("zoo", "zoo.mine"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(DataError, match=f"The robot 'mine' cannot be loaded: .*{reason}"):
        Catalogue("zoo", kind="robot", attribute="ROBOT").load("mine")


def test_poses_and_limits_that_are_missing_are_named(tmp_path):
    nico = robots.load("nico")
    poses = dict(nico.poses)
    with pytest.raises(DataError, match="'ready' of robot 'mine' has shape .3,.; it needs a value"):
        renamed(nico, tmp_path, poses={**poses, "ready": np.zeros(3)})
    del poses["prepare"]
    with pytest.raises(DataError, match="'mine' lacks the poses prepare"):
        renamed(nico, tmp_path, poses=poses)
    gantry = robots.load("gantry")
    text = gantry.model_file.read_text().replace('inheritrange="1"', "")
    (tmp_path / "model.xml").write_text(text.replace('axis="1 0 0" range="-0.14 0.14"', ""))
    with pytest.raises(
        DataError, match="'gantry_x' of robot 'mine' has the range 0 to 0; give it one"
    ):
        _ = renamed(gantry, tmp_path).joint_limits


def test_joints_that_nobody_mentions_are_frozen_at_zero(tmp_path):
    nico = robots.load("nico")
    robot = renamed(nico, tmp_path, head_angles={}, resting_angles={})
    robot.model_file.write_text(nico.model_file.read_text())
    frozen = robot.spec().compile()
    zeros = {joint: 0.0 for joint in (*nico.head_angles, *nico.resting_angles)}
    named = renamed(nico, tmp_path, head_angles={}, resting_angles=zeros).spec().compile()
    assert frozen.njnt == len(nico.joint_names) + len(nico.finger_positions)
    np.testing.assert_array_equal(frozen.body_quat, named.body_quat)


def test_a_models_own_parts_are_no_obstacle(tmp_path, request):
    gantry = robots.load("gantry")
    text = gantry.model_file.read_text()
    lever = '<body pos="0 0.2 0"><joint/><geom size="0.01" mass="0.1"/></body>'
    parts = """
      <equality>
        <joint joint1="finger_left" joint2="finger_right" polycoef="0 -1 0 0 0"/>
        <joint joint1="finger_left" joint2="spare"/>
      </equality>
      <tendon><fixed name="grip"><joint joint="finger_left" coef="1"/></fixed></tendon>
      <sensor><jointpos joint="gantry_z"/><jointpos joint="spare"/></sensor>
      <keyframe><key name="home" qpos="0 0 0 0 0 0 0"/></keyframe>
    """
    spare = '<body><joint name="spare" type="slide"/><geom size="0.01" mass="0.1"/></body>'
    text = text.replace('<body name="head"', f'<light pos="0 0 2"/>{lever}{spare}<body name="head"')
    text = text.replace("</actuator>", '<position joint="spare" name="spare"/></actuator>')
    robot = renamed(gantry, tmp_path)
    robot.model_file.write_text(text.replace("</mujoco>", f"{parts}</mujoco>"))
    robots.save_joint_table(robot, gantry.joint_table)
    block = Block(Color.RED, Shape.CUBE, Cell(3, 3, 0))
    layout, move = Layout((block,)), Move(block.cell, Cell(3, 4, 0))
    world = World(robot, layout)
    targets = joint_targets(robot, move)
    episode = world.execute(targets, expected=apply(move, layout))
    assert episode.success and not episode.stopped, episode.reason
    request.getfixturevalue("pictures_here")
    assert world.image("left_eye", (64, 36)).any()


def test_a_name_that_the_world_needs_is_refused_in_one_line(tmp_path):
    gantry = robots.load("gantry")
    robot = renamed(gantry, tmp_path)
    text = gantry.model_file.read_text()
    robot.model_file.write_text(text.replace('<geom class="trunk"', '<geom name="floor"', 1))
    with pytest.raises(DataError, match="robot 'mine' cannot be compiled.*floor") as refused:
        World(robot, Layout(()))
    assert "\n" not in str(refused.value)


def test_a_missing_or_foreign_table_is_refused(tmp_path):
    robot = renamed(robots.load("nico"), tmp_path)
    with pytest.raises(DataError, match="no usable joint table.*make_joint_table"):
        _ = robot.joint_table
    np.save(robot.joint_table_file, np.zeros((8, 8, 8, 3)))
    with pytest.raises(DataError, match=r"shape \(8, 8, 8, 3\)"):
        _ = robot.joint_table
    robots.save_joint_table(robot, robots.load("nico").joint_table)
    np.testing.assert_array_equal(robot.joint_table, robots.load("nico").joint_table)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["joint_table.npy"]
