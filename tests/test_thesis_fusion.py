"""The thesis's FusionNet: recipe, training on a data set, resume, checkpoints, both stages."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.sources import Sources
from fusionnet.errors import CheckpointError, InputError
from fusionnet.models import heads
from fusionnet.models.hub import checkpoint_folder
from fusionnet.models.labelled_boxes import Boxes
from fusionnet.models.target_text import END, START
from fusionnet.models.thesis_fusion_config import THESIS_HEADS, thesis
from fusionnet.models.thesis_fusionnet import ThesisFusionNet
from fusionnet.models.transformer import Transformer
from fusionnet.models.transformer_network import number_rows
from fusionnet.training import thesis_fusion
from fusionnet.training.fusion_examples import FusionExamples
from fusionnet.training.loop import fit
from fusionnet.training.thesis_fusion import new_model, train
from fusionnet.training.thesis_fusion_config import (
    SmallThesisFusionConfig,
    ThesisFusionConfig,
    small_sizes,
    thesis_loop,
)
from fusionnet.training.thesis_measures import degrees, executed
from tiny_treebank import write_tiny_treebank


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    sources = Sources(data=write_tiny_treebank(tmp_path_factory.mktemp("corpus")))
    folder = tmp_path_factory.mktemp("data") / "set"
    build(folder, plan_for("4", "treebank", sources, size=(320, 180), shard=4), sources)
    return folder


@pytest.fixture
def config(stored, tmp_path):
    plain = SmallThesisFusionConfig(dataset=stored)
    loop = dataclasses.replace(plain.loop, steps=4, log_every=1, save_every=2, tensorboard=False)
    sizes = dataclasses.replace(small_sizes(), pyramid_width=16, subnet_depth=1, layers=1)
    return dataclasses.replace(
        plain,
        out=tmp_path / "checkpoint",
        work=tmp_path / "work",
        sizes=sizes,
        check=("sim_val",),
        batch=2,
        loop=loop,
    )


def test_the_recipe_is_that_of_tables_7_1_to_7_3():
    recipe = ThesisFusionConfig(dataset=Path("set"))
    loop, sizes = recipe.loop, recipe.sizes
    assert (loop.steps, recipe.batch, loop.learning_rate) == (32_000, 1, 1e-5)
    optimizer = loop.optimizer
    assert (optimizer.kind, optimizer.beta_1, optimizer.beta_2) == ("adam", 0.9, 0.999)
    assert optimizer.epsilon == 1e-9
    plateau = loop.schedule
    assert (plateau.kind, plateau.factor, plateau.check_every, plateau.patience) == (
        "plateau",
        0.1,
        1000,
        2,
    )
    assert plateau.monitor == "joints"
    assert sizes.backbone == "resnet152" and sizes.input_size == (990, 540)
    assert (sizes.nodes, sizes.longest, sizes.layers, sizes.heads) == (4, 200, 4, 4)
    assert (sizes.embedding_size, sizes.attention_size, sizes.feed_forward_size) == (50, 12, 256)
    assert set(recipe.outputs) == {"boxes", "classes", "tree", "joints"}
    assert {loop.loss_weights[name] for name in recipe.outputs} == {1.0}


def test_training_writes_a_checkpoint_that_answers_alike_and_a_card(config):
    metrics = train(config)
    assert {"joint_mse", "loss_boxes", "loss_classes", "loss_tree", "token_accuracy"} <= set(
        metrics["sim_val"]
    )
    model = ThesisFusionNet.from_pretrained(config.out, robot="nico")
    assert model.config.joint_limits == new_model(config).config.joint_limits
    images = torch.randint(0, 255, (2, 88, 160, 3), dtype=torch.uint8)
    said = ["Put the red block down", "xyzzy"]
    joints, written, found = model.answer(images, said)
    assert joints.shape == (2, 14) and set(found) == set(model.config.heads)
    assert len(written) == 2 and {t for w in written for t in w} <= {
        *model.config.target,
        "<unknown>",
    }
    low, high = np.array(model.config.joint_limits).T
    assert (joints >= low - 1e-9).all() and (joints <= high + 1e-9).all()
    model.save_pretrained(config.out.parent / "again")
    again = ThesisFusionNet.from_pretrained(str(config.out.parent / "again"))
    assert np.array_equal(again.answer(images, said).joints, joints)
    card = (config.out / "README.md").read_text()
    assert "library_name: fusionnet" in card and "## Limits" in card and "joint mse" in card
    assert "treebank" in card


def test_a_resumed_run_ends_where_an_unbroken_one_does(config, tmp_path):
    whole, *_ = thesis_fusion.run(dataclasses.replace(config, work=tmp_path / "one"))
    half = dataclasses.replace(config.loop, steps=2)
    thesis_fusion.run(dataclasses.replace(config, loop=half))
    resumed, *_ = thesis_fusion.run(config)
    for (name, one), other in zip(
        whole.state_dict().items(), resumed.state_dict().values(), strict=True
    ):
        assert torch.equal(one, other), name


@pytest.mark.parametrize(
    ("changes", "losses"),
    [
        ({"outputs": ("joints",)}, {"joints"}),
        ({"outputs": ("classes", "tree", "joints")}, {"classes", "tree", "joints"}),
        ({"vision": "cnn", "outputs": ("tree", "joints")}, {"tree", "joints"}),
        ({"writes": "english"}, {"boxes", "classes", "tree", "joints"}),
        ({"writes": "rcl", "fuser": "attention"}, {"boxes", "classes", "tree", "joints"}),
        ({"outputs": ("occupancy", "joints")}, {"occupancy", "joints"}),
    ],
)
def test_outputs_are_switched_off_and_modules_exchanged(config, changes, losses):
    loop = dataclasses.replace(config.loop, steps=1)
    chosen = dataclasses.replace(config, work=None, loop=loop, **changes)
    _, history, _ = thesis_fusion.run(chosen)
    assert set(history[-1]) == {"step", "seconds", "learning_rate", "loss", *losses}


def test_a_factor_of_zero_leaves_what_only_that_loss_reaches(config):
    weights = {"boxes": 0.0, "tree": 0.0}
    chosen = dataclasses.replace(
        config, work=None, loop=dataclasses.replace(config.loop, loss_weights=weights)
    )
    before = new_model(chosen).state_dict()
    model, *_ = thesis_fusion.run(chosen)
    after = model.state_dict()
    for part in ("detector.box_head.regress.2.weight", "transformer.output.weight"):
        assert torch.equal(before[part], after[part])
    assert not torch.equal(
        before["detector.box_head.classify.2.weight"], after["detector.box_head.classify.2.weight"]
    )


def test_one_batch_is_learnt_by_heart(config):
    model = new_model(config)
    examples = FusionExamples(config.dataset, "train", model.config.detector.frame, keep=True)
    batch = model.batch_of([examples.example(i, model) for i in range(4)])
    loop = dataclasses.replace(config.loop, steps=60, learning_rate=3e-3, log_every=20)
    history = fit(model, lambda _: iter([batch] * 60), lambda n, b: n.losses(b), loop)
    assert history[-1]["joints"] < 0.004 < 0.02 < history[0]["joints"]
    assert history[-1]["tree"] < history[0]["tree"]


def test_one_of_four_sentences_is_drawn_and_the_target_is_left_alone(config):
    model = new_model(config)
    examples = FusionExamples(config.dataset, "train", model.config.detector.frame)
    drawn = [examples.example(0, model, np.random.default_rng(s)) for s in range(40)]
    assert len({e.source for e in drawn}) == 4 and len({e.target for e in drawn}) == 1
    assert examples.example(0, model).source in {e.source for e in drawn}
    english = new_model(dataclasses.replace(config, writes="english"))
    said = [examples.example(0, english, np.random.default_rng(s)) for s in range(40)]
    assert len({e.target for e in said}) == 4


def drawn_by_a_run(config, monkeypatch, batches=24):
    """The pictures and the sentences, as numbers, of a run's first batches."""
    seen = []

    def take(model, make, *_, **__):
        seen.extend(batch for batch, _ in zip(make(0), range(batches), strict=False))
        return []

    monkeypatch.setattr(thesis_fusion, "fit", take)
    monkeypatch.setattr(thesis_fusion, "measure", lambda *_, **__: {})
    thesis_fusion.run(config)
    pictures = [picture.numpy().tobytes() for batch in seen for picture in batch.images]
    said = [tuple(n for n in row if n) for batch in seen for row in batch.source.tolist()]
    return pictures, said


