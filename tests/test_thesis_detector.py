"""Training the thesis's detector on a data set: pictures, noise, resume, checkpoint, bad data."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.sources import Sources
from fusionnet.errors import DataError, InputError, UnknownNameError
from fusionnet.models.anchors import AnchorShapes
from fusionnet.models.detectors import THESIS_FRAME
from fusionnet.models.heads.boxes import Boxes
from fusionnet.models.placement import placement_crop
from fusionnet.models.retinanet import RetinaNet
from fusionnet.randomness import generator
from fusionnet.training import thesis_detector
from fusionnet.training.placement_pictures import PlacementPictures, moved, within
from fusionnet.training.thesis_detector import ThesisDetectorConfig, thesis_loop, train
from fusionnet.views import LevelTwo
from tiny_treebank import write_tiny_treebank


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    sources = Sources(data=write_tiny_treebank(tmp_path_factory.mktemp("corpus")))
    folder = tmp_path_factory.mktemp("data") / "set"
    build(folder, plan_for("4", "treebank", sources, size=(320, 180), shard=4), sources)
    return folder


@pytest.fixture
def config(stored, tmp_path):
    loop = dataclasses.replace(
        thesis_loop(), steps=4, accelerator="cpu", log_every=1, save_every=2, tensorboard=False
    )
    return ThesisDetectorConfig(
        dataset=stored,
        out=tmp_path / "checkpoint",
        work=tmp_path / "work",
        backbone="small",
        backbone_weights="random",
        input_size=(160, 90),
        anchors=AnchorShapes(sizes=(5.0, 6.0, 7.0, 8.0, 10.0), ratios=(1.0,), scales=(1.0,)),
        check="sim_val",
        loop=loop,
    )


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    """The thesis's subnets with 16 channels instead of 256."""
    made = thesis_detector.detectors.thesis

    def small(*arguments, **options):
        whole = made(*arguments, **options)
        boxes = dataclasses.replace(whole.boxes, depth=1, width=16)
        return dataclasses.replace(whole, width=16, boxes=boxes)

    monkeypatch.setattr(thesis_detector.detectors, "thesis", small)


def test_the_recipe_is_that_of_table_6_1():
    recipe = ThesisDetectorConfig(dataset=Path("set"), loop=thesis_loop())
    assert recipe.batch == 1 and recipe.input_size == (990, 540) and recipe.loop.steps == 50_000
    optimizer, schedule = recipe.loop.optimizer, recipe.loop.schedule
    assert (optimizer.kind, optimizer.momentum, optimizer.weight_decay) == ("sgd", 0.9, 1e-4)
    assert recipe.loop.learning_rate == 0.01 and schedule.milestones == (60_000, 80_000)


def test_a_killed_training_goes_on_to_the_same_losses_and_is_kept(config, tmp_path):
    lines = []

    def stop(step, steps, line):
        lines.append(line)
        if step == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(config, progress=stop)
    resumed = []
    metrics = train(config, progress=lambda step, steps, line: resumed.append(line))
    whole = []
    other = dataclasses.replace(config, work=tmp_path / "whole", out=tmp_path / "other")
    train(other, progress=lambda step, steps, line: whole.append(line))
    assert [line["step"] for line in resumed] == [3, 4]
    for line, wanted in zip(resumed, whole[2:], strict=True):
        assert line["loss"] == pytest.approx(wanted["loss"], rel=1e-6)
    assert metrics["pictures"] == 1 and 0 <= metrics["map_50"] <= 1
    assert metrics["backbone_weights"] == "random"
    model = RetinaNet.from_folder(config.out)
    assert model.config.backbone == "small" and model.config.boxes.width == 16


def test_pictures_are_cropped_in_their_aspect_with_their_boxes(stored):
    pictures = PlacementPictures(stored, "train", THESIS_FRAME)
    for index in range(len(pictures)):
        picture, boxes = pictures[index]
        assert picture.shape == (540, 990, 3)
        sample = pictures.samples[index]
        matrix = np.array(sample["camera"]["matrix"]).reshape(3, 3)
        pose = np.array(sample["camera"]["camera_from_board"]).reshape(4, 4)
        left, top, right, bottom = placement_crop(matrix, pose, (320, 180))
        assert abs((right - left) / (bottom - top) - 320 / 180) < 0.03
        for (x0, y0, x1, y1), kind in zip(boxes.xyxy.int(), boxes.classes, strict=True):
            if CLASS_NAMES[int(kind)] == "cube_red":
                red, green, _ = np.median(picture[y0:y1, x0:x1].reshape(-1, 3), axis=0)
                assert red > green
    with pytest.raises(UnknownNameError, match="no split 'nothing'"):
        PlacementPictures(stored, "nothing", THESIS_FRAME)


@pytest.mark.parametrize("seed", range(5))
def test_level_two_noise_moves_boxes_with_their_blocks(seed):
    picture = np.zeros((90, 160, 3), np.uint8)
    picture[40:52, 70:90] = 255
    truth = Boxes(torch.tensor([[70.0, 40.0, 90.0, 52.0]]), torch.tensor([3]), torch.ones(1))
    image, boxes = moved(picture, truth, LevelTwo(), generator(seed, "noise"))
    rows, columns = np.nonzero(image[..., 0] > 127)
    around = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    np.testing.assert_allclose(boxes.xyxy[0].numpy(), around, atol=1.5)
    assert boxes.classes.tolist() == [3]


def test_boxes_that_leave_the_picture_are_clipped_or_dropped():
    boxes = np.array([[-5.0, 10, 15, 30], [-18, 10, 2, 30], [300, 10, 320, 30]])
    kept = within(boxes, boxes, np.array([1, 2, 3]), (160, 90))
    assert kept.classes.tolist() == [1] and kept.xyxy.tolist() == [[0.0, 10.0, 15.0, 30.0]]


def test_bad_data_and_settings_are_named(config, tmp_path, monkeypatch):
    with pytest.raises(DataError, match="is no data set"):
        train(dataclasses.replace(config, dataset=tmp_path))
    with pytest.raises(UnknownNameError, match="No backbone called 'resnet5'"):
        train(dataclasses.replace(config, backbone="resnet5"))
    with pytest.raises(InputError, match="batch, checked"):
        dataclasses.replace(config, batch=0)
    with monkeypatch.context() as patched:
        none = Boxes(torch.zeros(0, 4), torch.zeros(0, dtype=torch.long), torch.zeros(0))
        patched.setattr(PlacementPictures, "boxes", lambda self, index: none)
        with pytest.raises(DataError, match="shows a block"):
            train(config)
    pictures = PlacementPictures(config.dataset, "train", THESIS_FRAME)
    sample = dict(pictures.samples[0])
    monkeypatch.setattr(
        type(pictures.samples), "__getitem__", lambda self, index: sample | {"classes": [16] * 99}
    )
    with pytest.raises(DataError, match="has a class 16; there are 16"):
        pictures[0]
