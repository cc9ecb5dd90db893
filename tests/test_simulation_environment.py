"""The Gymnasium environment keeps Gymnasium's contract."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from fusionnet import register_environments
from fusionnet.blocks import plan
from fusionnet.errors import InputError, RenderingError
from fusionnet.simulation import joint_targets
from fusionnet.simulation.environment import PickPlace
from fusionnet.simulation.renderer import shared_renderer

SIZE = (128, 72)


@pytest.fixture(scope="module", autouse=True)
def graphics():
    try:
        shared_renderer("nico", SIZE)
    except RenderingError as error:
        pytest.skip(f"no pictures here: {error}")


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


def test_an_unknown_command_is_refused(environment):
    with pytest.raises(InputError, match="No command -1"):
        environment.reset(options={"command": -1})


def test_gymnasium_knows_the_environment_by_name():
    register_environments()
    made = gymnasium.make("fusionnet/PickPlace-v0", size=SIZE)
    observation, _ = made.reset(seed=4)
    assert made.observation_space.contains(observation)