@pytest.mark.parametrize("pictures", [True, False])
@pytest.mark.parametrize("sentences", [True, False])
def test_pictures_and_sentences_are_noised_each_by_itself(config, monkeypatch, pictures, sentences):
    chosen = dataclasses.replace(config, noised_pictures=pictures, noised_sentences=sentences)
    seen, said = drawn_by_a_run(chosen, monkeypatch)
    model = new_model(config)
    examples = FusionExamples(config.dataset, "train", model.config.detector.frame)
    clean = [examples.example(i, model) for i in range(len(examples))]
    clean_pictures = {example.picture.tobytes() for example in clean}
    clean_sentences = {example.source for example in clean}
    noised = np.mean([picture not in clean_pictures for picture in seen])
    other = np.mean([sentence not in clean_sentences for sentence in said])
    assert noised == pytest.approx(0.75, abs=0.2) if pictures else noised == 0
    assert other == pytest.approx(0.75, abs=0.2) if sentences else other == 0


def test_both_are_noised_in_the_presets_as_in_the_thesis():
    for preset in (ThesisFusionConfig, SmallThesisFusionConfig):
        recipe = preset(dataset=Path("set"))
        assert recipe.noised_pictures and recipe.noised_sentences


def test_boxes_follow_a_noised_picture(config, monkeypatch):
    model = new_model(config)
    examples = FusionExamples(config.dataset, "train", model.config.detector.frame)
    sample, picture, _ = examples.pictures.read(0)
    marked = np.zeros_like(picture)
    marked[40:50, 70:86] = 255
    box = Boxes(torch.tensor([[70.0, 40.0, 86.0, 50.0]]), torch.tensor([3]), torch.ones(1))
    monkeypatch.setattr(examples.pictures, "read", lambda _: (dict(sample), marked, box))
    moved = 0
    for seed in range(30):
        example = examples.example(0, model, np.random.default_rng(seed))
        rows, columns = np.nonzero(example.picture[..., 0] > 127)
        around = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        found = example.boxes.xyxy[0].numpy()
        assert example.boxes.classes.tolist() == [3]
        assert (np.abs(found - around) <= 2).all(), seed
        moved += not np.array_equal(found, [70, 40, 86, 50])
    assert 15 <= moved < 30
    clean = examples.example(0, model, np.random.default_rng(1), pictures=False)
    assert np.array_equal(clean.picture, marked)


