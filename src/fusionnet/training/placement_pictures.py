"""Pictures of a data set as the thesis's detector learns from them: cropped, moved, boxed.

A picture is cropped to the region where blocks can be placed (`models.placement`). Level-2
noise (3.2.5) moves the cropped picture and its boxes.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.framing import decode, whole_frame
from fusionnet.dataset.pictures import LEAST_PIXELS
from fusionnet.dataset.reader import StoredSamples
from fusionnet.errors import DataError
from fusionnet.models.heads.boxes import Boxes
from fusionnet.models.placement import Placement, placement_crop
from fusionnet.models.sight import BoxBatch
from fusionnet.views import LevelTwo

LABELS = (
    "id",
    "width",
    "height",
    "boxes",
    "classes",
    "box_blocks",
    "block_pixels",
    "camera",
)
"""What is read of a sample beside its picture."""

LEAST_SHARE = 0.3
"""A box of which noise leaves a smaller share in the picture is dropped."""


class PlacementPictures:
    """The pictures of one split with their boxes.

    Args:
        folder: A finished data set.
        split: One of its splits.
        frame: Size and aspect of the network's input.
        crop: Whether pictures are cropped to the placement region.
        columns: What is read of a sample.

    Raises:
        DataError: If the data set is not finished, damaged, has other classes, or no picture.
        UnknownNameError: If it has no such split.
    """

    def __init__(
        self,
        folder: Path,
        split: str,
        frame: PictureFrame,
        *,
        crop: bool = True,
        columns: Sequence[str] = ("image", *LABELS),
    ) -> None:
        self.samples = StoredSamples(folder, split, columns)
        self.frame = frame
        self.crop = crop
        if not len(self):
            raise DataError(f"The split {split!r} of {folder} has no picture.")

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> tuple[UInt8[np.ndarray, "h w 3"], Boxes]:
        """The network's input, and the boxes in it."""
        return self.read(index)[1:]

    def read(self, index: int) -> tuple[dict[str, Any], UInt8[np.ndarray, "h w 3"], Boxes]:
        """The stored columns, the network's input, and the boxes in it."""
        sample = self.samples[index]
        size = (int(sample["width"]), int(sample["height"]))
        image = decode(sample["image"]["bytes"], size, whole_frame(size, size))
        place = self._place(sample)
        return sample, place.picture(image), placed_boxes(sample, place)

    def boxes(self, index: int, least_share: float = 0.0) -> Boxes:
        """The boxes alone, of blocks that are visible enough; nothing is decoded."""
        sample = self.samples[index]
        if least_share:
            sample = _visible(sample, least_share)
        return placed_boxes(sample, self._place(sample))

    def _place(self, sample: dict) -> Placement:
        size = (int(sample["width"]), int(sample["height"]))
        if not self.crop:
            return Placement((0, 0, *size), self.frame)
        camera = sample["camera"]
        matrix = np.array(camera["matrix"]).reshape(3, 3)
        pose = np.array(camera["camera_from_board"]).reshape(4, 4)
        return Placement(placement_crop(matrix, pose, size), self.frame)


