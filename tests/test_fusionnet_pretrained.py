"""The compact FusionNet in the hub's conventions: saved, read again, and refused with reasons."""

import json
import pickle
import shutil
from pathlib import Path

import huggingface_hub
import numpy as np
import pytest
import torch

from fusionnet.corpora import load_corpus
from fusionnet.errors import CheckpointError
from fusionnet.models.fusionnet import FusionNet
from fusionnet.models.policy_folder import weights_folder
from fusionnet.training.simulated_readings import cells_of, exact_readings

COMMAND = load_corpus("examples").commands[0]
FUSION = weights_folder("compact") / "fusion"


def answer(model: FusionNet):
    cells, held = exact_readings(*cells_of([COMMAND.scene.before]))
    return model(cells[0], float(held[0]), [(COMMAND.tree, 1.0)])


@pytest.fixture
def saved(tmp_path) -> Path:
    """The shipped network, read and saved again, in a folder that may be spoilt."""
    FusionNet.from_pretrained(FUSION).save_pretrained(tmp_path / "mine", {"note": "again"})
    return tmp_path / "mine"


@pytest.fixture
def hub(saved, monkeypatch):
    """A hub that has one repository, `someone/arm`; remembers what it was asked for."""
    asked = []

    def snapshot_download(name, *, revision, allow_patterns):
        asked.extend(allow_patterns)
        if name != "someone/arm":
            raise OSError("404 Client Error\nrepository not found")
        return str(saved)

    monkeypatch.setattr(huggingface_hub, "snapshot_download", snapshot_download)
    return asked


def changed(folder: Path, **changes) -> None:
    """Overwrites what the configuration of a checkpoint says."""
    file = folder / "config.json"
    document = json.loads(file.read_text())
    config = document["config"] | changes.pop("config", {})
    file.write_text(json.dumps(document | changes | {"config": config}))


@pytest.mark.parametrize("name", [str, Path])
def test_a_round_trip_gives_the_same_answer(saved, name):
    one, two = answer(FusionNet.from_pretrained(FUSION)), answer(FusionNet.from_pretrained(saved))
    one_again = answer(FusionNet.from_pretrained(name(saved), robot="nico"))
    for other in (two, one_again):
        np.testing.assert_array_equal(one.targets, other.targets)
        np.testing.assert_array_equal(one.source, other.source)
        assert one.confidence == other.confidence
    assert sorted(file.name for file in saved.iterdir()) == [
        "README.md",
        "config.json",
        "model.safetensors",
    ]


def test_a_hub_name_fetches_three_files_and_no_more(hub):
    model = FusionNet.from_pretrained("someone/arm")
    expected = answer(FusionNet.from_pretrained(FUSION))
    np.testing.assert_array_equal(answer(model).targets, expected.targets)
    assert sorted(hub) == ["README.md", "config.json", "model.safetensors"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("someone/leg", r"someone/leg is no folder here and could not be fetched.*404"),
        ("nowhere", r"No checkpoint at nowhere: expected a folder with config.json"),
        (Path("someone/arm"), r"No checkpoint at someone/arm"),
    ],
)
def test_what_is_not_there_is_refused_in_one_line(hub, name, said):
    with pytest.raises(CheckpointError, match=said) as caught:
        FusionNet.from_pretrained(name)
    assert "\n" not in str(caught.value)


def test_another_robot_is_refused_with_the_reason(saved):
    with pytest.raises(CheckpointError, match=r"trained for the robot 'nico'.*to 'gantry'"):
        FusionNet.from_pretrained(saved, robot="gantry")
    changed(saved, config={"robot": "pepper"})
    with pytest.raises(CheckpointError, match=r"'pepper', which is not here.*available: .*nico"):
        FusionNet.from_pretrained(saved)
    changed(saved, config={"robot": "nico", "joint_names": [f"j{i}" for i in range(6)]})
    with pytest.raises(CheckpointError, match=r"knows the joints j0.*of another release"):
        FusionNet.from_pretrained(saved)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"schema_version": 2}, r"has schema version 2; this release reads version 1"),
        ({"schema_version": None}, r"has schema version None"),
        ({"kind": "translator"}, r"holds a 'translator', expected a 'fusionnet'"),
        ({"config": {"joint_limits": [[0.0, 1.0]]}}, "6 joints need as many pairs of limits"),
        ({"config": {"hidden": 3}}, "configuration in .* is not valid"),
    ],
)
def test_another_schema_kind_or_configuration_is_refused(saved, changes, said):
    changed(saved, **changes)
    with pytest.raises(CheckpointError, match=said):
        FusionNet.from_pretrained(saved)


def test_weights_of_another_kind_are_refused(saved):
    shutil.rmtree(saved)
    shutil.copytree(weights_folder("compact") / "translator", saved)
    with pytest.raises(CheckpointError, match="holds a 'translator', expected a 'fusionnet'"):
        FusionNet.from_pretrained(saved)


@pytest.mark.parametrize("left", [0, 7, 100, -1])
def test_damaged_weights_are_refused(saved, left):
    file = saved / "model.safetensors"
    file.write_bytes(file.read_bytes()[:left])
    with pytest.raises(CheckpointError, match="damaged or cut short"):
        FusionNet.from_pretrained(saved)


def test_a_damaged_configuration_is_refused(saved):
    for text in ("{", "[]", '{"kind": "fusionnet", "schema_version": 1}', "\x00"):
        (saved / "config.json").write_text(text)
        with pytest.raises(CheckpointError):
            FusionNet.from_pretrained(saved)


class Harmful:
    """Unpickling it would leave a trace."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self):
        return Path.touch, (self.trace,)


def test_pickles_are_never_opened(saved, tmp_path, monkeypatch):
    def opened(*_, **__):
        raise AssertionError("a pickle was opened")

    for name in ("load", "loads", "Unpickler"):
        monkeypatch.setattr(pickle, name, opened)
    monkeypatch.setattr(torch, "load", opened)
    trace = tmp_path / "trace"
    harmful = pickle.dumps(Harmful(trace))
    for name in ("pytorch_model.bin", "model.pt", "model.pkl"):
        (saved / name).write_bytes(harmful)
    answer(FusionNet.from_pretrained(saved))
    (saved / "model.safetensors").write_bytes(harmful)
    with pytest.raises(CheckpointError, match="damaged or cut short"):
        FusionNet.from_pretrained(saved)
    (saved / "model.safetensors").unlink()
    with pytest.raises(CheckpointError, match=r"has no model\.safetensors"):
        FusionNet.from_pretrained(saved)
    assert not trace.exists()
