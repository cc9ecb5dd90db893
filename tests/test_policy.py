import json
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from fusionnet import load_policy, make_world
from fusionnet.corpora import load_corpus
from fusionnet.errors import CheckpointError, InputError, PlanningError, UnknownNameError
from fusionnet.evaluation import policy as evaluation
from fusionnet.evaluation.intervals import wilson_interval
from fusionnet.evaluation.policy import EpisodeRecord, PolicyEvaluation, evaluate, joint_errors
from fusionnet.policy import Answer
from fusionnet.robots import load as load_robot
from fusionnet.simulation import joint_targets
from tiny_treebank import ask_the_impossible, write_tiny_treebank

SENTENCE = "put the red pyramid on the blue cube"


@pytest.fixture(scope="module")
def scene():
    command = load_corpus("examples", None).commands[0]
    assert command.sentence == SENTENCE
    return command.scene


@pytest.fixture(scope="module")
def picture(scene):
    return make_world(layout=scene.before).image("left_eye")


@pytest.mark.parametrize("kind", ["fusion", "symbolic"])
def test_the_first_example_is_answered_and_lands(kind, scene, picture):
    answer = load_policy("compact", kind)(picture, SENTENCE)
    episode = make_world(layout=scene.before).execute(answer, expected=scene.after)
    assert episode.success, episode.reason


def test_the_symbolic_angles_are_those_of_the_joint_table(picture):
    answer = load_policy("compact", "symbolic")(picture, SENTENCE)
    np.testing.assert_array_equal(answer.targets, joint_targets("nico", answer.move))


def test_both_policies_show_the_same_evidence(picture):
    fusion, symbolic = (
        load_policy("compact", k)(picture, SENTENCE) for k in ("fusion", "symbolic")
    )
    np.testing.assert_array_equal(fusion.cells, symbolic.cells)
    assert fusion.layout == symbolic.layout and fusion.move == symbolic.move
    assert fusion.boxes == symbolic.boxes


def test_an_answer_is_reproducible_and_goes_to_json(picture):
    one, two = (load_policy("compact")(picture, SENTENCE) for _ in range(2))
    np.testing.assert_array_equal(one.targets, two.targets)
    document = json.loads(json.dumps(one.as_json(), allow_nan=False))
    assert document["symbolic_move"]["source"] == list(one.move.source)
    assert len(document["grasp"]["joint_values"]) == 6
    assert one.source.sum() == pytest.approx(1.0, abs=1e-3)
    assert one.target.sum() == pytest.approx(1.0, abs=1e-3)
    assert set(one.milliseconds) == {"see", "read", "vote", "fuse"}


def test_the_angles_depend_on_the_sentence_and_on_the_picture(scene, picture):
    policy = load_policy("compact")
    blue = policy(picture, "take the blue cube")
    red = policy(picture, "take the red pyramid")
    assert np.abs(blue.grasp.joint_angles - red.grasp.joint_angles).max() > np.radians(1.0)
    assert (blue.place.gripper > 0.5) and (red.place.gripper > 0.5)
    moved = make_world(layout=scene.after).image("left_eye")
    again = policy(moved, "take the red pyramid")
    assert np.abs(again.grasp.joint_angles - red.grasp.joint_angles).max() > np.radians(1.0)


def test_a_block_that_is_not_there_is_named(picture):
    with pytest.raises(PlanningError, match="green pyramid"):
        load_policy("compact")(picture, "take the green pyramid")


def test_unknown_policies_and_missing_checkpoints(tmp_path):
    with pytest.raises(UnknownNameError, match="No policy called 'compat'.*Did you mean 'compact'"):
        load_policy("compat")
    with pytest.raises(CheckpointError, match="No checkpoint at"):
        load_policy(tmp_path)


def test_wilson_interval():
    assert wilson_interval(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert wilson_interval(0, 20)[0] == 0.0 and wilson_interval(20, 20)[1] == 1.0
    with pytest.raises(ValueError, match="successes <= trials"):
        wilson_interval(3, 2)


def test_joint_errors_are_means_over_the_joints():
    robot = load_robot("nico")
    wanted = np.concatenate([robot.joint_table[1, 2, 0], [0], robot.joint_table[4, 4, 1], [0]])
    given = wanted.copy()
    given[2] += np.radians(6.0)
    given[-1] = 1.0
    squared, grasp, place = joint_errors(robot, given, wanted)
    assert (grasp, place) == pytest.approx((1.0, 0.0))
    low, high = robot.joint_limits[2]
    assert squared == pytest.approx(((np.radians(6.0) / (high - low)) ** 2 + 1.0) / 14)


def test_degrees_are_for_joints_that_turn():
    gantry, answer = load_robot("gantry"), Mock(spec=Answer, targets=np.zeros(8))
    wanted = np.r_[0.1, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert joint_errors(gantry, np.zeros(8), wanted)[1:] == (0.0, 0.0)
    disturbed = evaluation._disturbed(gantry, answer, PolicyEvaluation(joint_noise=9.0), 0)
    np.testing.assert_array_equal(disturbed, answer.targets)


def test_an_evaluation_counts_every_episode_once():
    config = PolicyEvaluation(corpus="examples", split="test", policy="symbolic", episodes=3)
    report = evaluate(config)
    numbers = report.as_json()
    assert numbers["n"] == sum(numbers["outcomes"].values()) == 3
    low, high = numbers["executed_success_95"]
    assert low <= numbers["executed_success"] <= high
    assert [r.command for r in evaluate(config).records] == [r.command for r in report.records]


def test_commands_that_cannot_be_executed_are_counted_and_left_out(tmp_path, monkeypatch):
    data = write_tiny_treebank(tmp_path)
    first, *others = [c.id for c in load_corpus("treebank", data).split("test")]
    ask_the_impossible(data, first)
    config = PolicyEvaluation(data=data, policy="symbolic", episodes=len(others))
    asked = []
    row = EpisodeRecord(0, "reached", "", 0.0, 0.0, 0.0, 1.0)
    monkeypatch.setattr(evaluation, "load_policy", lambda *_, **__: None)
    monkeypatch.setattr(
        evaluation,
        "_episode",
        lambda policy, command, *_: asked.append(command.id) or SimpleNamespace(record=row),
    )
    report = evaluate(config)
    assert sorted(asked) == others
    assert report.as_json()["not_executable"] == 1
    ask_the_impossible(data)
    with pytest.raises(InputError, match=f"can be executed, and {1 + len(others)} that cannot"):
        evaluate(config)


def test_an_evaluation_needs_episodes():
    with pytest.raises(InputError, match="At least one episode"):
        evaluate(PolicyEvaluation(corpus="examples", episodes=0))
