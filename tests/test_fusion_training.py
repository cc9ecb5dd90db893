"""What the fusion part is trained on, and that training it runs."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load_file, save_file

from fusionnet.blocks import Layout, plan, random_layout, validate
from fusionnet.corpora import load_corpus
from fusionnet.errors import CheckpointError, DataError, InputError
from fusionnet.models.fusionnet import FusionNet, compact
from fusionnet.models.retinanet import RetinaNet
from fusionnet.rcl import Action, events, format
from fusionnet.training.fusion import FusionBatch, FusionConfig, draw_batch, train
from fusionnet.training.loop import LoopConfig, fit
from fusionnet.training.planned_examples import PlannedExamples
from fusionnet.training.reader_outputs import (
    collect_reader_outputs,
    load_reader_outputs,
    save_reader_outputs,
)
from fusionnet.training.simulated_readings import cells_of, exact_readings, simulated_readings
from tiny_treebank import write_tiny_treebank

DETECTOR = Path(__file__).resolve().parent.parent / "src/fusionnet/weights/compact/detector"


@pytest.fixture(scope="module")
def examples() -> PlannedExamples:
    return PlannedExamples(load_corpus("examples").commands)


def test_every_example_is_a_possible_layout_with_the_planners_move(
    examples: PlannedExamples,
) -> None:
    actions = set()
    for number in range(60):
        example = examples.numbered(0, number)
        validate(example.layout)
        assert plan(example.tree, example.layout) == example.move
        assert events(example.tree)[0].action.value == Action.DROP or not example.move.begins_held
        actions.add(events(example.tree)[0].action.value)
    assert actions == set(Action)


def test_examples_are_varied_and_reproducible(examples: PlannedExamples) -> None:
    again = PlannedExamples(load_corpus("examples").commands)
    first = [examples.numbered(7, number) for number in range(20)]
    assert first == [again.numbered(7, number) for number in range(20)]
    assert len({format(example.tree, tokens=False) for example in first}) > 12
    assert len({frozenset(example.layout.blocks) for example in first}) > 15


def test_a_tree_is_found_for_a_given_layout(examples: PlannedExamples) -> None:
    layout = load_corpus("examples").commands[2].scene.before
    example = examples.draw_on(layout, np.random.default_rng(0))
    assert example is not None
    assert example.layout is layout
    assert plan(example.tree, layout) == example.move
    assert examples.draw_on(Layout(()), np.random.default_rng(0)) is None


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), severity=st.floats(0, 1))
def test_simulated_readings_are_probabilities(seed: int, severity: float) -> None:
    rng = np.random.default_rng(seed)
    cells, held = cells_of([random_layout(rng)])
    occupancy, holding = simulated_readings(cells, held, rng, np.array([severity]))
    assert occupancy.min() >= 0
    assert np.allclose(occupancy.sum(-1), 1, atol=1e-5)
    assert 0 <= holding[0] <= 1


def test_a_reading_without_severity_is_exact() -> None:
    rng = np.random.default_rng(0)
    cells, held = cells_of([random_layout(rng) for _ in range(5)])
    occupancy, holding = simulated_readings(cells, held, rng, np.zeros(5))
    exact, exact_holding = exact_readings(cells, held)
    assert np.allclose(occupancy, exact, atol=1e-6)
    assert np.allclose(holding, exact_holding)


def test_what_shows_is_read_better_than_what_hides() -> None:
    rng = np.random.default_rng(0)
    cells = np.full((200, 8, 8, 8), 16)
    cells[:, 3, 3, :3] = 2  # three red cubes: the upper one shows its top,
    cells[:, 2, 3, :3] = 4  # the lower ones are behind three yellow ones
    occupancy, _ = simulated_readings(cells, np.full(200, -1), rng, np.ones(200))
    right = occupancy[:, 3, 3, :3, 2].mean(0)
    assert right[2] > right[1] + 0.1
    assert right[2] > right[0] + 0.1
    assert occupancy[:, 2, 3, 2, 4].mean() > 0.9


def test_real_readings_can_be_kept_and_trained_on(
    examples: PlannedExamples, tmp_path: Path
) -> None:
    layouts = [command.scene.before for command in load_corpus("examples").commands]
    cells, held = cells_of(layouts)
    occupancy, holding = simulated_readings(cells, held, np.random.default_rng(0))
    file = tmp_path / "kept" / "readings.npz"
    save_reader_outputs(file, occupancy, holding, layouts)
    outputs = load_reader_outputs(file)
    assert len(outputs) == len(layouts)
    for place, layout in enumerate(layouts):
        assert outputs.layout(place).same_blocks(layout)
        kept, kept_holding = outputs.reading(place)
        assert np.allclose(kept, occupancy[place], atol=1e-3)
        assert kept_holding == pytest.approx(float(holding[place]), abs=1e-3)
    config = FusionConfig(batch=8, read_share=0.5)
    batch = draw_batch(examples, outputs, config, 0)
    assert batch.occupancy.shape == (8, 8, 8, 8, 17)
    half = batch.occupancy[:4].numpy()
    assert all(
        np.abs(half[i] - outputs.occupancy.reshape(-1, 8, 8, 8, 17)).max((1, 2, 3, 4)).min() < 1e-6
        for i in range(4)
    )


def test_a_readers_outputs_are_collected_from_rendered_pictures(
    pictures_here: None, tmp_path: Path
) -> None:
    seen = []
    file = tmp_path / "outputs.npz"
    collect_reader_outputs(
        file,
        RetinaNet.from_folder(DETECTOR),
        [command.scene.before for command in load_corpus("examples").commands],
        count=2,
        seed=0,
        progress=lambda done, count: seen.append((done, count)),
    )
    outputs = load_reader_outputs(file)
    assert seen == [(1, 2), (2, 2)]
    for place in range(2):
        validate(outputs.layout(place))
        read, _ = outputs.reading(place)
        truth = outputs.cells[place].reshape(8, 8, 8)
        filled = truth != 16
        assert np.take_along_axis(read, truth[..., None], -1)[..., 0][filled].mean() > 0.5


def test_damaged_readings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="Cannot read"):
        load_reader_outputs(tmp_path / "none.npz")
    (tmp_path / "bad.npz").write_bytes(b"PK\x03\x04 not really")
    with pytest.raises(DataError, match="Cannot read"):
        load_reader_outputs(tmp_path / "bad.npz")
    np.savez(
        tmp_path / "odd.npz",
        occupancy=np.zeros((2, 5)),
        holding=np.zeros(2),
        cells=np.zeros((2, 512)),
        held=np.zeros(2),
    )
    with pytest.raises(DataError, match="expected"):
        load_reader_outputs(tmp_path / "odd.npz")


def test_a_batch_depends_on_its_step_alone(examples: PlannedExamples) -> None:
    config = FusionConfig(batch=6)
    one = draw_batch(examples, None, config, 3)
    draw_batch(examples, None, config, 4)
    again = draw_batch(PlannedExamples(load_corpus("examples").commands), None, config, 3)
    assert bool((one.occupancy == again.occupancy).all())
    assert one.source.tolist() == again.source.tolist()


@pytest.mark.parametrize("wrong", [{"threads": 0}, {"batch": 0}, {"exact": 1.5}])
def test_configurations_that_cannot_train_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError):
        FusionConfig(**wrong)


def test_training_writes_a_checkpoint_with_its_metrics(data_folder: Path, tmp_path: Path) -> None:
    seen = []
    config = FusionConfig(
        out=tmp_path / "fusion",
        work=tmp_path / "work",
        data=data_folder,
        batch=4,
        loop=LoopConfig(steps=2),
    )
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        metrics = train(
            config, lambda step, steps, _: seen.append((step, steps, torch.get_num_threads()))
        )
        assert torch.get_num_threads() == 2  # other parts of a policy may be trained after it
    finally:
        torch.set_num_threads(threads)
    assert seen == [(1, 2, 1), (2, 2, 1)]
    assert {"val exact", "val soft", "test exact", "test soft"} <= set(metrics)
    assert isinstance(FusionNet.from_folder(config.out), FusionNet)
    assert str(tmp_path) not in (config.out / "config.json").read_text()


def test_a_corpus_without_training_groups_teaches_nothing() -> None:
    with pytest.raises(InputError, match="no training groups"):
        train(FusionConfig(corpus="examples"))


def test_two_processes_train_one_network_on_the_mean_of_their_batches(tmp_path: Path) -> None:
    corpus = write_tiny_treebank(tmp_path / "corpus")
    script = tmp_path / "train.py"
    script.write_text("import sys\nfrom fusionnet.apps.cli import main\nsys.exit(main())\n")
    out, work = tmp_path / "fusion", tmp_path / "work"
    words = ["train", "fusion", "--data", str(corpus), "--out", str(out), "--work", str(work)]
    words += ["--batch", "3", "--loop.steps", "4", "--loop.devices", "2", "--loop.log-every", "1"]
    words += ["--loop.save-every", "4"]
    ran = subprocess.run(
        [sys.executable, str(script), *words, "--loop.no-tensorboard"],
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert ran.returncode == 0, ran.stderr
    assert "test exact" in json.loads(ran.stdout)  # printed once, by the first process
    lines = [json.loads(line) for line in (work / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [1, 2, 3, 4]
    assert isinstance(FusionNet.from_folder(out), FusionNet)

    examples = PlannedExamples(load_corpus("treebank", corpus).split("train"))
    config, alone = FusionConfig(batch=3), compact()

    def pairs(first: int) -> Iterator[tuple[FusionBatch, FusionBatch]]:
        for step in count(first):
            one, other = (draw_batch(examples, None, config, 2 * step + i) for i in (0, 1))
            yield one, other

    def mean(network: Any, pair: tuple[FusionBatch, FusionBatch]) -> dict[str, torch.Tensor]:
        one, other = (network.losses(*batch) for batch in pair)
        return {name: (one[name] + other[name]) / 2 for name in one}

    loop = replace(config.loop, steps=4, log_every=1, tensorboard=False)
    history = fit(alone, pairs, mean, loop)
    for line, expected in zip(lines, history, strict=True):
        for name in ("loss", "grasp", "place", "holds", "joints"):
            assert line[name] == pytest.approx(expected[name], rel=1e-4), (line["step"], name)
    state = load_file(work / "state.safetensors")  # the checkpoint has half the precision
    untrained = dict(compact().named_parameters())
    for name, weights in alone.named_parameters():
        together = state[f"average.{name}"]
        torch.testing.assert_close(together, weights.detach(), rtol=1e-4, atol=1e-5, msg=name)
    assert sum(not torch.equal(w, untrained[n]) for n, w in alone.named_parameters()) > 5


def test_readings_of_another_reader_are_not_taken_for_this_ones(tmp_path: Path) -> None:
    corpus = write_tiny_treebank(tmp_path / "corpus")
    asked: list[str] = []

    def run(reader: Path, pictures: int) -> None:
        config = FusionConfig(
            out=tmp_path / "fusion",
            work=tmp_path / "work",
            data=corpus,
            batch=4,
            reader=reader,
            pictures=pictures,
            loop=LoopConfig(steps=1, tensorboard=False),
        )
        train(config, rendering=lambda done, _: asked.append(f"{reader.name} {done}"))

    shutil.copytree(DETECTOR, tmp_path / "other")
    weights = load_file(tmp_path / "other/model.safetensors")
    save_file(
        {n: t + 0 if t.is_floating_point() else t for n, t in weights.items()}
        | {"box_head.classify.4.bias": weights["box_head.classify.4.bias"] - 1},
        tmp_path / "other/model.safetensors",
    )
    run(DETECTOR, 2)
    run(DETECTOR, 2)
    assert asked == ["detector 1", "detector 2"]
    run(tmp_path / "other", 2)
    run(DETECTOR, 1)
    assert asked[2:] == ["other 1", "other 2", "detector 1"]
    shutil.copytree(DETECTOR, tmp_path / "softer")
    file = tmp_path / "softer/config.json"
    document = json.loads(file.read_text())
    document["config"]["temperature"] = 3.0
    file.write_text(json.dumps(document))
    run(tmp_path / "softer", 1)
    assert asked[5:] == ["softer 1"]
    with pytest.raises(CheckpointError, match="No checkpoint at"):
        run(tmp_path / "none", 1)
