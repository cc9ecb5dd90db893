"""Photographs without blocks: what may be behind a table, lie upon it, or be all there is.

Drawn clutter is flat, and a detector that has seen nothing else takes a sleeve or the corner of a
wall for a pale block. Any photographs help, those of the place where the detector shall look most.
"""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from fusionnet.errors import InputError
from fusionnet.views.photographs import picture_files
from fusionnet.views.picture_file import read_picture

LONGEST_SIDE = 1400
"""Pixels that are kept of a photograph: five hundred of them are 2 GB."""

CLOSEST = 0.25
"""Share of a photograph's shorter side that a crop shows at least."""


class Backdrops:
    """Crops of photographs, of any place and size, mirrored or not.

    Args:
        photographs: At least one; each is shrunk before the next is asked for.

    Raises:
        InputError: If there is none.
    """

    def __init__(self, photographs: Iterable[UInt8[np.ndarray, "_ _ 3"]]) -> None:
        self._photographs = [_shrunk(photograph) for photograph in photographs]
        if not self._photographs:
            raise InputError("Backdrops need at least one photograph.")

    def __len__(self) -> int:
        return len(self._photographs)

    @classmethod
    def of_folder(cls, folder: Path) -> "Backdrops":
        """All pictures in a folder.

        Raises:
            InputError: If there is no such folder, no picture or more than `MOST_PHOTOGRAPHS` in
                it, or one cannot be read.
        """
        enough = "all are kept in memory, and a few dozen of the right place are worth most"
        return cls(read_picture(file) for file in picture_files(folder, enough))

    def crop(self, rng: np.random.Generator, size: tuple[int, int]) -> UInt8[np.ndarray, "h w 3"]:
        """A part of a photograph.

        Args:
            rng: Source of all randomness.
            size: Width and height that are wanted, in pixels.
        """
        photograph = self._photographs[rng.integers(len(self._photographs))]
        there = np.array(photograph.shape[1::-1])
        share = np.exp(rng.uniform(np.log(CLOSEST), 0.0)) * (there / size).min()
        part = np.maximum((share * np.array(size)).astype(int), 1)
        left, top = rng.integers(0, there - part + 1)
        found = photograph[top : top + part[1], left : left + part[0]]
        if rng.random() < 0.5:
            found = found[:, ::-1]
        shrinks = part[0] > size[0]
        way = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        return cv2.resize(np.ascontiguousarray(found), size, interpolation=way)


def _shrunk(photograph: UInt8[np.ndarray, "_ _ 3"]) -> UInt8[np.ndarray, "_ _ 3"]:
    """With no more pixels than are kept."""
    share = LONGEST_SIDE / max(photograph.shape[:2])
    if share >= 1.0:
        return photograph
    size = np.maximum(np.rint(share * np.array(photograph.shape[1::-1])), 1).astype(int)
    return cv2.resize(photograph, size.tolist(), interpolation=cv2.INTER_AREA)
