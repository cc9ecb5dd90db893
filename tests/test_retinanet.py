"""The thesis's detector: its structure, its start, how it learns, and pictures of any size."""

import dataclasses
import json
from unittest import mock

import numpy as np
import pytest
import torch
from torch import nn

from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset.frame import PictureFrame
from fusionnet.errors import CheckpointError, InputError
from fusionnet.models import backbones, detectors
from fusionnet.models.anchors import AnchorShapes
from fusionnet.models.checkpoint import CONFIG_FILE
from fusionnet.models.detectors import RetinaNetConfig, pyramid_boxes
from fusionnet.models.heads.boxes import BoxConfig, Boxes, BoxHead
from fusionnet.models.retinanet import BoxBatch, RetinaNet
from fusionnet.training.loop import LoopConfig, fit
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.thesis_detector import box_losses, thesis_loop

SIZE = (160, 96)
TINY = RetinaNetConfig(
    frame=PictureFrame(eye_size=SIZE, crop=(0, 0, *SIZE), input_size=SIZE),
    pyramid="p3-p7",
    width=24,
    boxes=pyramid_boxes(
        AnchorShapes(sizes=(12.0, 16.0, 24.0, 32.0, 40.0), ratios=(0.85, 1.0, 1.1)),
        strides=(4, 8, 16, 32, 64),
        depth=1,
        width=24,
    ),
    fusion_nodes=4,
    gaussian=True,
)
"""The thesis's structure with the small backbone: seconds instead of hours."""


def tiny() -> RetinaNet:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return RetinaNet(TINY)


def rectangles(seed: int, count: int = 2) -> BoxBatch:
    """Pictures of bright rectangles on grey; the class goes with the colour."""
    rng = np.random.default_rng(seed)
    images = np.full((count, SIZE[1], SIZE[0], 3), 90, np.uint8)
    truth = []
    for image in images:
        corners = rng.integers(0, [110, 60], (3, 2))
        boxes = np.concatenate([corners, corners + rng.integers(16, 34, (3, 2))], axis=1)
        kinds = rng.integers(0, 3, 3)
        for (left, top, right, bottom), kind in zip(boxes, kinds, strict=True):
            image[top:bottom, left:right] = 0
            image[top:bottom, left:right, kind] = 255
        xyxy = torch.from_numpy(boxes).float()
        truth.append(Boxes(xyxy, torch.from_numpy(kinds), torch.ones(3)))
    return BoxBatch(torch.from_numpy(images), truth)


