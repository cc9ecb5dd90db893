import errno
import hashlib
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as coco_mask

from dataset_fixtures import SIZE, digests, small_plan, small_sources
from fusionnet import robots
from fusionnet.apps.cli import main
from fusionnet.blocks import (
    BLOCK_SIZE,
    EMPTY,
    Block,
    Cell,
    Color,
    Layout,
    Move,
    Scene,
    Shape,
    apply,
    layout_from_json,
)
from fusionnet.corpora import load_corpus, part_of
from fusionnet.dataset import shards
from fusionnet.dataset.build import build
from fusionnet.dataset.check import check
from fusionnet.dataset.folder import read_checksums
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.framing import decode, grid_frame, labels_of, whole_frame
from fusionnet.dataset.masks import decode_mask, encode_masks, mask_extent
from fusionnet.dataset.pictures import EYE_FRAME, EYE_FRAMES, label
from fusionnet.dataset.plan import BuildPlan, counts_for
from fusionnet.dataset.reader import StoredPictures, StoredSamples
from fusionnet.dataset.recipes import Recipe, Recipes, held_out_layouts
from fusionnet.dataset.sample import encode_jpeg, make_sample
from fusionnet.dataset.schema import COLUMNS, check_classes
from fusionnet.dataset.shots import FARTHEST, Eyes, Photographs
from fusionnet.dataset.sources import Sources, Studio
from fusionnet.errors import DataError, InputError, OutputError, UnknownNameError
from fusionnet.geometry import apply as moved
from fusionnet.geometry import rotation_from_vector, transform
from fusionnet.randomness import generator
from fusionnet.rcl import format as format_tree
from fusionnet.rcl import parse
from fusionnet.simulation import Appearance, SceneRenderer, displacements


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    return small_sources(tmp_path_factory.mktemp("sources"))


@pytest.fixture(scope="module")
def plan(sources):
    return small_plan(sources)


@pytest.fixture(scope="module")
def built(tmp_path_factory, plan, sources):
    folder = tmp_path_factory.mktemp("data") / "set"
    build(folder, plan, sources)
    return folder


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # pycocotools
@given(arrays(np.int16, (7, 9), elements=st.integers(-1, 3)))
def test_masks_come_back_and_coco_reads_them_alike(block_at):
    for block, lengths in enumerate(encode_masks(block_at, range(4))):
        mask = decode_mask(lengths, (9, 7))
        np.testing.assert_array_equal(mask, block_at == block)
        rows, columns = np.nonzero(mask)
        edges = [0, 0, 0, 0]
        if len(rows):
            edges = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert mask_extent(lengths, (9, 7)) == (edges, len(rows))
        packed = coco_mask.frPyObjects({"size": [7, 9], "counts": lengths}, 7, 9)
        np.testing.assert_array_equal(coco_mask.decode(packed), mask)


def test_a_mask_of_another_picture_is_refused():
    with pytest.raises(DataError, match="cover 5 pixels; its picture has 3 x 2"):
        decode_mask([2, 3], (3, 2))


def test_a_plan_comes_back_from_its_json(plan):
    assert BuildPlan.from_json(json.loads(json.dumps(plan.as_json()))) == plan
    with pytest.raises(DataError, match="no plan of a data set"):
        BuildPlan.from_json({"counts": {"trainn": 3}})


@pytest.mark.parametrize("count", [10**15, 0, -1, 10**9])
def test_a_strangers_plan_cannot_ask_for_any_number_of_samples(plan, count):
    asked = plan.as_json() | {"counts": {"train": count}, "shard": 1}
    with pytest.raises(DataError, match=r"no plan of a data set.*(1 to 1000000000|up to 2000000)"):
        BuildPlan.from_json(asked)


@pytest.mark.parametrize("field", ["shard", "seed", "robot", "sensor", "eyes_share", "size"])
def test_a_strangers_plan_cannot_have_values_of_any_type(plan, field):
    wrong = {"shard": 2.5, "size": [320]}
    asked = plan.as_json() | {field: wrong.get(field, None)}
    with pytest.raises(DataError, match=rf"no plan of a data set.*{field} is "):
        BuildPlan.from_json(asked)


@pytest.mark.parametrize("described", [b"{", b"[]", b"\xff", b'{"info": {"features": 3}}'])
def test_damaged_metadata_of_a_shard_are_named(described):
    with pytest.raises(DataError, match="metadata of x for `datasets` are damaged"):
        check_classes({b"huggingface": described}, "x")


@pytest.mark.parametrize("scale", ["", "tiny", "0", "-3", "2.5", "9999999999999"])
def test_an_unknown_scale_is_refused(scale):
    with pytest.raises(InputError, match="none of smoke, small, thesis or a number"):
        counts_for(scale, views=True)


