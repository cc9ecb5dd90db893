"""The thesis's FusionNet acts: from its training to `run` and `evaluate policy`."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fusionnet import rcl
from fusionnet.apps.cli import main
from fusionnet.blocks import apply, plan
from fusionnet.corpora import load_corpus
from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.sources import Sources
from fusionnet.errors import CheckpointError, InputError, NotUnderstoodError
from fusionnet.evaluation.policy import _blame
from fusionnet.models.target_text import target_tokens, written_tree
from fusionnet.models.thesis_fusionnet import ThesisFusionNet
from fusionnet.policy import Pose, ThesisAnswer, ThesisPolicy, load_policy
from fusionnet.simulation import joint_targets, make_world
from fusionnet.training.fusion_examples import FusionExamples
from tiny_treebank import write_tiny_treebank

SENTENCE = "put the red pyramid on the blue cube"
"""The first sentence of the examples' first scene."""


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> Path:
    sources = Sources(data=write_tiny_treebank(tmp_path_factory.mktemp("corpus")))
    folder = tmp_path_factory.mktemp("data") / "set"
    build(folder, plan_for("4", "treebank", sources, size=(320, 180), shard=4), sources)
    return folder


@pytest.fixture(scope="module")
def checkpoint(stored, tmp_path_factory) -> Path:
    """A FusionNet of a few steps, trained from the command line."""
    folder = tmp_path_factory.mktemp("trained")
    words = ["train", "fusion", str(stored), "--preset", "thesis-small"]
    words += ["--out", str(folder / "checkpoint"), "--work", str(folder / "work")]
    words += ["--batch", "2", "--loop.steps", "3", "--loop.no-tensorboard"]
    assert main([*words, "--check", "sim_val", "--checked", "1"]) == 0
    return folder / "checkpoint"


def test_it_runs_from_the_command_line(checkpoint, tmp_path, capsys) -> None:
    out = tmp_path / "run"
    words = ["run", SENTENCE, "--checkpoint", str(checkpoint), "--out", str(out)]
    assert main(words) in (0, 1)
    assert "answered" in capsys.readouterr().out
    result = json.loads((out / "result.json").read_text())
    assert result["policy"] == "fusion" and result["checkpoint"] == str(checkpoint)
    assert result["reference"] == "recorded" and isinstance(result["success"], bool)
    assert "written" in result["answer"] and "confidence" not in result["answer"]
    assert sorted([*result["files"], "result.json"]) == sorted(f.name for f in out.iterdir())
    page = (out / "index.html").read_text(encoding="utf-8")
    assert "What it answered" in page and "What it looked at" not in page


