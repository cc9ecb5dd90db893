"""The Gymnasium environment keeps Gymnasium's contract."""

import os
import signal
import subprocess
import sys
from contextlib import nullcontext

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from fusionnet.blocks import plan
from fusionnet.errors import InputError
from fusionnet.randomness import derived_seed
from fusionnet.robots import ArmKinematics
from fusionnet.simulation import joint_targets, servo_environment, viewer, world
from fusionnet.simulation.environment import PickPlace
from fusionnet.simulation.motion import PathPlanner
from fusionnet.simulation.offscreen import Offscreen
from fusionnet.simulation.servo_environment import PickPlaceServo
from tiny_treebank import ask_the_impossible, write_tiny_treebank

SIZE = (128, 72)


@pytest.fixture(scope="module", autouse=True)
def graphics(pictures_here):
    """Everything here looks."""


@pytest.fixture
def environment():
    return PickPlace(size=SIZE, render_mode="rgb_array")


# Gymnasium would like actions between -1 and 1; ours are angles, as the thesis's are.
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space:UserWarning")
def test_gymnasiums_own_check_passes(environment):
    check_env(environment, skip_render_check=True)


def test_the_right_angles_are_rewarded(environment):
    for identity, command in list(environment.commands.items())[:3]:
        observation, info = environment.reset(options={"command": identity})
        assert info["command"] == identity
        assert observation["sentence"] == command.sentence
        move = plan(command.tree, command.scene.before)
        targets = joint_targets("nico", move)
        assert environment.action_space.contains(targets)
        _, reward, terminated, truncated, info = environment.step(targets)
        assert (reward, terminated, truncated) == (1.0, True, False), info["reason"]
        assert info["success"] is True


def test_a_wrong_place_is_not_rewarded(environment):
    identity, command = next(iter(environment.commands.items()))
    environment.reset(options={"command": identity})
    targets = joint_targets("nico", plan(command.tree, command.scene.before))
    _, reward, _, _, info = environment.step(np.r_[targets[7:13], 0.0, targets[:6], 0.0])
    assert reward == 0.0
    assert info["success"] is False
    assert info["reason"].endswith(".")


def test_the_start_follows_the_seed():
    environment = PickPlace(size=SIZE, varied=True)
    one, _ = environment.reset(seed=1)
    same, _ = environment.reset(seed=1)
    other, _ = environment.reset(seed=2)
    np.testing.assert_array_equal(one["left_eye"], same["left_eye"])
    assert one["sentence"] == same["sentence"]
    assert not np.array_equal(one["left_eye"], other["left_eye"])


def test_the_external_camera_shows_the_world(environment):
    environment.reset(seed=0)
    assert environment.render().shape == (72, 128, 3)
    assert PickPlace(size=SIZE).render() is None


def test_a_size_may_be_a_list_and_must_fit():
    environment = PickPlace(size=[64, 36.0])
    assert environment.reset(seed=0)[0]["left_eye"].shape == (36, 64, 3)
    with pytest.raises(InputError, match="cannot have the size"):
        PickPlace(size=(64, 0))


def test_an_unknown_command_is_refused(environment):
    with pytest.raises(InputError, match="No command -1"):
        environment.reset(options={"command": -1})


def test_commands_that_cannot_be_executed_are_left_out(tmp_path):
    data = ask_the_impossible(write_tiny_treebank(tmp_path), 2, 5)
    environment = PickPlace(corpus="treebank", data=data, size=SIZE)
    assert len(environment.commands) == 38 and not {2, 5} & environment.commands.keys()
    ask_the_impossible(data)
    with pytest.raises(InputError, match="has no commands that can be executed"):
        PickPlace(corpus="treebank", data=data, size=SIZE)


@pytest.mark.parametrize("name", ["PickPlace", "PickPlaceServo"])
def test_gymnasium_knows_the_environment_by_name(name):
    made = gymnasium.make(f"fusionnet/{name}-v0", size=SIZE)
    observation, _ = made.reset(seed=4)
    assert made.observation_space.contains(observation)