def test_the_thesis_scale_has_its_number_of_pictures_in_views():
    counts = counts_for("thesis", views=True)
    assert counts["train"] + counts["val"] + counts["test"] == 625 * 15 * 4
    assert set(counts_for("thesis", views=False)) == {"train", "sim_val", "sim"}


def test_neither_held_out_layouts_nor_validation_views_are_trained_on(sources):
    views = (("a", "b", "c"), ("d", "e"))
    counts = (("train", 400), ("val", 40), ("test", 40), ("sim", 40))
    plan = BuildPlan(
        counts=counts, corpus="treebank", corpus_digest="", views=views, varied=0.5, invented=0.0
    )
    corpus = load_corpus("treebank", sources.data)
    recipes, held_out = Recipes(plan, corpus), held_out_layouts(corpus)
    made = {s: [recipes.recipe(s, i) for i in range(n)] for s, n in counts}
    for recipe in made["train"]:
        assert frozenset(recipe.command.scene.before.blocks) not in held_out
        assert recipe.camera in (*views[0], "left_eye")
        if recipe.origin == "recorded":
            assert part_of(recipe.command.scene.group) == "train"
    assert {r.camera for r in made["train"]} == {*views[0], "left_eye"}
    varied = np.mean([r.origin == "varied" for r in made["train"]])
    through_eye = np.mean([r.kind == "eye" for r in made["train"]])
    assert 0.4 < varied < 0.6 and 0.15 < through_eye < 0.35
    for split, part, cameras in (("val", "val", views[1]), ("test", "test", views[1])):
        assert {part_of(r.command.scene.group) for r in made[split]} == {part}
        assert {r.camera for r in made[split]} == set(cameras)
        assert not any(r.noised for r in made[split])
    assert {part_of(r.command.scene.group) for r in made["sim"]} == {"test"}
    assert {r.kind for r in made["sim"]} == {"eye"}


def test_blocks_stand_beside_their_cells_in_the_share_that_was_asked_for(sources):
    corpus = load_corpus("treebank", sources.data)
    counts = (("train", 200), ("sim", 40))
    planned = BuildPlan(counts=counts, corpus="treebank", corpus_digest="", displaced=0.5)
    recipes = Recipes(planned, corpus)
    displaced = [recipes.recipe("train", i).displaced for i in range(200)]
    assert 0.35 < np.mean(displaced) < 0.65
    assert not any(recipes.recipe("sim", i).displaced for i in range(40))


def test_a_displaced_block_is_seen_where_it_stands():
    layout = Layout((Block(Color.RED, Shape.CUBE, Cell(3, 3, 0)),))
    eyes = Eyes("nico", (960, 540))
    middle, beside = (eyes.shot(layout, "left_eye", 2, displaced) for displaced in (False, True))
    shift = displacements(layout, FARTHEST, generator(2, "displacement"))
    assert 0 < np.linalg.norm(shift) <= FARTHEST
    ends = np.array([3.5, 3.5, 0.5]) * BLOCK_SIZE + [[0, 0, 0], [*shift[0], 0]]
    ends = moved(robots.load("nico").robot_from_board, ends)
    expected = np.diff(middle.view.camera.project(ends), axis=0)
    seen = beside.view.boxes[0] - middle.view.boxes[0]
    np.testing.assert_allclose((seen[:2] + seen[2:]) / 2, expected[0], atol=1.5)
    assert "displaced" in beside.noise and "displaced" not in middle.noise


def test_a_held_out_layout_is_not_even_invented(sources, monkeypatch):
    corpus = load_corpus("treebank", sources.data)
    held_out, train = (corpus.split(part)[0].scene.before for part in ("test", "train"))
    drawn = iter([held_out, held_out, train])
    monkeypatch.setattr("fusionnet.dataset.recipes.varied_layout", lambda *_, **__: next(drawn))
    plan = BuildPlan(counts=(("train", 1),), corpus="treebank", corpus_digest="", varied=1.0)
    recipe = Recipes(plan, corpus).recipe("train", 0)
    assert recipe.command.scene.before.blocks == train.blocks


def test_every_layout_is_seen_in_every_view_before_any_comes_again(sources):
    plan = BuildPlan(
        counts=(("val", 60),),
        corpus="treebank",
        corpus_digest="",
        views=(("a",), ("d", "e", "f")),
    )
    corpus = load_corpus("treebank", sources.data)
    recipes = Recipes(plan, corpus)
    layouts = {c.scene.before for c in corpus.split("val")}
    first = [recipes.recipe("val", i) for i in range(3 * len(layouts))]
    assert len({(r.command.scene.before, r.camera) for r in first}) == 3 * len(layouts)
    commands = corpus.split("val")
    all_of_them = [recipes.recipe("val", i) for i in range(3 * len(commands))]
    shown = {(r.command.id, r.camera) for r in all_of_them}
    assert len(shown) == 3 * len(commands)