@pytest.mark.parametrize(("ends", "distinct", "lengths"), [(0.0, 3, 1), (3.0, 2, 2)])
def test_what_is_written_with_a_cache_is_what_is_written_step_by_step(
    config, ends, distinct, lengths
):
    model = new_model(config).eval()
    torch.manual_seed(2)
    with torch.no_grad():
        for parameter in model.transformer.parameters():
            if parameter.dim() > 1:
                parameter.copy_(torch.randn_like(parameter))
        model.transformer.output.bias[model.target.number(END)] = ends
    said = ["put the red cube down", "take", "move the blue pyramid on the gray cube please"]
    source = number_rows([model.numbers(s) for s in said])
    written = model.write(source)
    end, start = model.target.number(END), model.target.number(START)
    rows = []
    for row in range(len(said)):
        alone, tokens = number_rows([model.numbers(said[row])]), [start]
        while len(tokens) < model.config.transformer.longest:
            with torch.inference_mode():
                logits = model.transformer(alone, torch.tensor([tokens]))[0, -1]
            if int(logits.argmax()) == end:
                break
            tokens.append(int(logits.argmax()))
        rows.append(tokens)
    assert len({tuple(r) for r in rows}) == distinct and len({len(r) for r in rows}) == lengths
    for row, tokens in zip(written.tolist(), rows, strict=True):
        assert row[: len(tokens)] == tokens and not any(row[len(tokens) :])


def test_the_preset_is_the_network_of_tables_7_1_to_7_3():
    limits = [(-1.0, 1.0)] * 14
    config = thesis("nico", limits, ["put", "it"], [START, END, "event"])
    assert config.detector.backbone == "resnet152" and config.detector.fusion_nodes == 4
    assert config.detector.frame.input_size == (990, 540) and config.detector.width == 256
    sizes = config.transformer
    assert (sizes.layers, sizes.heads, sizes.attention_size, sizes.dropout) == (4, 4, 12, 0.15)
    assert (config.fuser, config.writes, config.heads) == ("concatenate", "rcl", THESIS_HEADS)
    network = ThesisFusionNet(thesis("nico", limits, ["a"], [START, END], sizes=small_sizes()))
    assert network.config.detector.backbone == "tiny"


def test_a_transformer_that_writes_something_else_is_refused(config, tmp_path, caplog):
    model = new_model(config)
    words = model.config.source, model.config.target
    kept = Transformer(model.transformer, model.source, model.target, model.source, writes="short")
    kept.save(tmp_path / "short", metadata={})
    again = new_model(dataclasses.replace(config, seed=1, translator=tmp_path / "short"))
    assert (again.config.source, again.config.target) == words
    with pytest.raises(CheckpointError, match="trained to write 'short'.*is to write 'rcl'"):
        new_model(dataclasses.replace(config, writes="rcl", translator=tmp_path / "short"))
    for changes, said in (
        ({"layers": 2}, "layers is 1 there, 2 here"),
        ({"feed_forward_size": 64}, "feed_forward_size is 128 there, 64 here"),
    ):
        sizes = dataclasses.replace(config.sizes, **changes)
        with pytest.raises(CheckpointError, match=f"{said}.*Choose the same sizes as it was"):
            new_model(dataclasses.replace(config, sizes=sizes, translator=tmp_path / "short"))
    name = "transformer.encoder.0.wide.weight"
    assert torch.equal(again.state_dict()[name], model.state_dict()[name])
    assert "begin anew" not in caplog.text
    sizes = dataclasses.replace(config.sizes, nodes=6)
    more = new_model(dataclasses.replace(config, sizes=sizes, translator=tmp_path / "short"))
    assert torch.equal(more.state_dict()[name], model.state_dict()[name])
    assert "was trained with 4, and here are 6" in caplog.text


