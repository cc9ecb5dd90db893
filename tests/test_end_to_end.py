"""The compact FusionNet as one graph: gradients from the joints to the pixels, and training it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dataset_fixtures import small_sources
from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.sources import Sources
from fusionnet.errors import InputError, OutputError
from fusionnet.models.end_to_end import EndToEnd
from fusionnet.models.heads.occupancy import Occupancy
from fusionnet.policy import load_policy
from fusionnet.training import detector
from fusionnet.training.end_to_end import (
    LOSS_WEIGHTS,
    LOSSES,
    EndToEndConfig,
    Representation,
    end_to_end_losses,
    load,
    measure,
    train,
)
from fusionnet.training.eye_commands import EyeCommands

TASK = {"grasp", "place", "holds", "joints"}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("eye")
    sources = Sources(data=small_sources(folder).data)
    plan = plan_for("8", "treebank", sources, size=(960, 540), varied=0.5)
    build(folder / "set", plan, sources)
    return folder / "set"


@pytest.fixture
def model() -> EndToEnd:
    torch.set_num_threads(1)
    return load("compact", readings=3)


def test_it_answers_as_the_policy_of_its_parts(stored: Path, model: EndToEnd) -> None:
    commands = EyeCommands(stored, "sim_val")
    batch = commands.batch([0], model.translator)
    with torch.inference_mode():
        expected = model(batch.seen.images, batch.sentences).expected
    sight = model.detector.see_prepared(batch.seen.images[0].numpy())
    readings = model.translator.read(batch.sentences, [sight.holding > 0.5], beam=4, count=3)[0]
    answer = model.fusion(sight.cells, sight.holding, [(r.tree, r.probability) for r in readings])
    assert np.allclose(expected.source[0].numpy(), answer.source, atol=1e-3)
    assert np.allclose(expected.target[0].numpy(), answer.target, atol=1e-3)


def test_the_joints_teach_pixels_filters_and_the_choice_of_readings(
    stored: Path, model: EndToEnd
) -> None:
    batch = EyeCommands(stored, "train").batch([0, 1], model.translator)
    losses = end_to_end_losses(model, model, batch, representations=())
    assert set(losses) == TASK
    losses["joints"].backward()
    reached = {name for name, p in model.named_parameters() if p.grad is not None and p.grad.any()}
    assert any(name.startswith("detector.backbone.fine.0") for name in reached)
    assert any(name.startswith("detector.pose_head.refine") for name in reached)
    assert any(name.startswith("language.encoder") for name in reached)
    assert any(name.startswith("fusion.executor") for name in reached)
    assert not any("box_head" in name for name in reached)


@pytest.mark.parametrize("kept", list(LOSSES))
def test_a_representation_brings_its_own_losses(
    stored: Path, model: EndToEnd, kept: Representation
) -> None:
    batch = EyeCommands(stored, "train").batch([0, 1], model.translator)
    losses = end_to_end_losses(model, model, batch, representations=(kept,))
    assert set(losses) == TASK | set(LOSSES[kept])
    assert all(torch.isfinite(loss) for loss in losses.values())


def test_all_that_the_reader_learns_from_has_a_representation_and_a_factor() -> None:
    reader = set(detector.LOSS_WEIGHTS)
    assert reader | {"symbols", "words"} == {loss for some in LOSSES.values() for loss in some}
    assert {name: LOSS_WEIGHTS[name] for name in reader} == detector.LOSS_WEIGHTS


def test_sentences_that_say_nothing_teach_nothing_of_the_move(
    stored: Path, model: EndToEnd, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch = EyeCommands(stored, "train").batch([0, 1], model.translator)
    monkeypatch.setattr(model.translator, "read", lambda said, *_, **__: [()] * len(said))
    losses = end_to_end_losses(model, model, batch)
    assert all(float(losses[name].detach()) == 0 for name in TASK)
    torch.stack(list(losses.values())).sum().backward()


def test_a_detector_of_another_size_gets_pictures_of_its_own(stored: Path, model: EndToEnd) -> None:
    commands = EyeCommands(stored, "train")
    commands.seen_by(replace(model.detector.frame, input_size=(352, 304)))
    assert commands.batch([0, 1], model.translator).seen.images.shape == (2, 304, 352, 3)


def test_learning_from_the_joints_alone_brings_back_a_reader_that_lost_its_colours(
    stored: Path, model: EndToEnd
) -> None:
    commands = EyeCommands(stored, "train")
    batch = commands.batch(list(range(4)), model.translator)
    head = model.detector.occupancy_head
    assert isinstance(head, Occupancy)
    with torch.no_grad():
        head.classify.weight += 0.2 * torch.randn(
            head.classify.weight.shape, generator=torch.Generator().manual_seed(0)
        )
    optimizer = torch.optim.Adam(head.classify.parameters(), lr=8e-3)
    model.eval()
    errors = []
    for _ in range(12):
        losses = end_to_end_losses(model, model, batch, representations=())
        loss = losses["grasp"] + losses["place"] + losses["joints"]
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(float(loss.detach()))
    assert errors[-1] < 0.5 * errors[0]


def test_training_writes_a_policy_that_moves_and_goes_on_where_it_stopped(
    stored: Path, tmp_path: Path
) -> None:
    config = EndToEndConfig(
        dataset=stored,
        out=tmp_path / "policy",
        work=tmp_path / "work",
        batch=2,
        readings=2,
        checked=1,
        loop=replace(EndToEndConfig(dataset=stored).loop, steps=2, save_every=1, tensorboard=False),
        threads=1,
    )
    stopped = replace(config, out=tmp_path / "stopped", loop=replace(config.loop, steps=1))
    train(stopped)
    metrics = train(config)
    assert metrics["after"]["samples"] == 1
    straight = replace(config, out=tmp_path / "straight", work=tmp_path / "other")
    train(straight)
    for part in ("detector", "translator", "fusion"):
        file = f"{part}/model.safetensors"
        assert (config.out / file).read_bytes() == (straight.out / file).read_bytes()
    assert load_policy(config.out).right is not None
    with pytest.raises(OutputError, match="holds files already"):
        train(config)


def test_pictures_of_other_cameras_are_refused(tmp_path: Path) -> None:
    sources = small_sources(tmp_path)
    plan = plan_for("4", "treebank", sources, size=(320, 180))
    build(tmp_path / "set", plan, sources)
    with pytest.raises(InputError, match="left eye did not take"):
        EyeCommands(tmp_path / "set", "train")


def test_nothing_to_measure_is_refused(stored: Path) -> None:
    with pytest.raises(InputError, match="at least 1"):
        EndToEndConfig(dataset=stored, checked=0)


def test_an_accelerator_is_refused(stored: Path) -> None:
    loop = replace(EndToEndConfig(dataset=stored).loop, accelerator="cuda")
    with pytest.raises(InputError, match="on a cpu, not on 'cuda'"):
        EndToEndConfig(dataset=stored, loop=loop)


def test_what_is_measured_counts_both_cells(stored: Path, model: EndToEnd) -> None:
    measured = measure(model, EyeCommands(stored, "sim_val"), 5)
    rates = {"cells_right", "layouts_right", "blocks_right", "answered"}
    assert set(measured) == rates | {"joint_mse", "samples"}
    assert all(0 <= measured[name] <= 1 for name in rates)
    assert 0 <= measured["cells_right"] <= measured["answered"] <= 1