def test_a_sample_stores_causes_and_labels(built):
    for sample in StoredSamples(built, "train"):
        assert list(sample) == list(COLUMNS)
        before = layout_from_json(json.loads(sample["before"]))
        after = layout_from_json(json.loads(sample["after"]))
        assert [b.cell.index for b in before.blocks] == sample["block_cells"]
        assert [b.class_index for b in before.blocks] == sample["block_classes"]
        moved = before.at(Cell(*sample["move"]["source"]))
        assert after.at(Cell(*sample["move"]["target"])).color == moved.color
        assert format_tree(parse(sample["tree"])) == sample["tree"]
        assert len(sample["variants"]) == 3
        for variant in sample["variants"]:
            assert parse(variant["tree"]) == parse(sample["tree"]) and variant["applied"]
        size = (sample["width"], sample["height"])
        for box, block, lengths in zip(
            sample["boxes"], sample["box_blocks"], sample["masks"], strict=True
        ):
            rows, columns = np.nonzero(decode_mask(lengths, size))
            edges = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            assert box == edges and len(rows) == sample["block_pixels"][block]
        low, high = np.array(sample["joint_limits"]).T
        joints = np.array(sample["joints"])
        assert joints.shape == (14,)
        np.testing.assert_allclose((joints - low) / (high - low), sample["joints_scaled"])
        assert (sample["group"] is None) == (sample["origin"] == "varied")


def test_two_workers_give_the_same_bytes(tmp_path, built, plan, sources):
    build(tmp_path / "two", plan, sources, workers=2)
    assert digests(tmp_path / "two") == digests(built)


def test_a_full_disk_keeps_what_is_finished_and_the_build_goes_on(
    tmp_path, built, plan, sources, monkeypatch
):
    folder, written = tmp_path / "set", []
    fsync = os.fsync

    def full(handle):
        written.append(handle)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(handle)

    monkeypatch.setattr(shards.os, "fsync", full)
    with pytest.raises(OutputError, match=r"train-00002.* No space left .* Free some space"):
        build(folder, plan, sources)
    monkeypatch.undo()
    assert [f.name for f in sorted((folder / "data").iterdir())] == [
        "train-00000-of-00003.parquet",
        "train-00001-of-00003.parquet",
    ]
    with pytest.raises(DataError, match="not finished; start the same build again"):
        StoredSamples(folder, "train")
    # As a kill leaves it: a half-written shard, and a finished one without its record.
    (folder / "data" / ".train-00002-of-00003.parquet.99.part").write_bytes(b"half")
    (folder / ".records" / "train-00001-of-00003.json").unlink()
    made = build(folder, plan, sources)
    assert len(made) == len(plan.shards) - 2
    assert digests(folder) == digests(built)
    assert build(folder, plan, sources) == []


def test_a_shard_cut_short_is_named_and_made_again_alone(tmp_path, built, plan, sources):
    folder = shutil.copytree(built, tmp_path / "set")
    file = folder / "data" / "train-00001-of-00003.parquet"
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(DataError, match=r"train-00001-of-00003.parquet is damaged"):
        StoredSamples(folder, "train")[7]
    assert [fault.file for fault in check(folder)] == ["data/train-00001-of-00003.parquet"]
    assert [record.file for record in build(folder, plan, sources)] == [
        "data/train-00001-of-00003.parquet"
    ]
    assert digests(folder) == digests(built)


def test_checksums_of_a_stranger_say_numbers(tmp_path, built):
    (tmp_path / "checksums.json").write_text('{"x": {"rows": "5", "bytes": 1, "sha256": ""}}')
    with pytest.raises(DataError, match="rows and bytes of x are no numbers"):
        read_checksums(tmp_path)


def test_an_older_schema_is_named(tmp_path, built):
    folder = shutil.copytree(built, tmp_path / "set")
    plan_file = folder / "plan.json"
    plan_file.write_text(plan_file.read_text().replace('"schema": 2', '"schema": 1'))
    with pytest.raises(DataError, match="version 1 of the schema; this FusionNet reads version"):
        StoredSamples(folder, "train")
    shutil.copy(built / "plan.json", plan_file)
    file = folder / "data" / "train-00000-of-00003.parquet"
    table = pq.read_table(file)
    pq.write_table(table.replace_schema_metadata({"fusionnet.schema": "0"}), file)
    with pytest.raises(DataError, match=r"train-00000-of-00003.parquet has version 0"):
        StoredSamples(folder, "train")[0]
    pq.write_table(table.replace_schema_metadata({}), file)
    with pytest.raises(DataError, match="no shard of a FusionNet data set"):
        StoredSamples(folder, "train")[0]


