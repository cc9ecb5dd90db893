"""A FusionNet that points at cells, small enough to ablate its representations in minutes.

A small picture becomes features of the cells, a sentence becomes two questions, and each
question's answer is a distribution over the cells: where to grasp, where to place. The joints
follow by the robot's table, as in the compact FusionNet. Two intermediate representations can
be put in:

- *occupancy*: the cells' features must also tell which block is in which cell;
- *tree*: the questions are made of the tree that the Transformer writes, not of its reading of
  the words; in training of the true tree, at test of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from fusionnet.blocks import EMPTY, GRID
from fusionnet.experiments._pointing_task import CELLS, LEVELS, PointingSet
from fusionnet.models.heads.camera_pose import sample
from fusionnet.models.target_text import END, START
from fusionnet.models.transformer_config import TransformerConfig
from fusionnet.models.transformer_network import TransformerNetwork, number_rows
from fusionnet.randomness import generator
from fusionnet.sentences import PADDING, Vocabulary

WIDTH = 32
"""Features of a cell, and of a question."""


def _convolution(source: int, target: int, stride: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(source, target, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(target),
        nn.ReLU(inplace=True),
    )


@dataclass
class PointingBatch:
    """Commands and their pictures, as tensors."""

    images: UInt8[Tensor, "b h w 3"]
    said: Int[Tensor, "b t"]
    given: Int[Tensor, "b s"]
    wanted: Int[Tensor, "b s"]
    cells: Int[Tensor, "b 256"]
    source: Int[Tensor, " b"]
    target: Int[Tensor, " b"]


class PointingNet(nn.Module):
    """Pictures and sentences to distributions over cells.

    Args:
        learnt: What it learns from; its tokens are the vocabularies.
        occupancy, tree: Which representations are put in.
    """

    def __init__(self, learnt: PointingSet, *, occupancy: bool, tree: bool) -> None:
        super().__init__()
        self.occupancy, self.tree = occupancy, tree
        self.pixels: Tensor
        self.source = Vocabulary.of(learnt.sentences)
        self.target = Vocabulary.of([[START, END], *learnt.trees])
        self.convolutions = nn.Sequential(
            _convolution(3, 16, 2), _convolution(16, 32, 2), _convolution(32, 48, 1)
        )
        pixels = torch.from_numpy(learnt.pixels).float()
        self.register_buffer("pixels", pixels.flatten(0, 1), persistent=False)
        self.gather = nn.Linear(48 * pixels.shape[1], WIDTH)
        self.place = nn.Parameter(0.1 * torch.randn(len(CELLS), WIDTH))
        self.around = nn.Conv3d(WIDTH, WIDTH, 3, padding=1)
        self.classify = nn.Linear(WIDTH, EMPTY + 1)
        with torch.no_grad():
            self.classify.bias[EMPTY] = 5.0  # most cells are empty
        self.transformer = TransformerNetwork(
            TransformerConfig(
                source_words=len(self.source),
                target_words=len(self.target),
                layers=1,
                heads=2,
                feed_forward_size=128,
                longest=32,
            )
        )
        size = self.transformer.config.embedding_size
        self.ask = nn.Parameter(torch.randn(2, size) * size**-0.5)
        self.question = nn.Linear(size, 2 * 64)
        self.seen = nn.Linear(WIDTH, 64)
        self.answer = nn.Linear(64, 1)

    def numbers(self, learnt: PointingSet, rows: Any) -> PointingBatch:
        """Some rows of a set as tensors."""
        trees = [[self.target.number(t) for t in learnt.trees[i]] for i in rows]
        start, end = self.target.number(START), self.target.number(END)
        return PointingBatch(
            torch.from_numpy(learnt.pictures[rows]),
            number_rows([[self.source.number(t) for t in learnt.sentences[i]] for i in rows]),
            number_rows([[start, *tree] for tree in trees]),
            number_rows([[*tree, end] for tree in trees]),
            torch.from_numpy(learnt.cells[rows]),
            torch.from_numpy(learnt.source[rows]),
            torch.from_numpy(learnt.target[rows]),
        )

    def look(self, images: UInt8[Tensor, "b h w 3"]) -> Float[Tensor, "b 256 f"]:
        """Features of every cell, from the pixels where it appears and from its neighbours."""
        size = (images.shape[2], images.shape[1])
        pixels = images.permute(0, 3, 1, 2).float() / 127.5 - 1.0
        features = self.convolutions(pixels.contiguous(memory_format=torch.channels_last))
        found = sample(features, self.pixels.expand(len(images), -1, -1), size)
        points = found.unflatten(2, (len(CELLS), -1)).permute(0, 2, 1, 3).flatten(2)
        cells = torch.relu(self.gather(points) + self.place)
        grid = cells.transpose(1, 2).unflatten(2, (GRID, GRID, LEVELS))
        return cells + torch.relu(self.around(grid)).flatten(2).transpose(1, 2)

    def point(
        self,
        cells: Float[Tensor, "b 256 f"],
        heard: Float[Tensor, "b t e"],
        mask: Tensor,
    ) -> Float[Tensor, "b 2 256"]:
        """Logits of every cell, for the grasp and for the place."""
        scores = torch.einsum("qe,bte->bqt", self.ask, heard).masked_fill(~mask[:, None], -1e9)
        question = self.question(torch.softmax(scores, -1) @ heard)
        factor, shift = question.unflatten(-1, (2, 64)).unbind(2)
        seen = self.seen(cells)[:, None]
        hidden = torch.relu(seen * (1 + factor[:, :, None]) + shift[:, :, None])
        logits: Tensor = self.answer(hidden)[..., 0]
        return logits

    def losses(self, batch: PointingBatch) -> dict[str, Tensor]:
        """`grasp` and `place`: cross-entropy of the cells; and those of what is put in."""
        cells = self.look(batch.images)
        memory = self.transformer.encode(batch.said)
        losses: dict[str, Tensor] = {}
        heard, mask = memory.features, memory.mask
        if self.tree:
            heard, mask = self.transformer.decode(memory, batch.given), batch.given != PADDING
            tokens = self.transformer.output(heard).transpose(1, 2)
            losses["tree"] = cross_entropy(tokens, batch.wanted, ignore_index=PADDING)
        if self.occupancy:
            losses["occupancy"] = cross_entropy(
                self.classify(cells).flatten(0, 1), batch.cells.flatten(), reduction="sum"
            ) / len(cells)
        grasp, place = self.point(cells, heard, mask).unbind(1)
        losses["grasp"] = cross_entropy(grasp, batch.source)
        losses["place"] = cross_entropy(place, batch.target)
        return losses

    @torch.inference_mode()
    def forward(
        self, images: UInt8[Tensor, "b h w 3"], said: Int[Tensor, "b t"]
    ) -> tuple[Int[Tensor, "b 2"], Int[Tensor, "b s"]]:
        """The likeliest cells, and the tree that was written (of nothing but its mark if none)."""
        memory = self.transformer.encode(said)
        heard, mask = memory.features, memory.mask
        start = self.target.number(START)
        written = torch.full((len(said), 1), start)
        if self.tree:
            written = self.transformer.write(memory, start, self.target.number(END))
            heard, mask = self.transformer.decode(memory, written), written != PADDING
        return self.point(self.look(images), heard, mask).argmax(-1), written


def batches(
    model: PointingNet, learnt: PointingSet, size: int, seed: int, first: int
) -> Iterator[PointingBatch]:
    """Endless random batches from step `first` on."""
    step = first
    while True:
        rng = generator(seed, "pointing", step)
        yield model.numbers(learnt, rng.integers(len(learnt.commands), size=size))
        step += 1


def cells_of(model: PointingNet, tested: PointingSet) -> tuple[Int[Tensor, "n 2"], float]:
    """The cells that a model points at, and the share of trees that it writes without a fault."""
    found, right = [], 0
    for first in range(0, len(tested.commands), 64):
        rows = list(range(first, min(first + 64, len(tested.commands))))
        batch = model.numbers(tested, rows)
        cells, written = model(batch.images, batch.said)
        found.append(cells)
        if model.tree:
            wide = max(written.shape[1], batch.given.shape[1])
            mine, true = (
                nn.functional.pad(t, (0, wide - t.shape[1])) for t in (written, batch.given)
            )
            right += int((mine == true).all(1).sum())
    return torch.cat(found), right / len(tested.commands)
