"""`fusionnet anchors DATASET`: boxes in the network's pixels, clusters, figures, bad input."""

import json

import cv2
import numpy as np
import pytest

from dataset_fixtures import small_plan, small_sources
from fusionnet.apps.cli import main
from fusionnet.dataset.build import build
from fusionnet.dataset.framing import whole_frame
from fusionnet.models.anchors import mean_iou
from fusionnet.training.placement_pictures import PlacementPictures, box_sides, placed_boxes


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    sources = small_sources(tmp_path_factory.mktemp("sources"))
    folder = tmp_path_factory.mktemp("data") / "set"
    build(folder, small_plan(sources), sources)
    return folder


def test_sides_are_those_of_the_boxes_that_training_sees(stored):
    frame = whole_frame((990, 540), (990, 540))
    pictures = PlacementPictures(stored, "train", frame)
    seen = [pictures[i][1].xyxy.double().numpy() for i in range(len(pictures))]
    expected = np.concatenate([xyxy[:, 2:] - xyxy[:, :2] for xyxy in seen])
    cropped = np.concatenate(box_sides(stored, "train", frame, crop=True))
    np.testing.assert_allclose(cropped, expected)
    whole = np.concatenate(box_sides(stored, "train", frame, crop=False))
    clear = np.concatenate(box_sides(stored, "train", frame, crop=True, least_share=0.99))
    assert 0 < len(clear) < len(cropped)
    assert np.median(whole) < np.median(expected)  # cropping enlarges


def test_it_prints_clusters_and_anchors_and_draws_both_figures(stored, tmp_path, capsys):
    out = tmp_path / "figures"
    assert main(["anchors", str(stored), "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    frame = whole_frame((990, 540), (990, 540))
    for part, crop in (("whole", False), ("cropped", True)):
        sides = np.concatenate(box_sides(stored, "train", frame, crop=crop))
        said = found[part]
        assert said["boxes"] == len(sides) and len(said["iterations"]) == 10
        assert len(said["clusters"]) == 9 and len(said["anchors"]["sizes"]) == 5
        covered = mean_iou(sides, np.array(said["clusters"]))
        assert said["mean_iou"] == pytest.approx(covered, abs=1e-3)
        points = 100 * (said["mean_iou"] - said["thesis_mean_iou"])
        assert said["points_above_the_thesis"] == pytest.approx(points, abs=0.011)
        assert cv2.imread(str(out / f"anchors-{part}.png")).shape[1] > 800
    assert main(["anchors", str(stored), "--clusters", "3", "--repetitions", "2"]) == 0
    assert "of the thesis's anchors" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--split", "nothing"], "no split 'nothing'"),
        (["--clusters", "0"], "at least 1"),
        (["--size", "9", "540"], "32 to 4096 pixels"),
        (["--out", "FILE"], "is a file"),
    ],
)
def test_bad_settings_are_named(stored, tmp_path, capsys, options, said):
    (tmp_path / "file").touch()
    options = [str(tmp_path / "file") if word == "FILE" else word for word in options]
    assert main(["anchors", str(stored), *options]) == 2
    assert said in capsys.readouterr().err


def test_a_folder_without_a_data_set_and_pictures_without_blocks(stored, tmp_path, capsys):
    assert main(["anchors", str(tmp_path)]) == 2
    assert "is no data set" in capsys.readouterr().err


def test_a_data_set_without_boxes_is_refused(stored, monkeypatch, capsys):
    nothing = {"boxes": [], "classes": [], "box_blocks": [], "block_pixels": []}
    whole = PlacementPictures.boxes

    def empty(self, index, least_share):
        sample = {**self.samples[index], **nothing}
        return placed_boxes(sample, self._place(sample))

    monkeypatch.setattr(PlacementPictures, "boxes", empty)
    assert main(["anchors", str(stored)]) == 2
    assert "no picture shows a block" in capsys.readouterr().err
    assert PlacementPictures.boxes is not whole
