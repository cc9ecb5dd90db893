"""How the shipped detector is measured, on stored pictures and on rendered ones."""

import dataclasses
import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from dataset_fixtures import small_plan, small_sources
from fusionnet.apps.cli import main
from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset.build import build
from fusionnet.dataset.reader import StoredPictures
from fusionnet.errors import CheckpointError, InputError
from fusionnet.evaluation.detection import DetectionEvaluation, calibration_error, evaluate
from fusionnet.models import policy_folder
from fusionnet.models.retinanet import RetinaNet
from fusionnet.training.placement_pictures import PlacementPictures
from test_retinanet import tiny
from tiny_treebank import write_tiny_treebank


def test_stored_pictures_are_measured(tmp_path):
    sources = small_sources(tmp_path / "sources")
    build(tmp_path / "set", small_plan(sources, size=(960, 540)), sources)
    by_eye = evaluate(DetectionEvaluation(dataset=tmp_path / "set", split="sim", pictures=9))
    assert by_eye["n"] == 1 and by_eye["clearly_visible_blocks_right"] == 1.0
    assert by_eye["map_50"] > 0.9 and 0 <= by_eye["calibration_error"] < 0.2
    in_view = evaluate(DetectionEvaluation(dataset=tmp_path / "set", split="val"))
    assert in_view["n"] == 1 and in_view["map_50"] > 0.5 and "layouts_right" not in in_view


def test_rendered_pictures_are_measured(tmp_path):
    data = write_tiny_treebank(tmp_path / "corpus")
    seen = []
    measured = evaluate(
        DetectionEvaluation(data=data, split="train", pictures=2),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen == [(1, 2), (2, 2)] and measured["layouts_right"] >= 0.5
    counted = sum(kind["instances"] for kind in measured["classes"].values())
    lenient = measured["without_mostly_hidden_blocks"]["classes"].values()
    assert counted >= sum(kind["instances"] for kind in lenient) > 0
    with pytest.raises(InputError, match="name a data set"):
        evaluate(DetectionEvaluation(data=data, split="sim"))
    with pytest.raises(InputError, match="At least one picture"):
        evaluate(DetectionEvaluation(data=data, pictures=0))


RIGHT = policy_folder.weights_folder("compact") / "detector-right"


def test_a_detector_of_the_right_eye_is_measured_through_it(tmp_path):
    data = write_tiny_treebank(tmp_path / "corpus")
    right = DetectionEvaluation(data=data, split="train", pictures=2, checkpoint=str(RIGHT))
    assert evaluate(right)["layouts_right"] >= 0.5


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    sources = small_sources(tmp_path_factory.mktemp("sources"))
    folder = tmp_path_factory.mktemp("data") / "set"
    build(folder, small_plan(sources), sources)
    return folder


def test_a_detector_of_boxes_is_measured_by_class(stored, tmp_path, capsys):
    tiny().save(tmp_path / "thesis", {}, half=False)
    command = ["evaluate", "detector", str(stored), "--split", "val", "--checkpoint"]
    assert main([*command, str(tmp_path / "thesis"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    pictures = PlacementPictures(stored, "val", tiny().frame)
    truth = np.concatenate([pictures.boxes(i).classes.numpy() for i in range(len(pictures))])
    assert said["n"] == len(pictures) and said["milliseconds_a_picture"] > 0
    for number, name in enumerate(CLASS_NAMES):
        assert said["classes"][name]["instances"] == (truth == number).sum()
    assert main([*command, str(tmp_path / "thesis")]) == 0
    shown = capsys.readouterr().out
    assert "instances" in shown and CLASS_NAMES[int(truth[0])] in shown
    assert main(["evaluate", "detector", "--checkpoint", str(tmp_path / "thesis")]) == 2
    assert "measured on a data set" in capsys.readouterr().err


def test_a_data_set_of_another_eye_is_refused(stored, tmp_path):
    def measured(split, checkpoint=RIGHT):
        return evaluate(
            DetectionEvaluation(dataset=stored, split=split, checkpoint=str(checkpoint), pictures=1)
        )

    for split in ("train", "sim_val", "sim"):
        with pytest.raises(InputError, match="left_eye looks; this detector is one of the right"):
            measured(split)
    assert measured("val")["n"] == 1  # in views no eye looks
    detector = RetinaNet.from_folder(RIGHT)
    frame = dataclasses.replace(detector.frame, crop=(0, 0, 480, 416))
    detector.config = dataclasses.replace(detector.config, frame=frame)
    detector.save(tmp_path / "detector", {})
    with pytest.raises(CheckpointError, match="no eye's; known are .190, 28, 782, 540. .left_eye"):
        measured("sim", tmp_path / "detector")


def test_pictures_without_boxes_are_refused(stored, monkeypatch, capsys):
    whole = StoredPictures.__getitem__

    def bare(self, index):
        picture, labels = whole(self, index)
        none = np.zeros(0, dtype=int)
        boxes = {"boxes": np.zeros((0, 4)), "classes": none, "hidden": none.astype(bool)}
        return picture, dataclasses.replace(labels, **boxes)

    monkeypatch.setattr(StoredPictures, "__getitem__", bare)
    assert main(["evaluate", "detector", str(stored), "--split", "val"]) == 2
    assert "show no block" in capsys.readouterr().err


def test_other_class_names_are_refused(stored, tmp_path, capsys):
    copy = tmp_path / "set"
    shutil.copytree(stored, copy)
    (shard,) = (copy / "data").glob("val-*.parquet")
    table = pq.read_table(shard)
    metadata = dict(table.schema.metadata)
    metadata[b"huggingface"] = metadata[b"huggingface"].replace(b"cube_red", b"ball_red")
    pq.write_table(table.replace_schema_metadata(metadata), shard, row_group_size=10)
    for command in (["evaluate", "detector"], ["anchors"]):
        assert main([*command, str(copy), "--split", "val"]) == 2
        said = capsys.readouterr().err
        assert "ball_red" in said and "differ from this release's 16" in said
    assert main(["evaluate", "detector", str(copy), "--split", "test"]) == 0


def test_calibration_error_of_known_probabilities():
    rng = np.random.default_rng(0)
    said = rng.uniform(0, 1, 20_000)
    right = rng.random(20_000) < said
    assert calibration_error(np.column_stack([said, right])) < 0.02
    assert calibration_error(np.array([[0.9, 0.0], [0.9, 1.0]])) == pytest.approx(0.4)
