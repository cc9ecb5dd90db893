import dataclasses
import json
import logging
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dataset_fixtures import small_plan, small_sources
from fusionnet.blocks import BLOCK_SIZE, EMPTY, Block, Cell, Color, Layout, Shape, validate
from fusionnet.dataset.build import build
from fusionnet.dataset.layouts import varied_layout
from fusionnet.dataset.pictures import EYE_FRAME, label
from fusionnet.dataset.reader import StoredPictures, StoredSamples
from fusionnet.dataset.shots import FARTHEST, Eyes
from fusionnet.errors import CheckpointError, InputError
from fusionnet.evaluation.detection import DetectionEvaluation, evaluate
from fusionnet.models import retinanet
from fusionnet.models.checkpoint import save_checkpoint
from fusionnet.models.heads import camera_pose, occupancy
from fusionnet.models.heads.boxes import BoxConfig, Boxes, BoxHead, BoxOutputs
from fusionnet.models.policy_folder import detector_folder
from fusionnet.models.retinanet import RetinaNet
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.training.detector import (
    DetectorConfig,
    calibrate,
    measure,
    new_detector,
    train,
)
from fusionnet.training.detector_batches import JoinedPictures, batches, collate
from fusionnet.training.loop import LoopConfig, fit
from fusionnet.training.warm_start import start_from

SHAPE = (*EYE_FRAME.input_size[::-1], 3)
"""Of the network's input: height, width, colours."""

TABLE = Layout(
    (
        Block(Color.RED, Shape.CUBE, Cell(2, 3, 0)),
        Block(Color.GREEN, Shape.PRISM, Cell(2, 3, 1)),
        Block(Color.WHITE, Shape.CUBE, Cell(6, 1, 0)),
    )
)


@pytest.fixture(scope="module")
def renderer():
    return SceneRenderer("nico", size=EYE_FRAME.eye_size)


@pytest.fixture(scope="module")
def model():
    return new_detector(seed=0).eval()


