import json

import pytest
import torch

from fusionnet.errors import CheckpointError, OutputError
from fusionnet.models.checkpoint import (
    check_checkpoint_folder,
    load_checkpoint,
    restore,
    save_checkpoint,
)


@pytest.fixture
def folder(tmp_path):
    tensors = {"weight": torch.randn(3, 2), "steps": torch.tensor([7])}
    save_checkpoint(tmp_path / "net", kind="toy", config={"a": 1}, tensors=tensors, half=True)
    return tmp_path / "net"


def test_a_checkpoint_comes_back(tmp_path):
    tensors = {"weight": torch.randn(3, 2), "steps": torch.tensor([7])}
    save_checkpoint(
        tmp_path / "net", kind="toy", config={"a": 1}, tensors=tensors, metadata={"m": 0.5}
    )
    read = load_checkpoint(tmp_path / "net", "toy")
    assert (read.config, read.metadata) == ({"a": 1}, {"m": 0.5})
    for name, value in tensors.items():
        torch.testing.assert_close(read.tensors[name], value)
    assert [p.name for p in tmp_path.iterdir()] == ["net"]


def _save(folder, value=1.0):
    save_checkpoint(folder, kind="toy", config={}, tensors={"x": torch.tensor([value])})


@pytest.mark.parametrize("name", ["README.md", "config.json", "thesis.tex"])
def test_other_files_are_never_replaced(folder, name, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / name).write_text("{}")
    (folder / "notes.txt").write_text("mine")
    for place in (tmp_path / "mine", folder):
        before = {file.name: file.read_bytes() for file in place.iterdir()}
        for refused in (check_checkpoint_folder, _save):
            with pytest.raises(OutputError, match="holds other files"):
                refused(place)
        assert {file.name: file.read_bytes() for file in place.iterdir()} == before


def test_an_earlier_checkpoint_is_replaced_whole_or_not_at_all(folder, tmp_path, monkeypatch):
    check_checkpoint_folder(folder)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    with monkeypatch.context() as patched:
        patched.setattr("fusionnet.models.checkpoint.model_card", lambda _: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            _save(folder)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    _save(folder, 2.0)
    assert load_checkpoint(folder, "toy").tensors["x"].tolist() == [2.0]
    assert [file.name for file in tmp_path.iterdir()] == ["net"]


def test_a_checkpoint_does_not_hold_the_files_of_its_training(folder, tmp_path):
    check_checkpoint_folder(folder, tmp_path)
    for work in (folder, folder / "work"):
        with pytest.raises(OutputError, match="would hold the files of"):
            check_checkpoint_folder(folder, work)


def test_half_precision_halves_only_floats(folder):
    tensors = load_checkpoint(folder, "toy").tensors
    assert tensors["weight"].dtype == torch.float32
    assert tensors["steps"].tolist() == [7]


def test_missing(tmp_path):
    with pytest.raises(CheckpointError, match="No checkpoint at"):
        load_checkpoint(tmp_path / "nothing", "toy")


def test_cut_short(folder):
    file = folder / "model.safetensors"
    file.write_bytes(file.read_bytes()[:-5])
    with pytest.raises(CheckpointError, match="damaged or cut short"):
        load_checkpoint(folder, "toy")


def test_a_pickle_is_not_read(folder):
    torch.save({"weight": torch.zeros(2)}, folder / "model.safetensors")
    with pytest.raises(CheckpointError, match="damaged or cut short"):
        load_checkpoint(folder, "toy")


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000])
def test_broken_configuration(folder, text):
    (folder / "config.json").write_text(text)
    with pytest.raises(CheckpointError, match="JSON"):
        load_checkpoint(folder, "toy")


def test_another_version_and_another_kind(folder):
    with pytest.raises(CheckpointError, match="holds a 'toy', expected a 'retinanet'"):
        load_checkpoint(folder, "retinanet")
    document = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(document | {"schema_version": 99}))
    with pytest.raises(CheckpointError, match="schema version 99; this release reads version 1"):
        load_checkpoint(folder, "toy")


def test_weights_of_another_shape(folder):
    read = load_checkpoint(folder, "toy")
    with pytest.raises(CheckpointError, match="do not fit"):
        restore(torch.nn.Linear(5, 5), read.tensors, folder)
