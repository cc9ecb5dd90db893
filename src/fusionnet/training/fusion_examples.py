"""Stored samples as the thesis's FusionNet learns from them.

Each time a sample is seen, one of four pictures and one of four sentences are drawn by chance,
each one clean and three noised (thesis 7, figure 4.5). A data set keeps four sentences and one
picture, of which the level-one noise was drawn when it was built; the clean picture is that one as
it is, a noised one is moved by level-two noise, which is new every time (3.2.5).
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.reader import StoredSamples
from fusionnet.errors import DataError
from fusionnet.models import heads
from fusionnet.models.heads import Example
from fusionnet.models.target_text import END, START, Writes, source_tokens, target_tokens
from fusionnet.models.thesis_fusionnet import ThesisFusionNet
from fusionnet.randomness import generator
from fusionnet.sentences import UNKNOWN, Vocabulary
from fusionnet.training.placement_pictures import LABELS, PlacementPictures, moved
from fusionnet.views import LevelTwo

LANGUAGE = ("sentence", "tree", "variants")
COLUMNS = (*LANGUAGE, "joints", "before", "after", "robot")

NOISED_PICTURES = 3
"""Noised versions of each picture, beside the clean one (thesis 4.1.2, 7)."""


class FusionExamples:
    """The samples of one split, as examples.

    Args:
        folder: A finished data set.
        split: One of its splits.
        frame: Size and aspect of the network's input.
        crop: Whether pictures are cropped to the placement region.
        keep: Whether pictures stay in memory once they are read.

    Raises:
        DataError: If the data set is not finished, or damaged.
        UnknownNameError: If it has no such split.
    """

    def __init__(
        self,
        folder: Path,
        split: str,
        frame: PictureFrame,
        *,
        crop: bool = True,
        keep: bool = False,
    ) -> None:
        more = {column for name in heads.names() for column in heads.load(name).columns}
        self.pictures = PlacementPictures(
            folder, split, frame, crop=crop, columns=sorted({"image", *LABELS, *COLUMNS, *more})
        )
        self.keep = keep
        self._kept: dict[int, tuple[dict[str, Any], Any, Any]] = {}
        self._tokens: dict[tuple[str, str, Writes], tuple[list[str], list[str]]] = {}

    def __len__(self) -> int:
        return len(self.pictures)

    def example(
        self,
        index: int,
        model: ThesisFusionNet,
        rng: np.random.Generator | None = None,
        *,
        sentences: bool = True,
        pictures: bool = True,
    ) -> Example:
        """One example for a model.

        Args:
            index: Number of the sample.
            model: Has the vocabularies and the scaling.
            rng: Draws among clean and noised; without it both are clean.
            sentences: Whether the sentence is drawn, or the clean one.
            pictures: Whether the picture is drawn, with its boxes, or the clean one.
        """
        sample, picture, boxes = self._read(index)
        sentence = sample["sentence"]
        if rng is not None and sentences:
            drawn = int(rng.integers(1 + len(sample["variants"])))
            sentence = sample["variants"][drawn - 1]["sentence"] if drawn else sentence
        if rng is not None and pictures and rng.integers(1 + NOISED_PICTURES):
            picture, boxes = moved(picture, boxes, LevelTwo(), rng)
        source, target = self._words(sentence, sample["tree"], model.config.writes)
        longest = model.config.transformer.longest
        number = model.target.number
        return Example(
            picture=picture,
            boxes=boxes,
            source=tuple(model.source.number(t) for t in source[:longest]) or (UNKNOWN,),
            target=(number(START), *(number(t) for t in target[: longest - 1]), number(END)),
            joints=model.scale(np.array(sample["joints"])),
            sample=sample,
        )

    def _read(self, index: int) -> tuple[dict[str, Any], Any, Any]:
        if index in self._kept:
            return self._kept[index]
        sample, picture, boxes = self.pictures.read(index)
        sample.pop("image")
        if self.keep:
            self._kept[index] = (sample, picture, boxes)
        return sample, picture, boxes

    def _words(self, sentence: str, tree: str, writes: Writes) -> tuple[list[str], list[str]]:
        """Tokens to read, and those to write: of the sentence as it was said, where it is that."""
        key = (sentence, tree, writes)
        if key not in self._tokens:
            self._tokens[key] = source_tokens(sentence), target_tokens(writes, sentence, tree)
        return self._tokens[key]

    def batches(
        self,
        model: ThesisFusionNet,
        size: int,
        first: int,
        seed: int,
        *,
        sentences: bool = True,
        pictures: bool = True,
    ) -> Iterator[list[Example]]:
        """Endless shuffled batches from step `first` on; the same for a resumed run.

        Args:
            model: Has the vocabularies and the scaling.
            size: Examples of a batch.
            first: Step to begin with.
            seed: Of the order and of what is drawn.
            sentences: As in `example`.
            pictures: As in `example`.
        """
        size = min(size, len(self))
        an_epoch = len(self) // size
        step = first
        while True:
            epoch, row = divmod(step, an_epoch)
            order = self.pictures.samples.order(seed, epoch)
            for start in range(row * size, an_epoch * size, size):
                rng = generator(seed, "fusion examples", step)
                chosen = order[start : start + size]
                yield [
                    self.example(int(i), model, rng, sentences=sentences, pictures=pictures)
                    for i in chosen
                ]
                step += 1


def joint_limits(folder: Path, splits: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """Least and greatest of the fourteen values over whole splits (thesis, equation 4.2).

    Raises:
        DataError: If the splits have no samples.
    """
    low, high = None, None
    for split in splits:
        for sample in StoredSamples(folder, split, ("joints",)):
            joints = np.array(sample["joints"])
            low = joints if low is None else np.minimum(low, joints)
            high = joints if high is None else np.maximum(high, joints)
    if low is None or high is None:
        raise DataError(f"The data set {folder} has no samples in {', '.join(splits)}.")
    return tuple(zip(low.tolist(), high.tolist(), strict=True))


def vocabularies(folder: Path, writes: Writes) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Tokens that are read and tokens that are written in the training split."""
    read: list[list[str]] = []
    written: list[list[str]] = [[START, END]]
    for sample in StoredSamples(folder, "train", LANGUAGE):
        versions = [sample["sentence"], *(v["sentence"] for v in sample["variants"])]
        read += [source_tokens(sentence) for sentence in versions]
        said = versions if writes == "english" else versions[:1]
        written += [target_tokens(writes, sentence, sample["tree"]) for sentence in said]
    return Vocabulary.of(read).words, Vocabulary.of(written).words
