"""The contracts of fusers and heads: every entry of both catalogues, whatever it is."""

import ast
import dataclasses
import inspect
from pathlib import Path

import numpy as np
import pytest
import torch

from fusionnet.errors import InputError, UnknownNameError
from fusionnet.models import fusers, heads
from fusionnet.models.anchors import AnchorShapes
from fusionnet.models.detectors import pyramid_boxes
from fusionnet.models.heads import Example, Features, Shapes
from fusionnet.models.heads.boxes import Boxes, BoxHead
from fusionnet.models.thesis_fusion_config import NetworkSizes, thesis

SEEN, SAID = (40, 4), (7, 4)
STRIDES = (8, 16)
ANCHORS = AnchorShapes(sizes=(8.0, 16.0), ratios=(1.0,), scales=(1.0,))


@pytest.fixture
def nodes():
    chance = torch.Generator().manual_seed(0)
    return (
        torch.randn(3, *SEEN, generator=chance),
        torch.randn(3, *SAID, generator=chance),
    )


@pytest.mark.parametrize("name", fusers.names())
def test_every_fuser_makes_one_vector_that_depends_on_both(name, nodes):
    fuser = fusers.load(name)(SEEN, SAID)
    seen, said = (n.requires_grad_() for n in nodes)
    fused = fuser(seen, said)
    assert fused.shape == (3, fuser.width) and fused.isfinite().all()
    fused.square().sum().backward()
    assert seen.grad.abs().sum() > 0 and said.grad.abs().sum() > 0


@pytest.mark.parametrize("name", fusers.names())
def test_only_the_thesis_fuser_adds_what_is_seen_to_what_is_said(name, nodes):
    """Read by a linear layer, concatenation has no term that depends on both modalities."""
    fuser = fusers.load(name)(SEEN, SAID)
    seen, said = nodes
    with torch.no_grad():
        read = torch.randn(fuser.width, generator=torch.Generator().manual_seed(1))
        both = fuser(seen, said) @ read
        crossed = fuser(seen.roll(1, 0), said) @ read
        other = fuser(seen, said.roll(1, 0)) @ read
        neither = fuser(seen.roll(1, 0), said.roll(1, 0)) @ read
    interaction = (both - crossed - other + neither).abs().max()
    assert (interaction < 1e-4) == (name == "concatenate")


def test_attention_looks_at_every_place_with_a_share(nodes):
    weights = fusers.load("attention")(SEEN, SAID).attended(*nodes)
    assert torch.allclose(weights.sum(-1), torch.ones(weights.shape[:2]))


def example(chance: np.random.Generator) -> Example:
    return Example(
        picture=chance.integers(0, 255, (32, 48, 3), dtype=np.uint8),
        boxes=Boxes(torch.tensor([[4.0, 4.0, 13.0, 12.0]]), torch.tensor([3]), torch.ones(1)),
        source=(2, 3),
        target=(2, 5, 4, 3),
        joints=chance.random(14),
        sample={"block_cells": [9, 70], "block_classes": [3, 5]},
    )


def features(batch: int) -> Features:
    head = BoxHead(channels=8, config=pyramid_boxes(ANCHORS, strides=STRIDES, depth=1, width=8))
    levels = [torch.randn(batch, 8, 32 // s, 48 // s) for s in STRIDES]
    anchors = head(levels, (32, 48))
    return Features(
        levels=levels,
        anchors=anchors,
        anchor_losses=lambda truth: head.losses(anchors, list(truth)),
        tokens=torch.randn(batch, 5, 9, requires_grad=True),
        fused=torch.randn(batch, 20),
    )


@pytest.mark.parametrize("name", heads.names())
def test_every_head_owns_target_prediction_loss_and_metric(name):
    torch.manual_seed(0)
    chance = np.random.default_rng(0)
    examples = [example(chance) for _ in range(2)]
    shapes = Shapes(channels=8, strides=STRIDES, fused=20, joints=14)
    head = heads.load(name)(shapes)
    targets = [head.target(e) for e in examples]
    seen = features(2)
    output = head(seen)
    loss = head.loss(output, targets, seen)
    assert loss.ndim == 0 and loss > 0
    loss.backward()
    found = head.predict(output)
    assert len(found) == 2
    measured = head.metric(found, targets)
    assert measured and all(np.isfinite(value) for value in measured.values())


def class_without_docstrings(source: str, name: str) -> str:
    parsed = ast.parse(source)
    found = next(n for n in parsed.body if isinstance(n, ast.ClassDef) and n.name == name)
    for node in (found, *(n for n in found.body if isinstance(n, ast.FunctionDef))):
        if ast.get_docstring(node) is not None:
            del node.body[0]
    return ast.unparse(found)


def test_the_documented_head_is_the_one_that_runs():
    page = (Path(__file__).parents[1] / "docs" / "add-a-head.md").read_text("utf-8")
    listing = page.split("```python\n")[1].split("```")[0]
    kind = heads.load("occupancy")
    source = inspect.getsource(inspect.getmodule(kind))
    assert class_without_docstrings(listing, kind.__name__) == class_without_docstrings(
        source, kind.__name__
    )
    shown: dict = {}
    exec(compile(listing, "add-a-head.md", "exec"), shown)  # its imports are all it needs
    assert set(shown["HEAD"].target(example(np.random.default_rng(0))).tolist()) == {3, 5, 16}


@pytest.mark.parametrize("name", heads.names())
def test_a_perfect_prediction_has_a_perfect_metric(name):
    chance = np.random.default_rng(0)
    kind = heads.load(name)
    targets = [kind.target(example(chance)) for _ in range(2)]
    wrong = {"joint_mse": 0.0}
    for metric, value in kind.metric(targets, targets).items():
        assert value == pytest.approx(wrong.get(metric, 1.0)), metric


def test_an_unknown_head_or_fuser_lists_what_there_is():
    with pytest.raises(UnknownNameError, match="available: .*occupancy.*Did you mean 'tree'"):
        heads.load("trees")
    with pytest.raises(UnknownNameError, match="attention, concatenate, kronecker"):
        fusers.load("sum")


def test_the_occupancy_of_a_layout_is_its_blocks_by_cell():
    given = dataclasses.replace(
        example(np.random.default_rng(0)), sample={"block_cells": [0, 511], "block_classes": [7, 2]}
    )
    cells = heads.load("occupancy").target(given)
    assert cells[0] == 7 and cells[511] == 2 and (cells == 16).sum() == 510


def test_the_plain_vision_takes_every_head_that_reads_no_pyramid(monkeypatch):
    class Newcomer(heads.Head):
        """Reads the fused vector alone."""

    load = heads.load
    monkeypatch.setattr(heads, "load", lambda n: Newcomer if n == "newcomer" else load(n))
    sizes = NetworkSizes(backbone="tiny")
    limits = [(0.0, 1.0)] * 14
    chosen = ("tree", "newcomer", "joints")
    config = thesis("nico", limits, ["a"], ["b"], sizes=sizes, vision="cnn", heads=chosen)
    assert config.heads == chosen
    for name in ("boxes", "classes", "occupancy"):
        with pytest.raises(InputError, match=f"The plain vision has no {name}"):
            dataclasses.replace(config, heads=(name, "joints"))