def test_weights_are_transferred_and_misfits_refused(config, tmp_path):
    model = new_model(config)
    assert model.detector is not None
    model.detector.save(tmp_path / "detector", {}, half=False)
    other = new_model(dataclasses.replace(config, seed=1, detector=tmp_path / "detector"))
    name = "detector.box_head.classify.0.weight"
    assert torch.equal(other.state_dict()[name], model.state_dict()[name])
    nodes = dataclasses.replace(config.sizes, nodes=6)
    wider = new_model(dataclasses.replace(config, sizes=nodes, detector=tmp_path / "detector"))
    assert torch.equal(wider.state_dict()[name], model.state_dict()[name])
    wrong = dataclasses.replace(config.sizes, pyramid_width=24)
    with pytest.raises(CheckpointError, match=r"width is 16 there, 24 here; .*box_head"):
        new_model(dataclasses.replace(config, sizes=wrong, detector=tmp_path / "detector"))
    with pytest.raises(CheckpointError, match="expected a 'transformer'"):
        new_model(dataclasses.replace(config, translator=tmp_path / "detector"))


def test_a_checkpoint_of_another_robot_or_schema_is_refused(config):
    new_model(config).save(config.out)
    with pytest.raises(CheckpointError, match="trained for the robot 'nico'.*'gantry'"):
        ThesisFusionNet.from_pretrained(config.out, robot="gantry")
    file = config.out / "config.json"
    document = json.loads(file.read_text())
    for changes, message in (
        ({"schema_version": 9}, "schema version 9"),
        ({"kind": "retinanet"}, "holds a 'retinanet', expected a 'thesis-fusionnet'"),
        ({"config": {**document["config"], "robot": "pepper"}}, "'pepper', which is not here"),
        ({"config": {**document["config"], "joint_names": ["a"]}}, "pairs of limits"),
        ({"config": {"robot": "nico"}}, "no configuration of a FusionNet"),
    ):
        file.write_text(json.dumps(document | changes))
        with pytest.raises(CheckpointError, match=message):
            ThesisFusionNet.from_pretrained(config.out)


def test_a_name_that_is_no_folder_nor_on_the_hub_is_refused(monkeypatch, tmp_path):
    with pytest.raises(CheckpointError, match="expected a folder with config.json"):
        checkpoint_folder(tmp_path / "none")
    with pytest.raises(CheckpointError, match="hub name like owner/name"):
        checkpoint_folder("a/b/c")
    import huggingface_hub

    def offline(*_, **__):
        raise OSError("no route to host")

    monkeypatch.setattr(huggingface_hub, "snapshot_download", offline)
    with pytest.raises(CheckpointError, match=r"owner/name.*\(no route to host\)"):
        checkpoint_folder("owner/name")
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(CheckpointError, match="pip install 'fusionnet"):
        checkpoint_folder("owner/name")


def test_bad_settings_are_refused(config):
    with pytest.raises(InputError, match="has the head 'joints'"):
        new_model(dataclasses.replace(config, outputs=("tree",)))
    with pytest.raises(InputError, match="plain vision has no boxes"):
        new_model(dataclasses.replace(config, vision="cnn"))
    with pytest.raises(InputError, match="batch and checked"):
        dataclasses.replace(config, batch=0)
    assert thesis_loop().clip == 10.0


def test_exact_joints_land_the_block_and_wrong_ones_do_not(config):
    model = new_model(config)
    examples = FusionExamples(config.dataset, "sim", model.config.detector.frame)
    sample = examples.example(0, model).sample
    joints = np.array(sample["joints"])
    assert executed("nico", sample, joints, 0)
    assert not executed("nico", sample, joints + 0.1, 0)
    assert not executed("nico", sample, joints + 1.0, 0)
    off = degrees(joints[None] + np.pi / 180, joints[None])
    assert off["grasp_error_degrees"] == pytest.approx(1)


def test_every_head_in_the_catalogue_can_be_weighted_from_the_command_line():
    assert set(thesis_loop().loss_weights) == set(heads.names())