def test_another_plan_or_other_files_are_not_overwritten(tmp_path, built, sources):
    other = small_plan(sources, seed=1)
    with pytest.raises(InputError, match="another plan: seed is 0 there and 1 here"):
        build(built, other, sources)
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="holds other files"):
        build(tmp_path, other, sources)
    with pytest.raises(InputError, match="At least one worker"):
        build(tmp_path / "new", other, sources, workers=0)
    with pytest.raises(UnknownNameError, match="no split 'valid'; it has train, val, test"):
        StoredSamples(built, "valid")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--eyes", "left_eye", "nose"], "no camera called 'nose'; available: left_eye, right_eye"),
        (["--robot", "nica"], "Did you mean 'nico'?"),
        (["--corpus", "examples"], "'examples' has no commands in 'train'"),
        (["--workers", "0"], "At least one worker"),
    ],
)
def test_what_cannot_be_built_leaves_nothing_behind(tmp_path, sources, capsys, options, said):
    words = ["dataset", "build", str(tmp_path / "set"), "--data", str(sources.data), "--scale", "1"]
    assert main([*words, *options]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "set").exists()


def test_a_worker_with_another_corpus_or_other_views_makes_nothing(plan, sources):
    with pytest.raises(DataError, match="planned with other commands of 'treebank'"):
        Studio(replace(plan, corpus_digest="0"), sources)
    with pytest.raises(DataError, match="planned with other views.*is none"):
        Studio(plan, replace(sources, views=None))


def test_sources_are_the_same_wherever_a_worker_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FUSIONNET_DATA", "data")
    (tmp_path / "mine").mkdir()
    assert Sources(views="rooms").absolute() == Sources(data=tmp_path / "data", views="rooms")
    named = Sources(data=Path("other"), views="mine").absolute()
    assert named == Sources(data=tmp_path / "other", views=str(tmp_path / "mine"))


def test_hugging_face_loads_it_as_it_is(built, tmp_path):
    datasets = pytest.importorskip("datasets")
    datasets.disable_progress_bars()
    loaded = datasets.load_dataset(str(built), cache_dir=str(tmp_path))
    assert {split: len(rows) for split, rows in loaded.items()} == {
        "train": 12,
        "val": 1,
        "test": 1,
        "sim_val": 1,
        "sim": 1,
    }
    sample = loaded["train"][0]
    assert sample["image"].size == SIZE
    names = loaded["train"].features["classes"].feature.names
    assert names[0] == "cube_blue" and len(names) == 16
    assert StoredSamples(built, "train")[0]["boxes"] == sample["boxes"]


