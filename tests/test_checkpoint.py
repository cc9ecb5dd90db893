import json

import pytest
import torch

from fusionnet.errors import CheckpointError
from fusionnet.models.checkpoint import load_checkpoint, restore, save_checkpoint


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
