"""How the shipped detector is measured, on stored pictures and on rendered ones."""

import numpy as np
import pytest

from dataset_fixtures import small_plan, small_sources
from fusionnet.dataset.build import build
from fusionnet.errors import InputError
from fusionnet.evaluation.detection import DetectionEvaluation, calibration_error, evaluate
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


def test_calibration_error_of_known_probabilities():
    rng = np.random.default_rng(0)
    said = rng.uniform(0, 1, 20_000)
    right = rng.random(20_000) < said
    assert calibration_error(np.column_stack([said, right])) < 0.02
    assert calibration_error(np.array([[0.9, 0.0], [0.9, 1.0]])) == pytest.approx(0.4)