def box_sides(
    folder: Path,
    split: str,
    frame: PictureFrame,
    *,
    crop: bool,
    least_share: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> list[Float[np.ndarray, "n 2"]]:
    """Widths and heights of each picture's boxes, in pixels of the network's input.

    Args:
        folder: A finished data set.
        split: One of its splits.
        frame: Size and aspect of the network's input.
        crop: Whether pictures are cropped to the placement region.
        least_share: Blocks of which a smaller share is visible are left out.
        progress: Called with pictures done and pictures in all.

    Raises:
        DataError: If the data set is not finished, damaged, has other classes, or no picture.
        UnknownNameError: If it has no such split.
    """
    columns = (*LABELS, "block_shares")
    pictures = PlacementPictures(folder, split, frame, crop=crop, columns=columns)
    found = []
    for index in range(len(pictures)):
        xyxy = pictures.boxes(index, least_share).xyxy.double().numpy()
        found.append(xyxy[:, 2:] - xyxy[:, :2])
        if progress is not None:
            progress(index + 1, len(pictures))
    return found


def placed_boxes(sample: dict, place: Placement) -> Boxes:
    """A stored sample's boxes in pixels of the network's input."""
    boxes, classes = seen_boxes(sample, float(place.scale.prod()))
    placed = place.to_input(boxes)
    return within(placed, placed, classes, place.frame.input_size)


def _visible(sample: dict, least_share: float) -> dict:
    """The sample without the boxes of blocks of which too little is visible."""
    shares = [sample["block_shares"][block] for block in sample["box_blocks"]]
    kept = [place for place, share in enumerate(shares) if share >= least_share]
    names = ("boxes", "classes", "box_blocks")
    return sample | {name: [sample[name][place] for place in kept] for name in names}


def seen_boxes(
    sample: dict, enlargement: float
) -> tuple[Float[np.ndarray, "n 4"], Int[np.ndarray, " n"]]:
    """Boxes (in stored pixels) and classes of the blocks that show enough.

    Raises:
        DataError: If a class is none of `blocks.CLASS_NAMES`.
    """
    boxes = np.asarray(sample["boxes"], dtype=float).reshape(-1, 4)
    classes = np.asarray(sample["classes"], dtype=int)
    if len(classes) and not 0 <= classes.min() <= classes.max() < len(CLASS_NAMES):
        raise DataError(
            f"Sample {sample['id']} has a class {int(classes.max())}; there are "
            f"{len(CLASS_NAMES)}, numbered from 0."
        )
    owners = np.asarray(sample["box_blocks"], dtype=int)
    pixels = np.asarray(sample["block_pixels"], dtype=float)[owners]
    shown = pixels * enlargement >= LEAST_PIXELS
    return boxes[shown], classes[shown]


def within(
    boxes: Float[np.ndarray, "n 4"],
    whole: Float[np.ndarray, "n 4"],
    classes: Int[np.ndarray, " n"],
    size: tuple[int, int],
) -> Boxes:
    """The boxes clipped to a picture, without those that are mostly outside of it."""
    clipped = np.clip(boxes, 0, np.tile(size, 2))
    sides = clipped[:, 2:] - clipped[:, :2]
    area = np.prod(whole[:, 2:] - whole[:, :2], axis=1)
    kept = (sides > 1).all(axis=1) & (sides.prod(axis=1) >= LEAST_SHARE * area)
    return Boxes(
        torch.from_numpy(clipped[kept]).float(),
        torch.from_numpy(classes[kept]).long(),
        torch.ones(int(kept.sum())),
    )


def moved(
    picture: UInt8[np.ndarray, "h w 3"],
    boxes: Boxes,
    noise: LevelTwo,
    rng: np.random.Generator,
    size: tuple[int, int] | None = None,
) -> tuple[UInt8[np.ndarray, "h2 w2 3"], Boxes]:
    """Level-2 noise: the picture and its boxes under one random affine map about its middle.

    A moved box is the upright one around the corners of the old, somewhat too large; so it is
    in the thesis's source.

    Args:
        picture: To be moved.
        boxes: In it.
        noise: Ranges of the map.
        rng: Source of all randomness.
        size: Width and height to which the result is brought in the same map; the picture's own
            by default.
    """
    given = (picture.shape[1], picture.shape[0])
    width, height = size = size or given
    factors = np.array(size) / given
    fit = np.diag([*factors, 1.0])
    fit[:2, 2] = 0.5 * factors - 0.5  # pixels are named by their centres
    new_from_old = fit @ noise.sample(rng, given)
    image = cv2.warpAffine(picture, new_from_old[:2], size, borderMode=cv2.BORDER_REPLICATE)
    xyxy = boxes.xyxy.double().numpy()
    corners = xyxy[:, [[0, 1], [2, 1], [2, 3], [0, 3]]] - 0.5
    mapped = corners @ new_from_old[:2, :2].T + new_from_old[:2, 2] + 0.5
    around = np.concatenate([mapped.min(axis=1), mapped.max(axis=1)], axis=1)
    return image, within(around, around, boxes.classes.numpy(), (width, height))


def collate(samples: list[tuple[UInt8[np.ndarray, "h w 3"], Boxes]]) -> BoxBatch:
    """Pictures and boxes as one batch."""
    images, boxes = zip(*samples, strict=True)
    return BoxBatch(torch.from_numpy(np.stack(images)), list(boxes))