def test_the_checksums_are_those_of_the_files(built):
    for name, record in read_checksums(built).items():
        content = (built / name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == record.sha256
        assert pq.read_metadata(built / name).num_rows == record.rows


def test_a_network_sees_what_the_renderer_shows():
    layout = Layout(
        (
            Block(Color.RED, Shape.CUBE, Cell(2, 3, 0)),
            Block(Color.GREEN, Shape.PRISM, Cell(2, 3, 1)),
            Block(Color.WHITE, Shape.CUBE, Cell(6, 1, 0)),
        )
    )
    look = Appearance.sample(generator(5, "look"))
    image, truth = label(SceneRenderer("nico"), layout, look)
    shot = Eyes("nico", (960, 540)).shot(layout, "left_eye", seed=5)
    after = apply(Move(Cell(6, 1, 0), Cell(0, 0, 0)), layout)
    command = replace(load_corpus("examples").commands[0], scene=Scene(layout, after))
    recipe = Recipe(
        id="x",
        command=command,
        origin="recorded",
        kind="eye",
        camera="left_eye",
        noised=False,
        seed=5,
    )
    sample = make_sample(recipe, shot, "nico", quality=95)
    labels = labels_of(sample, EYE_FRAME)
    for name in ("boxes", "classes", "cells", "visible", "matrix", "camera_from_board"):
        np.testing.assert_allclose(getattr(labels, name), getattr(truth, name), err_msg=name)
    assert labels.holding == truth.holding
    seen = decode(sample["image"]["bytes"], (960, 540), EYE_FRAME)
    assert np.abs(seen.astype(int) - image).mean() < 3


def test_each_eyes_picture_is_cropped_to_its_own_frame():
    layout, renderer = Layout((Block(Color.RED, Shape.CUBE, Cell(2, 3, 0)),)), SceneRenderer("nico")
    seen, truth = label(renderer, layout, Appearance(), camera="right_eye")
    frame = EYE_FRAMES["right_eye"]
    same, expected = label(renderer, layout, Appearance(), frame, "right_eye")
    np.testing.assert_array_equal(seen, same)
    np.testing.assert_array_equal(truth.boxes, expected.boxes)
    with pytest.raises(UnknownNameError, match="No frame is known of the camera 'external'"):
        label(renderer, layout, Appearance(), camera="external")


def test_pictures_of_a_split_are_read_in_any_order_by_any_process(built):
    pictures = StoredPictures(built, "train")
    assert len(pictures) == 12
    order = pictures.order(seed=0, epoch=1)
    assert sorted(order) == list(range(12)) and list(order) != list(range(12))
    image, labels = pictures[-1]
    assert image.shape == (416, 480, 3) and (labels.cells != EMPTY).any()
    assert (labels.boxes >= 0).all() and (labels.boxes <= [480, 416, 480, 416]).all()
    again = StoredPictures.__new__(StoredPictures)
    again.__dict__ = {**pictures.__dict__}
    state = pictures.samples.__getstate__()
    assert not {"_opened", "_groups"} & set(state)
    again.samples = StoredSamples.__new__(StoredSamples)
    again.samples.__setstate__(state)
    np.testing.assert_array_equal(again[11][0], image)
    with pytest.raises(IndexError):
        pictures[12]


@given(
    st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    st.floats(0.4, 1.2),
    st.sampled_from([(352, 304), (512, 288)]),
)
def test_the_frame_of_a_view_holds_the_whole_grid(turn, distance, input_size):
    rotation = rotation_from_vector(np.array(turn)) @ np.diag([1.0, -1.0, -1.0])
    middle = rotation @ np.array([0.105, 0.105, 0.1])
    pose = transform(rotation, np.array([0.0, 0.0, distance]) - middle)
    matrix = np.array([[600.0, 0, 479.5], [0, 600.0, 269.5], [0, 0, 1.0]])
    frame = grid_frame(matrix, pose, (960, 540), input_size)
    corners = np.array([[x, y, z, 1] for x in (0, 0.21) for y in (0, 0.21) for z in (0, 0.21)])
    seen = corners @ pose[:3].T @ frame.matrix(matrix).T
    pixels = seen[:, :2] / seen[:, 2:]
    outside = (pixels < 0).any() or (pixels > input_size).any()
    whole = frame.crop[:2] == (0, 0) or frame.crop[2:] == (960, 540)
    clipped = any(edge == limit for edge, limit in zip(frame.crop, (0, 0, 960, 540), strict=True))
    assert not outside or whole or clipped


def test_a_grid_behind_the_camera_cannot_be_framed():
    with pytest.raises(InputError, match="behind the camera"):
        grid_frame(np.eye(3), transform(np.eye(3), np.array([0, 0, -1.0])), (960, 540), (352, 304))


def test_a_reduced_picture_is_decoded_like_the_whole_one():
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 256, (27, 48, 3)).astype(np.uint8)
    image = np.ascontiguousarray(np.kron(coarse, np.ones((20, 20, 1), np.uint8)))
    jpeg = encode_jpeg(image, 95)
    reduced = decode(jpeg, (960, 540), whole_frame((960, 540), (480, 270)))
    wanted = PictureFrame((960, 540), (0, 0, 960, 540), (480, 270)).prepare(image)
    assert np.abs(reduced.astype(int) - wanted).mean() < 3
    for damaged in (jpeg[:50], b"", np.zeros(0, np.uint8)):
        with pytest.raises(DataError, match="none instead of 960 x 540"):
            decode(damaged, (960, 540), EYE_FRAME)


def test_a_cameras_noise_is_an_option_and_older_plans_have_it(plan, sources):
    before = plan.as_json()
    del before["sensor"]
    assert BuildPlan.from_json(json.loads(json.dumps(before))) == plan
    layout = Layout((Block(Color.RED, Shape.CUBE, Cell(2, 3, 0)),))
    views = sources.environmental_views()
    noisy, plain = (
        Photographs(views, "nico", SIZE, 0.15, sensor=sensor).shot(layout, views[0].name, 3, True)
        for sensor in (True, False)
    )
    np.testing.assert_array_equal(noisy.view.block_at, plain.view.block_at)
    assert np.any(noisy.view.image != plain.view.image)
    assert json.loads(plain.noise)["kind"] == "level one"