def test_it_is_evaluated_from_the_command_line(checkpoint, tmp_path, capsys) -> None:
    words = ["evaluate", "policy", "--corpus", "examples", "--checkpoint", str(checkpoint)]
    gallery = tmp_path / "failures.html"
    assert main([*words, "--episodes", "2", "--json", "--gallery", str(gallery)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["n"] == found["answered"] == 2 and found["joint_mse"] > 0
    assert set(found["outcomes"]) <= {"reached", "read wrong", "pointed wrong", "slipped"}
    assert "pointed at" in gallery.read_text(encoding="utf-8")


REFUSED = {
    "symbolic": (["run", SENTENCE, "--policy", "symbolic"], "no symbolic policy"),
    "check": (["run", SENTENCE, "--check"], "no planner to be checked against"),
    "closed loop": (["run", SENTENCE, "--closed-loop"], "cannot look again"),
    "both eyes": (["run", SENTENCE, "--eyes", "both"], "sees with one eye"),
    "evaluate symbolic": (["evaluate", "policy", "--policy", "symbolic"], "no symbolic policy"),
    "evaluate check": (["evaluate", "policy", "--check"], "no planner to be checked against"),
    "evaluate closed loop": (["evaluate", "policy", "--closed-loop"], "cannot look again"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_it_cannot_do_is_refused_in_one_line(name, checkpoint, tmp_path, capsys) -> None:
    words, reason = REFUSED[name]
    more = ["--corpus", "examples"] if words[0] == "evaluate" else ["--out", str(tmp_path / "out")]
    assert main([*words, "--checkpoint", str(checkpoint), *more]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and list(tmp_path.iterdir()) == []
    [line] = captured.err.strip().splitlines()
    assert line.startswith("fusionnet: ") and reason in line


def test_a_picture_gives_no_world(checkpoint, tmp_path, capsys) -> None:
    Image.fromarray(make_world(seed=1).image("left_eye")).save(tmp_path / "view.png")
    words = ["run", SENTENCE, "--image", str(tmp_path / "view.png"), "--json"]
    assert main([*words, "--checkpoint", str(checkpoint)]) == 2
    assert "reads no layout from a picture" in capsys.readouterr().err


def test_other_checkpoints_are_refused(checkpoint, tmp_path) -> None:
    with pytest.raises(CheckpointError, match="'nico'.*'gantry'"):
        load_policy(checkpoint, robot="gantry")
    detector = tmp_path / "detector"
    ThesisFusionNet.from_pretrained(checkpoint).detector.save(detector, {})
    with pytest.raises(CheckpointError, match="holds a 'retinanet' alone, which moves no arm"):
        load_policy(detector)


def test_its_answer_is_that_of_the_network_on_the_picture_as_it_was_trained(
    checkpoint, stored
) -> None:
    policy = load_policy(checkpoint)
    assert isinstance(policy, ThesisPolicy)
    network = policy.network
    examples = FusionExamples(stored, "sim", network.config.detector.frame)
    example = examples.example(0, network)
    seen = []
    answer_as_trained = network.answer
    network.answer = lambda images, said: seen.append(images) or answer_as_trained(images, said)
    image = make_world(seed=3).image("left_eye")
    answer = policy(image, "take the cube")
    assert seen[0].shape[1:] == example.picture.shape
    low, high = policy.robot.joint_limits.T
    for pose in (answer.grasp, answer.place):
        assert (low <= pose.joint_angles).all() and (pose.joint_angles <= high).all()
    raw = answer_as_trained(seen[0], ["take the cube"]).joints[0]
    clipped = raw.copy()
    clipped[:6], clipped[7:13] = np.clip(raw[:6], low, high), np.clip(raw[7:13], low, high)
    np.testing.assert_array_equal(answer.targets, clipped)
    with pytest.raises(NotUnderstoodError):
        policy(image, " ")
    with pytest.raises(InputError, match="Received 0 pictures"):
        policy([], "take the cube")


def test_a_sample_is_cropped_as_in_training(checkpoint, stored) -> None:
    """The nominal eye crops as the sample's own camera, which hardly differs."""
    policy = load_policy(checkpoint)
    frame = policy.network.config.detector.frame
    examples = FusionExamples(stored, "sim", frame)
    sample = examples.pictures.samples[0]
    own = examples.pictures._place(sample)
    nominal = policy._placement((sample["width"], sample["height"]))
    assert np.abs(np.subtract(nominal.part, own.part)).max() <= 8
    boxes = np.array([[30.0, 40.0, 60.0, 80.0]])
    np.testing.assert_allclose(nominal.to_picture(nominal.to_input(boxes)), boxes)


def test_answers_outside_the_limits_stop_there_and_cells_follow_from_the_poses(checkpoint) -> None:
    policy = load_policy(checkpoint)
    command = load_corpus("examples").commands[0]
    move = plan(command.tree, command.scene.before)
    exact = joint_targets(policy.robot, move)
    grasp, place = policy._poses(exact)
    assert (policy._cell(grasp), policy._cell(place)) == (move.source, move.target)
    beyond = exact.copy()
    beyond[0] = 9.0
    assert policy._poses(beyond)[0].joint_angles[0] == policy.robot.joint_limits[0, 1]
    away = Pose(policy.robot.poses["prepare"], 0.0)
    assert policy._cell(away) is None


@pytest.mark.parametrize("writes", ["rcl", "short"])
def test_what_is_written_is_read_as_the_tree_that_it_says(writes) -> None:
    for command in load_corpus("examples").commands[:5]:
        tokens = target_tokens(writes, command.sentence, rcl.format(command.tree))
        tree = written_tree(writes, tokens)
        assert rcl.format(tree, tokens=False) == rcl.format(command.tree, tokens=False)


def test_a_failure_is_blamed_on_what_was_written_or_on_where_the_hand_went() -> None:
    command = load_corpus("examples").commands[0]
    before, wanted = command.scene.before, plan(command.tree, command.scene.before)
    after = apply(wanted, before)
    pose = Pose(np.zeros(6), 0.0)
    right = ThesisAnswer(
        grasp=pose,
        place=pose,
        boxes=(),
        written=("take",),
        tree=command.tree,
        source_cell=wanted.source,
        target_cell=wanted.target,
        milliseconds={},
    )
    astray = dataclasses.replace(right, target_cell=None)
    unread = dataclasses.replace(right, tree=None)
    blamed = [_blame(a, wanted, before, after) for a in (right, astray, unread)]
    assert blamed == ["slipped", "pointed wrong", "read wrong"]
    assert unread.understood == "no tree: take" and unread.as_json()["tree"] is None