@given(st.lists(st.floats(0, 500), min_size=4, max_size=4))
def test_boxes_come_back_from_the_crop(box):
    boxes = np.array([box])
    np.testing.assert_allclose(EYE_FRAME.to_eye(EYE_FRAME.to_input(boxes)), boxes, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_pose_head_projects_as_the_camera_does(renderer, model, seed):
    look = Appearance.sample(generator(seed, "test"))
    _, truth = label(renderer, TABLE, look)
    camera = renderer.camera("left_eye", look)
    batch = collate([(np.zeros(SHAPE, np.uint8), truth)])
    deviation = model.pose_head.target(batch.matrix, batch.camera_from_board)
    points = torch.rand(20, 3) * 0.2
    pixels = model.pose_head.project(deviation, points)[0].numpy()
    board = renderer.robot.robot_from_board
    in_robot = points.double().numpy() @ board[:3, :3].T + board[:3, 3]
    wanted = EYE_FRAME.to_input(np.tile(camera.project(in_robot) + 0.5, 2))[:, :2]
    np.testing.assert_allclose(pixels, wanted, atol=0.05)


def test_labels_tell_what_stands_where(renderer):
    image, truth = label(renderer, TABLE, Appearance())
    assert image.shape == SHAPE
    assert {i: k for i, k in enumerate(truth.cells) if k != EMPTY} == {
        block.cell.index: block.class_index for block in TABLE.blocks
    }
    assert sorted(truth.classes) == sorted(block.class_index for block in TABLE.blocks)
    assert not truth.holding


def test_a_table_without_blocks_trains(renderer, model):
    sample = label(renderer, Layout(()), Appearance())
    losses = model.losses(model(collate([sample]).images), collate([sample]))
    assert all(torch.isfinite(loss) for loss in losses.values())
    assert float(losses["box"].detach()) == 0.0


def test_varied_layouts_can_stand_on_a_table():
    for index in range(300):
        validate(varied_layout(generator(index, "layout"), [TABLE], invented=0.2))


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    sources = small_sources(folder / "sources")
    build(folder / "set", small_plan(sources), sources)
    return folder / "set"


def test_a_resumed_run_sees_the_batches_that_it_would_have_seen(stored):
    pictures = JoinedPictures([StoredPictures(stored, "train"), StoredPictures(stored, "sim")])
    assert len(pictures) == 13
    assert sorted(pictures.order(0, 1)) == list(range(13))
    whole = batches(pictures, 4, 0, 0)
    expected = [next(whole).images for _ in range(5)]
    resumed = batches(pictures, 4, 0, 3)
    for wanted in expected[3:]:
        torch.testing.assert_close(next(resumed).images, wanted)


def test_layouts_are_learnt_through_the_eye_alone(stored, model):
    pictures = StoredPictures(stored, "train")
    samples = [pictures[i] for i in range(len(pictures))]
    by_eye = [labels for _, labels in samples if labels.by_eye]
    assert 0 < len(by_eye) < len(samples)
    batch = collate(samples)
    assert len(batch.images) == len(batch.boxes) == 12
    np.testing.assert_array_equal(batch.cells, [labels.cells for labels in by_eye])
    deviation = model.pose_head.target(batch.matrix, batch.camera_from_board)
    outputs = model(batch.images, deviation)
    assert len(outputs["cells"].logits) == len(by_eye)
    eyes = {"pose", "occupancy", "first_look", "offset", "holding"}
    assert set(model.losses(outputs, batch)) == {"class", "box"} | eyes
    views = collate([s for s in samples if not s[1].by_eye])
    outputs = model(views.images, torch.zeros(0, 7))
    assert set(model.losses(outputs, views)) == {"class", "box"}


def test_a_detector_starts_from_another(tmp_path, model, caplog):
    caplog.set_level(logging.WARNING, logger="fusionnet")
    model.save(tmp_path / "detector", {}, half=False)
    other = new_detector(seed=5)
    assert start_from(other, tmp_path / "detector") == [] and not caplog.records
    for ours, theirs in zip(other.parameters(), model.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs)
    plain = RetinaNet(dataclasses.replace(model.config, detail=0, reasoning=2, second_look=0))
    plain.save(tmp_path / "plain", {}, half=False)
    left = start_from(other, tmp_path / "plain")
    assert f"{len(left)} of {len(other.state_dict())} tensors begin anew" in caplog.text
    assert left[0] in caplog.text and left[-1] not in caplog.text
    assert "occupancy_head.embed_detail.weight" in left and "occupancy_head.look.weight" in left
    assert len(left) < 50
    image = torch.randint(0, 255, (1, *SHAPE), dtype=torch.uint8)
    with torch.inference_mode():  # what is new begins as the identity
        found, wanted = other.eval()(image), plain.eval()(image)
    torch.testing.assert_close(found["cells"].logits, wanted["cells"].logits)


def test_a_wider_detector_begins_with_what_a_narrower_one_computes(tmp_path):
    torch.manual_seed(0)
    wide = new_detector(seed=1, layouts=False)
    boxes = dataclasses.replace(wide.config.boxes, width=64)
    config = dataclasses.replace(wide.config, backbone="small", width=48, boxes=boxes)
    narrow = RetinaNet(config)
    narrow.save(tmp_path / "narrow", {}, half=False)
    left = start_from(wide, tmp_path / "narrow")
    assert {name.rsplit(".", 3)[0] for name in left} == {
        "backbone.fine.3",
        "backbone.middle.3",
        "backbone.coarse.3",
    }
    image = torch.randint(0, 255, (1, 96, 128, 3), dtype=torch.uint8)
    with torch.inference_mode():
        found, wanted = wide.eval()(image)["boxes"], narrow.eval()(image)["boxes"]
    torch.testing.assert_close(found.classes, wanted.classes)
    torch.testing.assert_close(found.offsets, wanted.offsets)
    # Another number of anchors is another meaning: nothing of it is taken over.
    fewer = dataclasses.replace(boxes, ratios=(1.0,))
    other = RetinaNet(dataclasses.replace(config, boxes=fewer))
    other.save(tmp_path / "other", {}, half=False)
    assert "box_head.classify.4.weight" in start_from(wide, tmp_path / "other")


def test_a_detector_of_which_nothing_fits_is_no_start(tmp_path, model):
    tensors = {f"elsewhere.{n}": t for n, t in model.state_dict().items()}
    tensors |= {n: t + 0 for n, t in model.state_dict().items() if n.endswith("_tracked")}
    config = model.config.as_json()
    save_checkpoint(tmp_path / "other", kind=retinanet.KIND, config=config, tensors=tensors)
    with pytest.raises(CheckpointError, match="Nothing of the detector in .*without --start"):
        start_from(model, tmp_path / "other")


def test_pictures_without_blocks_are_learnt_from(stored):
    pictures = StoredPictures(stored, "train")
    first = [next(batches(pictures, 4, 0, 0, empty=2)) for _ in range(2)]
    torch.testing.assert_close(first[0].images, first[1].images)
    assert len(first[0].images) == 6 and len(first[0].cells) <= 4
    assert [len(boxes.xyxy) for boxes in first[0].boxes[-2:]] == [0, 0]
    assert len({int(image.sum()) for image in first[0].images}) == 6


def test_of_several_processes_the_first_alone_measures_and_saves(stored, tmp_path, monkeypatch):
    monkeypatch.setattr("fusionnet.training.detector.is_first_process", lambda: False)
    config = DetectorConfig(
        datasets=(stored,),
        out=tmp_path / "checkpoint",
        work=tmp_path / "work",
        batch=2,
        loop=LoopConfig(steps=1),
    )
    assert train(config) == {} and not config.out.exists()


def test_nothing_to_learn_from_is_refused():
    with pytest.raises(InputError, match="At least one data set"):
        DetectorConfig(datasets=())


def test_the_temperature_makes_probabilities_true(stored, model, monkeypatch):
    pictures, rng = StoredPictures(stored, "sim_val"), np.random.default_rng(0)
    wrong = rng.random(512) < 0.2  # four in five are right, said with 98 %

    def sure(images, refine):
        cells = collate([pictures[0]]).cells
        said = torch.where(torch.from_numpy(wrong), (cells + 1) % 17, cells)
        logits = torch.nn.functional.one_hot(said, 17) * 7.0
        return {"cells": occupancy.CellOutputs((logits,), torch.zeros(1))}

    monkeypatch.setattr(model, "config", model.config)
    monkeypatch.setattr(model, "forward", sure)
    temperature = calibrate(model, pictures)
    share = torch.softmax(torch.eye(17)[0] * 7.0 / temperature, 0)[0]
    assert float(share) == pytest.approx(1 - wrong.mean(), abs=0.02)


def test_slivers_count_more_than_what_is_hidden_or_plain_to_see(model):
    head, cells = model.occupancy_head, torch.full((1, 512), EMPTY)
    cells[0, :3] = 4
    logits, held = torch.zeros(1, 512, 17), torch.zeros(1)
    logits[0, 3:, EMPTY] = 60.0  # nothing is lost there
    visible = torch.zeros(1, 512, dtype=torch.long)
    losses = []
    for pixels in ((0, 0, 0), (0, occupancy.SLIVER[0], occupancy.SLIVER[1])):
        visible[0, :3] = torch.tensor(pixels)
        outputs = occupancy.CellOutputs((logits,), held)
        losses.append(float(head.losses(outputs, cells, visible, held)["occupancy"]))
    entropy = math.log(17)
    assert losses == pytest.approx([3 * entropy, (2 + occupancy.SLIVER_WEIGHT) * entropy], rel=1e-4)


def test_the_camera_sees_what_no_filled_cell_hides(model):
    head = model.occupancy_head
    viewpoint = torch.tensor([[-6.2, 2.9, 11.3]]) * BLOCK_SIZE  # about where the left eye is
    empty = torch.zeros(1, 512)
    alone = head.visibility(empty, viewpoint)[0]
    front, top, sides = alone.split([25, 25, 12], dim=1)
    assert (front == 1).all() and (top == 1).all()
    left, right = sides.view(8, 8, 8, 2, 2, 3).movedim(4, 0)
    assert (left[:, 3:] == 1).all() and (left[:, :2] == 0).all()  # of cells on the other side
    assert (right[:, :2] == 1).all() and (right[:, 3:] == 0).all()
    tower = empty.view(1, 8, 8, 8).clone()
    tower[0, 2, 3, :4] = torch.tensor([1.0, 1.0, 1.0, 0.6])
    seen = head.visibility(tower.flatten(1), viewpoint)[0].view(8, 8, 8, -1)
    assert (seen[3, 3, 0, :25] == 0).all()  # behind it, upon the board
    assert (seen[2, 3, :4, :25] == 1).all()
    assert (seen[:2] == alone.view(8, 8, 8, -1)[:2]).all()  # before it
    assert 0.4 == pytest.approx(float(seen[3, 3, 3, 12]))  # the middle of a front


def test_a_second_look_begins_as_the_first(model):
    image = torch.randint(0, 255, (1, *SHAPE), dtype=torch.uint8)
    with torch.inference_mode():
        cells = model(image)["cells"]
    first, second = cells.looks
    torch.testing.assert_close(first, second)
    assert cells.offsets.shape == (1, 512, 3) and (cells.offsets == 0).all()


def test_offsets_are_learnt_of_blocks_that_can_be_seen(model):
    head, cells = model.occupancy_head, torch.full((1, 512), EMPTY)
    cells[0, :2] = 4
    visible = torch.zeros(1, 512, dtype=torch.long)
    visible[0, 0], wanted = 500, torch.full((1, 512, 3), 2.0)
    outputs = occupancy.CellOutputs((torch.zeros(1, 512, 17),), torch.zeros(1), wanted - 1)
    losses = head.losses(outputs, cells, visible, torch.zeros(1), wanted)
    assert float(losses["offset"]) == pytest.approx(1.5)  # smooth L1 of 1, thrice, of one block


def test_stored_pictures_tell_how_far_blocks_stand_beside_their_cells(stored, model):
    pictures, samples = StoredPictures(stored, "train"), StoredSamples(stored, "train")
    for index in range(len(pictures)):
        sample, labels = samples[index], pictures[index][1]
        if not labels.by_eye:
            continue
        look = Appearance.sample(generator(sample["seed"], "look"))
        places = sample["block_cells"]
        wanted = np.column_stack([look.block_shifts, look.block_turns])[: len(places)]
        np.testing.assert_allclose(labels.offsets[places], wanted, atol=1e-8)
        assert (labels.offsets[labels.cells == EMPTY] == 0).all()
        batch = collate([pictures[index]])
        truth = model.pose_head.target(batch.matrix, batch.camera_from_board)
        wanted = model.offsets(truth, truth, batch)[0]
        filled = torch.from_numpy(labels.cells != EMPTY)
        assert (wanted[~filled].abs() < 1e-3).all() and 0.1 < wanted[filled].abs().mean() < 2.0


def test_displaced_blocks_are_told_from_those_that_are_not():
    eyes = Eyes("nico", (240, 135))
    kept, moved = (eyes.shot(TABLE, "left_eye", 3, displaced=d).offsets for d in (False, True))
    far = np.linalg.norm((moved - kept)[:, :2], axis=1)
    assert far[0] == 0.0 and 0.001 < far.max() <= FARTHEST  # the first is beneath another
    np.testing.assert_array_equal(moved[:, 2], kept[:, 2])


def test_half_precision_does_not_displace_pixels(model):
    deviation = torch.randn(2, 7)
    exact = model.pose_head.project(deviation, model.occupancy_head.points)
    with torch.autocast("cpu", torch.bfloat16):
        half = model.pose_head.project(deviation, model.occupancy_head.points)
        pose = model.pose_head(torch.randn(1, 48, 104, 120), torch.randn(1, 128, 26, 30))
    torch.testing.assert_close(exact, half)
    assert pose[-1].dtype is torch.float32


def test_the_detector_overfits_one_batch(renderer):
    layouts = [varied_layout(generator(i, "overfit"), [TABLE], invented=0.5) for i in range(2)]
    samples = [label(renderer, layout, Appearance()) for layout in layouts]
    batch, model = collate(samples), new_detector(seed=1)
    history = fit(
        model,
        lambda first: iter([batch] * 25),
        lambda net, b: model.losses(net(b.images), b),
        LoopConfig(steps=25, learning_rate=3e-3, log_every=5, loss_weights={"occupancy": 0.2}),
    )
    assert history[-1]["occupancy"] < 0.3 * history[0]["occupancy"]
    assert history[-1]["class"] < 0.5 * history[0]["class"]
    assert history[-1]["pose"] < 0.5 * history[0]["pose"]


def test_perfect_outputs_give_back_the_boxes(model):
    head = model.box_head
    truth = Boxes(torch.tensor([[100.0, 90.0, 122.0, 115.0]]), torch.tensor([10]), torch.ones(1))
    anchors = head([torch.zeros(1, 48, 52, 60)], SHAPE[:2]).anchors
    nearest = int((anchors - truth.xyxy).abs().sum(1).argmin())
    logits = torch.full((1, len(anchors), 16), -9.0)
    logits[0, nearest, 10] = 5.0
    offsets = torch.zeros(1, len(anchors), 4)
    offsets[0, nearest] = head.coder.encode_single(truth.xyxy, anchors[nearest : nearest + 1])[0]
    found = head.predict(BoxOutputs(logits, offsets, anchors, SHAPE[:2]))[0]
    torch.testing.assert_close(found.xyxy, truth.xyxy, atol=1e-3, rtol=0)
    assert found.classes.tolist() == [10]


@pytest.mark.parametrize("depth", [0, 2])
def test_boxes_of_several_levels(depth):
    config = BoxConfig(
        strides=(8, 16), sizes=((8.0, 12.0), (20.0, 30.0)), ratios=(0.5, 1.0, 2.0), depth=depth
    )
    head = BoxHead(channels=8, config=config)
    outputs = head([torch.zeros(2, 8, 4, 6), torch.zeros(2, 8, 2, 3)], (32, 48))
    assert outputs.anchors.shape == ((24 + 6) * 6, 4)
    assert outputs.classes.shape == (2, 180, 16) and outputs.offsets.shape == (2, 180, 4)
    centers = (outputs.anchors[:, :2] + outputs.anchors[:, 2:]) / 2
    assert centers[:144].max() == 40.0 and centers[144:].max() == 32.0
    assert BoxConfig.from_json(json.loads(json.dumps(dataclasses.asdict(config)))) == config


def test_levels_without_sizes_are_refused():
    with pytest.raises(InputError, match="anchor sizes"):
        BoxConfig(strides=(8, 16), sizes=((8.0,),))


def test_a_checkpoint_sees_the_same(tmp_path, renderer, model):
    model.save(tmp_path / "detector", {}, half=False)
    image = renderer.view(TABLE, labels=False).image
    before, after = model.see(image), RetinaNet.from_folder(tmp_path / "detector").see(image)
    np.testing.assert_allclose(before.cells, after.cells, atol=1e-6)
    np.testing.assert_allclose(before.corners, after.corners, atol=1e-3)


@pytest.mark.parametrize("shape", [(540, 960, 3), (270, 480, 3), (1, 1, 3), (33, 900, 3)])
def test_pictures_of_any_size_are_seen(model, shape):
    sight = model.see(np.zeros(shape, np.uint8))
    np.testing.assert_allclose(sight.cells.sum(-1), 1.0, atol=1e-6)


def test_measures_of_a_perfect_reader(stored, model, monkeypatch):
    pictures = StoredPictures(stored, "sim")
    truth = collate([pictures[i] for i in range(len(pictures))])

    def perfect(images, refine):
        assert refine
        logits = torch.nn.functional.one_hot(truth.cells, 17).float()
        pose = model.pose_head.target(truth.matrix, truth.camera_from_board)
        cells = occupancy.CellOutputs((logits,), truth.holding * 2 - 1)
        return {"cells": cells, "used_pose": pose}

    monkeypatch.setattr(model, "forward", perfect)
    metrics = measure(model, pictures)
    assert metrics["layout_right"] == metrics["blocks_right"] == metrics["holding_right"] == 1.0
    assert metrics["phantoms"] == 0.0 and metrics["pose_pixels"] == pytest.approx(0.0, abs=1e-3)
    assert dataclasses.is_dataclass(truth)


def test_what_makes_it_fast_changes_next_to_nothing(renderer, monkeypatch):
    """Half precision and oneDNN depend on the processor; what is read must not."""
    model = RetinaNet.from_folder(detector_folder("compact"))
    image = renderer.view(TABLE, labels=False).image
    sights = []
    for half in (False, True):
        monkeypatch.setattr(retinanet, "_half_is_fast", lambda half=half: half)
        sights.append(model.see(image))
    exact, rough = sights
    np.testing.assert_allclose(rough.cells, exact.cells, atol=0.05)
    np.testing.assert_allclose(rough.corners, exact.corners, atol=0.3)
    assert (rough.boxes.classes == exact.boxes.classes).all()
    monkeypatch.setattr(occupancy.GridConvolution, "forward", torch.nn.Conv3d.forward)
    monkeypatch.setattr(retinanet, "_half_is_fast", lambda: False)
    np.testing.assert_allclose(model.see(image).cells, exact.cells, atol=1e-5)


def test_rotations_are_exact_and_smooth_at_zero():
    vectors = torch.tensor([[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [1e-4, 0.0, 0.0]])
    vectors.requires_grad_()
    turned = camera_pose._rotation(vectors)
    expected = torch.linalg.matrix_exp(camera_pose._cross_matrix(vectors))
    torch.testing.assert_close(turned, expected, atol=1e-6, rtol=0)
    ours = torch.autograd.grad(turned[:, 0, 1].sum(), vectors, retain_graph=True)[0]
    theirs = torch.autograd.grad(expected[:, 0, 1].sum(), vectors)[0]
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)


def test_a_detector_of_boxes_alone_is_trained_and_measured(stored, tmp_path):
    config = DetectorConfig(
        datasets=(stored,),
        out=tmp_path / "boxes",
        work=tmp_path / "work",
        layouts=False,
        batch=2,
        loop=LoopConfig(steps=2, learning_rate=1e-4, log_every=1, tensorboard=False),
    )
    metrics = train(config)
    assert set(metrics) == {"map_50", "map_50_95"}
    model = RetinaNet.from_folder(config.out)
    assert not model.config.reads_layouts and model.config.boxes.strides == (4, 8, 16)
    boxes = model.detect(np.zeros((300, 500, 3), np.uint8))
    assert len(boxes.xyxy) == len(boxes.scores)
    measured = evaluate(
        DetectionEvaluation(dataset=stored, split="sim_val", checkpoint=str(config.out), pictures=2)
    )
    assert measured["n"] == 1 and "layouts_right" not in measured
    with pytest.raises(InputError, match="finds boxes only"):
        evaluate(DetectionEvaluation(checkpoint=str(config.out)))


def test_prisms_may_count_more_often():
    torch.manual_seed(0)
    losses = {}
    for prisms in (1.0, 3.0):
        head = BoxHead(channels=8, config=BoxConfig(strides=(8,), sizes=((16.0,),), prisms=prisms))
        logits = torch.full((1, 36, 16), -3.0)
        anchors = head._anchors_of([torch.zeros(1, 8, 6, 6)])
        outputs = BoxOutputs(logits, torch.zeros(1, 36, 4), anchors, (48, 48))
        for kind in (2, 10):  # a red cube, a red prism
            truth = Boxes(anchors[14:15], torch.tensor([kind]), torch.ones(1))
            losses[prisms, kind] = float(head.losses(outputs, [truth])["class"])
    assert losses[3.0, 2] == losses[1.0, 2] == losses[1.0, 10]
    assert losses[3.0, 10] > 2 * losses[1.0, 10]
