"""Every backbone keeps the contract; the thesis's begin with ImageNet weights if they can."""

import logging

import pytest
import torch
import torchvision
from safetensors.torch import save_file

from fusionnet.errors import CheckpointError, InputError
from fusionnet.models import backbones

HEIGHT, WIDTH = 96, 160


@pytest.mark.parametrize("name", backbones.names())
def test_a_backbone_gives_the_maps_that_it_declares(name):
    with torch.device("meta"):
        backbone = backbones.load(name)()
        maps = backbone(torch.empty(2, 3, HEIGHT, WIDTH))
    assert [tuple(m.shape) for m in maps] == [
        (2, channels, HEIGHT // stride, WIDTH // stride)
        for channels, stride in zip(backbone.channels, backbone.strides, strict=True)
    ]
    assert list(backbone.strides) == sorted(backbone.strides)
    assert len(backbone.mean) == len(backbone.deviation) == 3


@pytest.mark.parametrize(
    ("name", "blocks"), [("resnet50", 16), ("resnet101", 33), ("resnet152", 50)]
)
def test_the_residual_networks_are_those_of_table_2_4(name, blocks):
    with torch.device("meta"):
        backbone = backbones.load(name)()
        whole = getattr(torchvision.models, name)(weights=None)
    kinds = [type(m).__name__ for m in backbone.modules()]
    assert kinds.count("Bottleneck") == blocks
    wanted = {n: p.shape for n, p in whole.state_dict().items() if not n.startswith("fc.")}
    assert {n: p.shape for n, p in backbone.state_dict().items()} == wanted


@pytest.fixture
def tiny(monkeypatch):
    """A small network with the ways of a residual one."""
    net = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 3), torch.nn.BatchNorm2d(4))
    net.imagenet = "resnet50"
    return net


def test_weights_come_from_a_file(tmp_path, tiny):
    wanted = {n: torch.rand_like(p.float()).to(p.dtype) for n, p in tiny.state_dict().items()}
    save_file({**wanted, "fc.weight": torch.zeros(3)}, tmp_path / "w.safetensors")
    said = backbones.fill_backbone(tiny, str(tmp_path / "w.safetensors"))
    assert said.startswith("file: w.safetensors, sha256 ")
    for name, value in tiny.state_dict().items():
        torch.testing.assert_close(value, wanted[name])


def test_weights_that_cannot_be_used_are_named(tmp_path, tiny):
    with pytest.raises(CheckpointError, match="no weights .*missing"):
        backbones.fill_backbone(tiny, str(tmp_path / "missing"))
    (tmp_path / "bad").write_bytes(b"no tensors")
    with pytest.raises(CheckpointError, match="damaged"):
        backbones.fill_backbone(tiny, str(tmp_path / "bad"))
    save_file({"other": torch.zeros(3)}, tmp_path / "other")
    with pytest.raises(CheckpointError, match="of another network"):
        backbones.fill_backbone(tiny, str(tmp_path / "other"))
    with pytest.raises(InputError, match="no ImageNet weights for this backbone"):
        backbones.fill_backbone(backbones.load("small")(), "imagenet")


def test_without_a_network_the_weights_are_clearly_random(tiny, monkeypatch, caplog):
    def refuse(*_, **__):
        raise OSError("name resolution failed")

    monkeypatch.setattr(torch.hub, "load_state_dict_from_url", refuse)
    monkeypatch.setattr("torchvision.models._api.load_state_dict_from_url", refuse)
    with caplog.at_level(logging.WARNING):
        said = backbones.fill_backbone(tiny, "imagenet")
    assert said.startswith("random: ") and "name resolution failed" in said
    assert "RANDOM weights" in caplog.text


def test_frozen_normalisation_stays_as_it_was(tiny):
    backbones.freeze_normalisation(tiny)
    before = {n: v.clone() for n, v in tiny[1].state_dict().items()}
    tiny(torch.rand(1, 3, 8, 8) + 5).sum().backward()
    assert tiny[1].weight.grad is None
    for name, value in tiny[1].state_dict().items():
        torch.testing.assert_close(value, before[name])