@pytest.mark.parametrize("backbone", ["resnet50", "resnet152"])
def test_the_thesis_preset_has_five_levels_nine_anchors_and_the_fusion_subnet(backbone):
    with torch.device("meta"):
        model = RetinaNet(detectors.thesis(backbone))
        outputs = model(torch.empty(1, 540, 990, 3, dtype=torch.uint8))
    places = sum(-(-540 // s) * -(-990 // s) for s in (8, 16, 32, 64, 128))
    assert outputs["boxes"].classes.shape == (1, 9 * places, 16)
    assert outputs["boxes"].offsets.shape == (1, 9 * places, 4)
    assert outputs["boxes"].anchors.shape == (9 * places, 4)
    assert outputs["fusion"].shape == (1, 9 * places, 4)
    kinds = [type(m).__name__ for m in model.box_head.classify]
    assert kinds == ["Conv2d", "ReLU"] * 4 + ["Conv2d"]
    assert [type(m).__name__ for m in model.fusion_head.network] == kinds
    assert model.box_head.classify[0].out_channels == 256
    assert model.box_head.config.sizes[0][0] == 30.0 and len(CLASS_NAMES) == 16
    assert {"cube_magenta", "prism_white"} < set(CLASS_NAMES)


def test_it_begins_as_the_thesis_says():
    model = RetinaNet(dataclasses.replace(TINY, width=64))
    for part in (model.pyramid, model.box_head.regress, model.fusion_head):
        for module in part.modules():
            if isinstance(module, torch.nn.Conv2d):
                assert float(module.weight.detach().std()) == pytest.approx(0.01, rel=0.2)
                assert not module.bias.any()
    assert (model.box_head.classify[-1].bias == -2.0).all()


def test_anchors_stand_on_their_strides_whatever_the_size():
    model = tiny()
    anchors = model(torch.zeros(1, 90, 154, 3, dtype=torch.uint8))["boxes"].anchors
    centers = (anchors[:, :2] + anchors[:, 2:]) / 2
    first = -(-90 // 4) * -(-154 // 4) * 9
    assert centers[:first].max(0).values.tolist() == [38 * 4.0, 22 * 4.0]
    assert centers[-9:].max(0).values.tolist() == [128.0, 64.0]


GOLDEN_STEPS = LoopConfig(
    steps=20,
    learning_rate=0.01,
    schedule=thesis_loop().schedule,
    optimizer=thesis_loop().optimizer,
    clip=thesis_loop().clip,
    log_every=4,
    channels_last=True,
)


def test_twenty_steps_go_as_they_went(golden):
    history = fit(
        tiny(), lambda first: (rectangles(s) for s in range(first, 20)), box_losses, GOLDEN_STEPS
    )
    losses = [[round(line["class"], 4), round(line["box"], 4)] for line in history]
    text = "\n".join(f"{a:.4f} {b:.4f}" for a, b in losses) + "\n"
    golden("detector_losses.txt", text, tolerance=0.02)


def test_it_overfits_one_batch():
    batch, model = rectangles(1, count=1), tiny()
    recipe = LoopConfig(steps=60, learning_rate=4e-3, optimizer=OptimizerConfig(kind="adamw"))
    history = fit(model, lambda first: iter([batch] * 60), box_losses, recipe)
    assert history[-1]["loss"] < 0.3 * history[0]["loss"]
    with torch.inference_mode():
        found = model.box_head.predict(model(batch.images)["boxes"])
    assert BoxHead.metric(found, batch.boxes)["map_50"] > 0.9


def test_the_metric_tells_right_from_wrong():
    truth = rectangles(3).boxes
    assert BoxHead.metric(truth, truth)["map_50"] == pytest.approx(1.0)
    wrong = [dataclasses.replace(b, classes=(b.classes + 5) % 16) for b in truth]
    assert BoxHead.metric(wrong, truth)["map_50"] == pytest.approx(0.0, abs=1e-6)


def test_a_picture_without_blocks_trains_and_gives_no_box():
    empty = Boxes(torch.zeros(0, 4), torch.zeros(0, dtype=torch.long), torch.zeros(0))
    batch = BoxBatch(torch.zeros(1, 96, 160, 3, dtype=torch.uint8), [empty])
    model = tiny()
    losses = model.losses(model(batch.images), batch)
    assert all(torch.isfinite(loss) for loss in losses.values())
    model.box_head.classify[-1].bias.data.fill_(-9.0)
    assert len(model.eval().detect(batch.images[0].numpy()).xyxy) == 0


def test_easy_anchors_without_blocks_hardly_count():
    head = BoxHead(channels=8, config=BoxConfig())
    batch, torch_rng = rectangles(0), torch.Generator().manual_seed(0)
    levels = [torch.randn(len(batch.boxes), 8, 12, 16, generator=torch_rng)]
    outputs = head(levels, (96, 128))
    unsure = outputs._replace(classes=outputs.classes + 2.0)  # nothing is easy
    sure = outputs._replace(classes=outputs.classes - 4.0)  # everything is
    for seen in (unsure, sure):
        some = head.losses(seen, batch.boxes)["class"].detach()
        with mock.patch("fusionnet.models.heads.boxes.EASY", -1e9):
            both = head.losses(seen, batch.boxes)["class"].detach()
        assert float(some) == pytest.approx(float(both), rel=1e-3)


@pytest.mark.parametrize("shape", [(96, 160, 3), (480, 800, 3), (300, 300, 3), (64, 900, 3)])
def test_boxes_are_found_in_pixels_of_pictures_of_any_size(shape):
    model = tiny().eval()
    model.box_head.classify[-1].bias.data.fill_(0.0)  # everything is a block
    found = model.detect(np.zeros(shape, np.uint8))
    assert len(found.xyxy) > 10
    assert float(found.xyxy.min()) >= 0
    assert float(found.xyxy[:, 2].max()) <= shape[1] and float(found.xyxy[:, 3].max()) <= shape[0]
    assert float(found.xyxy[:, 2].max()) > 0.8 * shape[1]
    assert float(found.xyxy[:, 3].max()) > 0.8 * shape[0]


def test_it_comes_back_from_a_checkpoint(tmp_path):
    model = tiny().eval()
    model.save(tmp_path, {}, half=False)
    image = rectangles(2).images[0].numpy()
    again = RetinaNet.from_folder(tmp_path)
    assert again.config == TINY
    torch.testing.assert_close(again.detect(image).xyxy, model.detect(image).xyxy)
    with pytest.raises(CheckpointError, match="boxes only and reads no layout"):
        again.see(image)


def test_other_classes_are_named(tmp_path):
    with pytest.raises(InputError, match=r"differ .*\(cube_red, ball_red\)|\(ball_red, cube_red\)"):
        names = ["ball_red" if name == "cube_red" else name for name in CLASS_NAMES]
        dataclasses.replace(TINY, classes=tuple(names))
    tiny().save(tmp_path, {})
    document = json.loads((tmp_path / CONFIG_FILE).read_text())
    document["config"]["classes"] = ["cat", "dog"]
    (tmp_path / CONFIG_FILE).write_text(json.dumps(document))
    with pytest.raises(CheckpointError, match="classes differ"):
        RetinaNet.from_folder(tmp_path)


@pytest.mark.parametrize(("part", "value"), [("boxes", 3), ("width", 2**40)])
def test_a_damaged_configuration_is_named(part, value, tmp_path):
    tiny().save(tmp_path, {})
    document = json.loads((tmp_path / CONFIG_FILE).read_text())
    assert part in document["config"]
    document["config"][part] = value
    (tmp_path / CONFIG_FILE).write_text(json.dumps(document))
    with pytest.raises(CheckpointError, match="has a configuration that cannot be used"):
        RetinaNet.from_folder(tmp_path)


class Foreign(nn.Module):
    """A backbone whose strides and channels belong to the instance, as a newcomer may write it."""

    mean = deviation = (0.5, 0.5, 0.5)

    def __init__(self, *strides: int) -> None:
        super().__init__()
        self.strides, self.channels = strides, (8,) * len(strides)
        self.layers = nn.ModuleList(nn.Conv2d(3, 8, stride, stride) for stride in strides)


def test_a_backbone_may_be_any_function_and_must_have_what_is_asked(monkeypatch):
    monkeypatch.setattr(backbones, "load", lambda _: lambda: Foreign(4, 8, 16))
    state = torch.get_rng_state()
    assert detectors.thesis("foreign").boxes.strides == (4, 8, 16, 32, 64)
    assert torch.equal(torch.get_rng_state(), state)
    config = RetinaNetConfig(frame=TINY.frame, backbone="foreign", detail=16)
    with pytest.raises(InputError, match="need a backbone with stem and stem_channels and after_"):
        RetinaNet(config)
    monkeypatch.setattr(backbones, "load", lambda _: lambda: Foreign(8, 16))
    with pytest.raises(InputError, match="takes three maps; the backbone 'foreign' has 2"):
        RetinaNet(dataclasses.replace(config, detail=0))
