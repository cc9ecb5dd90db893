"""Pictures of the robot's left eye with their sentences and moves, for the network of one graph."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fusionnet.blocks import Cell
from fusionnet.dataset.folder import read_plan
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.reader import StoredPictures, StoredSamples
from fusionnet.errors import InputError
from fusionnet.models.end_to_end import EndToEnd
from fusionnet.models.retinanet import Batch
from fusionnet.models.translator import Translator
from fusionnet.randomness import generator
from fusionnet.rcl import parse
from fusionnet.training.aligned_sentences import aligned_with
from fusionnet.training.detector_batches import collate as collate_pictures
from fusionnet.training.picture_variation import varied
from fusionnet.training.translator import TrainingBatch
from fusionnet.training.translator import collate as collate_sentences

COLUMNS = ("id", "sentence", "tree", "variants", "holding", "move")


@dataclass  # not frozen: Fabric moves its tensors between devices
class EndToEndBatch:
    """Pictures, sentences, and the moves that were asked for.

    Attributes:
        seen: Pictures of the eye, with what is true of each.
        sentences: One a picture.
        taught: Those whose trees the symbols can write; None if there are none.
        source: Index of the cell of each grasp.
        target: Index of the cell of each place.
        begins: 1 where the gripper holds the block already.
        ends: 1 where it keeps it.
    """

    seen: Batch
    sentences: list[str]
    taught: TrainingBatch | None
    source: Int[Tensor, " b"]
    target: Int[Tensor, " b"]
    begins: Float[Tensor, " b"]
    ends: Float[Tensor, " b"]

    def joints(self, model: EndToEnd) -> Float[Tensor, "b k"]:
        """The fourteen values that were asked for, scaled to 0 ... 1 (thesis 4.2)."""
        table = model.fusion.scaled_table
        begins, ends = self.begins[:, None], self.ends[:, None]
        return torch.cat([table[self.source], begins, table[self.target], ends], dim=1)


class EyeCommands:
    """Pictures of the left eye with their sentences and moves, of one split.

    Args:
        folder: A finished data set.
        split: One of its splits.

    Raises:
        DataError: If it is not finished, or damaged.
        InputError: If there are pictures that the left eye did not take.
    """

    def __init__(self, folder: Path, split: str) -> None:
        plan = read_plan(folder)
        if tuple(plan.eyes) != ("left_eye",) or (plan.views[0] and plan.eyes_share < 1.0):
            raise InputError(
                f"The data set {folder} has pictures that the left eye did not take; build one "
                "without --views and with --eyes left_eye."
            )
        self.pictures = StoredPictures(folder, split)
        self.commands = StoredSamples(folder, split, COLUMNS)

    def __len__(self) -> int:
        return len(self.pictures)

    def seen_by(self, frame: PictureFrame) -> None:
        """Give pictures from now on at the size that a detector with this frame reads."""
        self.pictures.input_size = frame.input_size

    def batch(
        self, indices: list[int], translator: Translator, rng: Any | None = None
    ) -> EndToEndBatch:
        """Samples as tensors.

        Args:
            indices: Numbers of the samples.
            translator: Has the vocabulary.
            rng: Draws one of each sample's four sentences, another brightness, and errors of
                the camera; without it the clean sentence and the picture as it is.
        """
        pictures, said, moves = [], [], []
        for index in indices:
            image, labels = self.pictures[index]
            sample = self.commands[index]
            variants = [sample, *sample["variants"]]
            said.append(variants[int(rng.integers(len(variants)))] if rng is not None else sample)
            pictures.append((image, labels) if rng is None else varied(image, labels, rng))
            moves.append(sample["move"])
        aligned = [
            aligned_with(s["sentence"], parse(s["tree"]), labels.holding)
            for s, (_, labels) in zip(said, pictures, strict=True)
        ]
        taught = [a for a in aligned if a is not None and a.words]
        return EndToEndBatch(
            seen=collate_pictures(pictures, rng),
            sentences=[s["sentence"] for s in said],
            taught=collate_sentences(taught, translator.vocabulary) if taught else None,
            source=torch.tensor([Cell(*move["source"]).index for move in moves]),
            target=torch.tensor([Cell(*move["target"]).index for move in moves]),
            begins=torch.tensor([float(move["begins_held"]) for move in moves]),
            ends=torch.tensor([float(move["ends_held"]) for move in moves]),
        )

    def batches(
        self, translator: Translator, size: int, seed: int, first: int
    ) -> Iterator[EndToEndBatch]:
        """Endless shuffled batches from step `first` on; the same for a resumed run."""
        size = min(size, len(self))
        an_epoch = len(self) // size
        step = first
        while True:
            epoch, row = divmod(step, an_epoch)
            order = self.pictures.order(seed, epoch)
            chosen = order[row * size : (row + 1) * size].tolist()
            yield self.batch(chosen, translator, generator(seed, "end to end", step))
            step += 1
