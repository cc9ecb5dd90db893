"""Two eyes as one sight, and the check that keeps a doubtful policy from moving."""

from dataclasses import replace

import numpy as np
import pytest

from fusionnet import load_policy, make_world
from fusionnet.apps.cli import EXIT_MISSED, main
from fusionnet.blocks import Cell, Move
from fusionnet.corpora import load_corpus
from fusionnet.errors import DoubtError, InputError
from fusionnet.evaluation.policy import PolicyEvaluation, evaluate
from fusionnet.policy import FARTHEST, Policy, both_seen, disagreement
from fusionnet.policy._eyes import pictures_of

SENTENCE = "put the red pyramid on the blue cube"
MOVE = Move(Cell(2, 2, 0), Cell(4, 4, 1), begins_held=False, ends_held=False)


@pytest.fixture(scope="module")
def scene():
    return load_corpus("examples", None).commands[0].scene


@pytest.fixture(scope="module")
def picture(scene):
    return make_world(layout=scene.before).image("left_eye")


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((60, 80, 3), np.float32),
        np.zeros((60, 80, 4), np.uint8),
        np.zeros((60, 80), np.uint8),
        np.zeros((0, 80, 3), np.uint8),
        [np.zeros((60, 80, 3), np.uint8), np.zeros((60, 80), np.uint8)],
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(wrong):
    with pytest.raises(InputError, match=r"height x width x 3 of uint8 .*; received"):
        pictures_of(wrong)


def test_pictures_of_both_eyes_may_be_one_array():
    both = np.zeros((2, 60, 80, 3), np.uint8)
    assert [p.shape for p in pictures_of(both)] == [(60, 80, 3)] * 2
    assert len(pictures_of(both[0])) == 1


def test_the_check_lets_a_neighbouring_cell_pass_and_nothing_farther():
    assert FARTHEST == 1
    for shift, agrees in ((0, True), (1, True), (2, False)):
        said = disagreement(replace(MOVE, source=Cell(2 + shift, 2, 0)), MOVE, 1.0)
        assert (said == "") is agrees
    assert "grasp at (4, 2, 0)" in said and "2 cells apart" in said
    said = disagreement(replace(MOVE, target=Cell(4, 4, 5)), MOVE, 1.0)
    assert "place at (4, 4, 5)" in said and "4 cells apart" in said


def test_the_check_wants_most_votes_for_one_move():
    assert disagreement(MOVE, MOVE, 0.9) == ""
    assert "only 30% of the layouts" in disagreement(MOVE, MOVE, 0.3)


@pytest.mark.parametrize(
    ("pointed", "elected", "said"),
    [
        ({"begins_held": True}, {}, "move a block that the hand already holds, and the planner"),
        ({}, {"begins_held": True}, "move a block that stands on the board, and the planner"),
        ({"ends_held": True}, {}, "keep the block in the hand, and the planner"),
        ({}, {"ends_held": True}, "let go of the block, and the planner"),
    ],
)
def test_the_check_wants_both_to_agree_on_the_gripper(pointed, elected, said):
    told = disagreement(replace(MOVE, **pointed), replace(MOVE, **elected), 1.0)
    assert told.startswith(f"the network would {said} would not")


def test_a_policy_that_checks_refuses_when_the_network_keeps_the_block(picture, monkeypatch):
    policy = load_policy("compact", check=True)
    right = policy.fusion.forward

    def kept(*given):
        answer = right(*given)
        return replace(answer, targets=np.append(answer.targets[:-1], 1.0))

    monkeypatch.setattr(policy.fusion, "forward", kept)
    with pytest.raises(DoubtError, match="would keep the block in the hand, and the planner"):
        policy(picture, SENTENCE)


def test_a_policy_that_checks_refuses_when_the_network_points_elsewhere(picture, monkeypatch):
    policy = load_policy("compact", check=True)
    policy(picture, SENTENCE)  # agrees here
    right = policy.fusion.forward

    def wrong(*given):
        return replace(right(*given), target_cell=Cell(0, 7, 7).index)

    monkeypatch.setattr(policy.fusion, "forward", wrong)
    with pytest.raises(DoubtError, match=r"would place at \(0, 7, 7\) and the planner at"):
        policy(picture, SENTENCE)


def test_the_check_looks_at_the_cells_that_the_arm_goes_to(picture, monkeypatch):
    """Not at the likeliest cell of either end alone, which another pair may hold."""
    policy = load_policy("compact", check=True)
    right = policy.fusion.forward
    answer = policy(picture, SENTENCE)

    def flat(*given):
        return replace(right(*given), source=np.full(512, 1 / 512), target=np.full(512, 1 / 512))

    monkeypatch.setattr(policy.fusion, "forward", flat)
    again = policy(picture, SENTENCE)
    assert (again.source_cell, again.target_cell) == (answer.source_cell, answer.target_cell)
    assert again.source_cell == answer.move.source and again.target_cell == answer.move.target


@pytest.mark.parametrize("wrong", [{"displaced": -5.0}, {"strength": float("nan")}])
def test_disturbances_that_are_none_are_refused(wrong):
    with pytest.raises(InputError, match="at least 0"):
        evaluate(PolicyEvaluation(corpus="examples", split="test", episodes=1, **wrong))


def test_run_with_check_says_why_it_does_not_move(monkeypatch, capsys):
    monkeypatch.setattr("fusionnet.policy._check.LEAST_AGREEMENT", 1.1)
    assert main(["run", SENTENCE, "--check", "--json"]) == EXIT_MISSED
    error = capsys.readouterr().err
    assert "rather not move" in error and error.count("\n") == 1


def test_doubted_episodes_are_no_wrong_moves(monkeypatch):
    monkeypatch.setattr("fusionnet.policy._check.LEAST_AGREEMENT", 1.1)
    config = PolicyEvaluation(corpus="examples", split="test", episodes=2, check=True)
    numbers = evaluate(config).as_json()
    assert numbers["outcomes"] == {"doubted": 2}
    assert numbers["wrong_moves"] == 0.0 and numbers["executed_success"] == 0.0


def test_one_eye_decides_where_the_other_sees_nothing(picture):
    sight = load_policy("compact").detector.see(picture)
    blind = replace(sight, cells=np.full_like(sight.cells, 1 / 17), holding=0.5)
    for pair in ([sight, blind], [blind, sight]):
        pooled = both_seen(pair)
        np.testing.assert_array_equal(pooled.cells.argmax(-1), sight.cells.argmax(-1))
        np.testing.assert_allclose(pooled.cells.sum(-1), 1.0)
        assert (pooled.holding > 0.5) == (sight.holding > 0.5)
    assert both_seen([sight]) is sight
    twice = both_seen([sight, sight], weight=0.5)
    np.testing.assert_allclose(twice.cells, sight.cells, atol=3e-5)


def test_pictures_and_eyes_must_match(picture):
    policy = load_policy("compact")
    one_eyed = Policy(policy.detector, policy.translator, policy.fusion)
    with pytest.raises(InputError, match="2 pictures.*1 eye .its checkpoint has no detector-right"):
        one_eyed((picture, picture), SENTENCE)
    with pytest.raises(InputError, match="0 pictures"):
        one_eyed((), SENTENCE)
    two_eyed = Policy(policy.detector, policy.translator, policy.fusion, right=policy.detector)
    both, one = two_eyed((picture, picture), SENTENCE), one_eyed(picture, SENTENCE)
    assert both.move == one.move
