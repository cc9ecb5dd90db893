"""Stored pictures as the batches that a detector learns from, the same ones after a resumption."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Int

from fusionnet.dataset.pictures import Labels
from fusionnet.dataset.reader import StoredPictures
from fusionnet.models.heads.camera_pose import PARAMETERS
from fusionnet.models.labelled_boxes import Boxes
from fusionnet.models.retinanet import Batch
from fusionnet.randomness import derived_seed, generator
from fusionnet.training.empty_pictures import empty_picture
from fusionnet.training.picture_variation import varied, varied_view
from fusionnet.views import Backdrops

POSE_ERROR = 0.06
"""Standard deviation of the disturbance of the true camera, in `camera_pose.UNITS`."""


class JoinedPictures:
    """The pictures of several data sets as if they were of one.

    Args:
        parts: The data sets' pictures.
    """

    def __init__(self, parts: Sequence[StoredPictures]) -> None:
        self._parts = parts
        self._starts = np.cumsum([0, *(len(part) for part in parts)])

    def __len__(self) -> int:
        return int(self._starts[-1])

    def __getitem__(self, index: int) -> tuple[np.ndarray, Labels]:
        part = int(np.searchsorted(self._starts, index, side="right")) - 1
        return self._parts[part][index - int(self._starts[part])]

    def order(self, seed: int, epoch: int) -> Int[np.ndarray, " n"]:
        """The order of one epoch: each data set in its own, dealt in the same proportion."""
        orders = [
            part.order(derived_seed(seed, "part", i), epoch) + first
            for i, (part, first) in enumerate(zip(self._parts, self._starts, strict=False))
        ]
        places = np.concatenate([(np.arange(len(o)) + 0.5) / max(len(o), 1) for o in orders])
        return np.concatenate(orders)[np.argsort(places, kind="stable")]


AnyPictures = StoredPictures | JoinedPictures


def collate(
    samples: Sequence[tuple[np.ndarray, Labels]], rng: np.random.Generator | None = None
) -> Batch:
    """Pictures and labels as tensors, those that the eye did not take last.

    Camera disturbances are drawn if there is a generator.
    """
    ordered = sorted(samples, key=lambda sample: not sample[1].by_eye)
    images, labels = zip(*ordered, strict=True)
    read = [t for t in labels if t.by_eye]
    noise = np.zeros((len(read), PARAMETERS))
    if rng is not None:
        noise = rng.normal(0.0, POSE_ERROR, noise.shape)
    return Batch(
        images=torch.from_numpy(np.stack(images)),
        boxes=[
            Boxes(
                torch.from_numpy(t.boxes).float(),
                torch.from_numpy(t.classes),
                torch.ones(len(t.boxes)),
            )
            for t in labels
        ],
        cells=_stacked([t.cells for t in read], (512,)).long(),
        visible=_stacked([t.visible for t in read], (512,)).long(),
        offsets=_stacked([t.offsets for t in read], (512, 3)).float(),
        holding=torch.tensor([float(t.holding) for t in read]),
        matrix=_stacked([t.matrix for t in read], (3, 3)).float(),
        camera_from_board=_stacked([t.camera_from_board for t in read], (4, 4)).float(),
        disturbance=torch.from_numpy(noise).float(),
    )


def _stacked(arrays: Sequence[np.ndarray], shape: tuple[int, ...]) -> torch.Tensor:
    """Arrays of one shape, of which there may be none."""
    return torch.from_numpy(np.array(arrays).reshape(-1, *shape))


def batches(
    pictures: AnyPictures,
    size: int,
    seed: int,
    first: int,
    empty: int = 0,
    boxes_size: tuple[int, int] | None = None,
    backdrops: Backdrops | None = None,
) -> Iterator[Batch]:
    """Endless shuffled batches from step `first` on; the same for a resumed run.

    Args:
        pictures: To learn from.
        size: How many of them a step.
        seed: Of order and variation.
        first: Step to begin with.
        empty: Pictures without blocks that each batch gets besides.
        boxes_size: Width and height of the network's input if boxes alone are learnt.
        backdrops: Photographs without blocks.
    """
    size = min(size, len(pictures))
    a_epoch = len(pictures) // size
    step = first
    while True:
        epoch, row = divmod(step, a_epoch)
        order = pictures.order(seed, epoch)
        for start in range(row * size, a_epoch * size, size):
            rng = generator(seed, "augment", step)
            chosen = [pictures[int(i)] for i in order[start : start + size]]
            shape = boxes_size or (chosen[0][0].shape[1], chosen[0][0].shape[0])
            if boxes_size is not None:
                different = [varied_view(*sample, boxes_size, rng) for sample in chosen]
            else:
                different = [varied(image, labels, rng) for image, labels in chosen]
            different += [varied(*empty_picture(rng, shape, backdrops), rng) for _ in range(empty)]
            yield collate(different, rng)
            step += 1