def test_importing_fusionnet_registers_the_environments():
    code = (
        "import fusionnet, gymnasium; print(*(i for i in gymnasium.registry if 'fusionnet/' in i))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ran.stdout.split() == ["fusionnet/PickPlace-v0", "fusionnet/PickPlaceServo-v0"]


def test_human_mode_shows_the_motion_in_a_window(monkeypatch):
    events = []

    class Viewer(world.LiveViewer):
        def __init__(self, *_):
            events.append("opened")

        def show(self):
            events.append("shown")

        def close(self):
            events.append("closed")

    monkeypatch.setattr(world, "LiveViewer", Viewer)
    environment = PickPlace(size=SIZE, render_mode="human")
    environment.reset(seed=0)
    assert environment.render() is None
    identity, command = next(iter(environment.commands.items()))
    environment.reset(options={"command": identity})
    environment.step(joint_targets("nico", plan(command.tree, command.scene.before)))
    environment.close()
    assert events[0] == "opened" and events[-1] == "closed"
    assert events.count("shown") > 50 and events.count("closed") == 2
    with pytest.raises(InputError, match="No render mode 'sculpture'"):
        PickPlace(render_mode="sculpture")


def test_the_window_shows_the_world_in_good_light(monkeypatch):
    class Window:
        cam = mujoco.MjvCamera()

        def __init__(self, model, data):
            self.model, self.data = model, data
            self.user_scn = mujoco.MjvScene(model, 200)

        def lock(self):
            return nullcontext()

        def is_running(self):
            return True

        def sync(self):
            pass

    windows = []
    monkeypatch.setattr(
        viewer, "_open_window", lambda *world: windows.append(Window(*world)) or windows[0]
    )
    world.make_world(seed=1).watch()
    (window,) = windows
    drawn = Offscreen(window.model, (128, 72))
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(
        window.model, window.data, mujoco.MjvOption(), None, window.cam, everything, drawn.scene
    )
    for shape in window.user_scn.geoms[: window.user_scn.ngeom]:
        copy = drawn.scene.geoms[drawn.scene.ngeom]
        mujoco.mjv_initGeom(copy, shape.type, shape.size, shape.pos, shape.mat.ravel(), shape.rgba)
        drawn.scene.ngeom += 1
    picture = drawn.picture()
    drawn.close()
    assert 80 < picture.mean() < 160  # it was 49 with MuJoCo's own lamp
    assert (picture.max(axis=2) > 180).mean() > 0.02  # NICO is white


class TestServo:
    """Joint targets at 20 Hz."""

    @pytest.fixture
    def servo(self):
        return PickPlaceServo(size=(64, 36))

    @pytest.mark.filterwarnings("ignore:.*symmetric and normalized space:UserWarning")
    def test_gymnasiums_own_check_passes(self, servo):
        check_env(servo, skip_render_check=True)

    def test_a_block_is_carried_step_by_step(self, servo):
        identity, command = next(iter(servo.commands.items()))
        observation, _ = servo.reset(options={"command": identity})
        move = plan(command.tree, command.scene.before)
        robot = servo.robot
        planner = PathPlanner(ArmKinematics(robot))

        def above(cell):
            return planner.upwards(robot.joint_angles(cell), robot.pinch_position((0, 0, 5))[2])[-1]

        grasp, place = robot.joint_angles(move.source), robot.joint_angles(move.target)
        way = [
            *((robot.poses["ready"], 0, 30), (above(move.source), 0, 20), (grasp, 0, 24)),
            *((grasp, 0, 4), (grasp, 1, 2), (above(move.source), 1, 24)),
            *((above(move.target), 1, 24), (place, 1, 24), (place, 1, 4), (place, 0, 10)),
        ]
        here, success, seen = observation["joint_positions"], False, []
        for there, gripper, steps in way:
            for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
                assert not success
                action = np.r_[here + share * (there - here), gripper]
                observation, reward, success, cut, info = servo.step(action)
                assert reward == float(success) and not cut
                assert observation["gripper"] == gripper
                seen.append(observation["left_eye"].mean())
                if success:
                    break
            here = there
        assert success, info["reason"]
        assert info["touched"] == () and info["seconds"] == len(seen) / 20
        assert len(set(seen)) > 50  # the picture changes with the motion

    @pytest.mark.parametrize(
        ("identity", "offset", "lands"),
        [(8, (0.0, 0.0, 0.0119), True), (7, (0.013, 0.0, 0.01), False)],
    )
    def test_a_block_in_the_air_is_not_rewarded(self, identity, offset, lands):
        servo = PickPlaceServo("gantry", size=(64, 36))
        observation, _ = servo.reset(options={"command": identity})
        command = servo.commands[identity]
        move = plan(command.tree, command.scene.before)
        here, place = observation["joint_positions"], servo.robot.joint_angles(move.target)
        for there in ([*place[:2], here[2]], place + offset):
            for share in np.linspace(0.0, 1.0, 13)[1:]:
                servo.step(np.r_[here + share * (there - here), 1])
            here = np.array(there)
        rewards = [servo.step(np.r_[here, 0])[1] for _ in range(12)]
        assert not any(rewards[:4])
        assert any(rewards) == lands

    def test_an_idle_arm_is_cut_off_and_a_bad_target_refused(self, servo, monkeypatch):
        monkeypatch.setattr(servo_environment, "LONGEST", 0.1)
        observation, _ = servo.reset(seed=0)
        still = np.r_[observation["joint_positions"], 0.0]
        _, _, terminated, truncated, info = servo.step(still)
        assert not terminated and not truncated and "from where one belongs" in info["reason"]
        assert servo.step(still)[3] is True
        with pytest.raises(InputError, match="l_wrist_x"):
            servo.step(still + [0, 0, 0, 0, 0, 9.0, 0])
        for bad in (np.r_[still[:-1], np.nan], still[:-1], np.r_[still, 0.0], np.zeros(0)):
            with pytest.raises(InputError, match="An action is 7 finite numbers, l_shoulder_z"):
                servo.step(bad)


def test_a_crashed_worker_is_reported_and_the_others_results_are_kept():
    vector = gymnasium.make_vec("fusionnet/PickPlace-v0", num_envs=2, size=(64, 36))
    try:
        single = PickPlace(size=(64, 36))
        together, infos = vector.reset(seed=7)
        for index in range(2):
            alone, info = single.reset(seed=7 + index)
            assert infos["command"][index] == info["command"]
            assert together["sentence"][index] == alone["sentence"]
            np.testing.assert_array_equal(together["left_eye"][index], alone["left_eye"])
        command = single.commands[infos["command"][1]]
        targets = joint_targets("nico", plan(command.tree, command.scene.before))
        expected = single.step(targets)[4]["episode"]

        os.kill(vector.unwrapped.workers[0].pid, signal.SIGKILL)
        _, rewards, terminated, truncated, infos = vector.step(np.stack([targets, targets]))
        assert "signal 9" in infos["error"][0] and not infos["error"][1]
        assert rewards.tolist() == [0.0, 1.0]
        assert terminated.tolist() == [False, True] and truncated.tolist() == [True, False]
        assert infos["episode"]["errors_mm"][1] == expected["errors_mm"]  # as in one process

        _, _, terminated, truncated, infos = vector.step(np.stack([targets, targets]))
        assert not terminated.any() and not truncated.any()  # both begin anew
        again = PickPlace(size=(64, 36)).reset(seed=derived_seed(7, "replacement", 1))[1]
        assert infos["command"][0] == again["command"]
        with pytest.raises(InputError, match="3 actions were given for 2 environments"):
            vector.step(np.stack([targets] * 3))
        with pytest.raises(InputError, match="1 seeds were given for 2 environments"):
            vector.reset(seed=[7])
        _, _, _, truncated, infos = vector.step(np.stack([targets, np.full(14, np.nan)]))
        assert "finite" in infos["error"][1] and truncated.tolist() == [False, True]
    finally:
        vector.close()
