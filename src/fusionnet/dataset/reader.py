"""Read a stored data set: any sample by number, from memory-mapped shards.

Nothing is kept in memory but the row groups read last, so that a data set may be of any size.
"""

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Int, UInt8

from fusionnet.dataset.folder import read_checksums, read_plan
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.framing import decode, frame_of, labels_of
from fusionnet.dataset.pictures import EYE_FRAME, Labels
from fusionnet.dataset.plan import SPLITS
from fusionnet.dataset.shards import ROW_GROUP, damaged, open_shard
from fusionnet.errors import DataError, UnknownNameError
from fusionnet.randomness import generator

_KEPT_GROUPS = 8
_KEPT_FILES = 256

LABEL_COLUMNS = (
    "id",
    "image",
    "width",
    "height",
    "boxes",
    "classes",
    "box_blocks",
    "box_hidden",
    "block_cells",
    "block_classes",
    "block_pixels",
    "block_offsets",
    "holding",
    "camera",
    "robot",
)
"""What `StoredPictures` reads of a sample."""


class StoredSamples:
    """The samples of one split, by number; may be handed to other processes.

    Args:
        folder: A finished data set.
        split: One of its splits.
        columns: Which columns are read; all by default.

    Raises:
        DataError: If it is not finished, damaged, or of another schema.
        UnknownNameError: If it has no such split.
    """

    def __init__(self, folder: Path, split: str, columns: Sequence[str] | None = None) -> None:
        self.folder = folder
        self.split = split
        self.plan = read_plan(folder)
        self._columns = None if columns is None else list(columns)
        counts = dict(self.plan.counts)
        if split not in counts:
            raise UnknownNameError(
                f"The data set {folder} has no split {split!r}; it has {', '.join(counts)}."
                + (" Those with views need --views." if split in SPLITS else "")
            )
        records = read_checksums(folder)
        names = [self.plan.file(*shard) for shard in self.plan.shards if shard[0] == split]
        for name in names:
            if name not in records:
                raise DataError(f"{folder / name} is missing from the checksums; build again.")
        self._files = [folder / name for name in names]
        self._ends = list(accumulate(records[name].rows for name in names))
        self._clear()

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __getitem__(self, index: int) -> dict[str, Any]:
        """All columns of a sample as plain values; the picture as JPEG.

        Raises:
            IndexError: If there is no such sample.
            DataError: If its shard is damaged.
        """
        table, row = self._find(index)
        return {name: table[name][row].as_py() for name in table.column_names}

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[index] for index in range(len(self)))

    def order(self, seed: int, epoch: int) -> Int[np.ndarray, " n"]:
        """The order of one epoch: row groups by chance and the samples in each by chance.

        Neighbours in a shard are unrelated, so a group is as good a draw as single samples;
        it is read from disk once.
        """
        rng = generator(seed, "order", epoch)
        starts = np.array(
            [
                first
                for end, before in zip(self._ends, [0, *self._ends[:-1]], strict=True)
                for first in range(before, end, ROW_GROUP)
            ]
        )
        ends = np.append(starts[1:], len(self))
        return np.concatenate(
            [rng.permutation(np.arange(starts[g], ends[g])) for g in rng.permutation(len(starts))]
        )

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k not in ("_opened", "_groups")}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__dict__.update(state)
        self._clear()

    def _clear(self) -> None:
        self._opened: OrderedDict[int, pq.ParquetFile] = OrderedDict()
        self._groups: OrderedDict[tuple[int, int], pa.Table] = OrderedDict()

    def _find(self, index: int) -> tuple[pa.Table, int]:
        """The row group that holds a sample, and its row there."""
        if index < 0:
            index += len(self)
        if not 0 <= index < len(self):
            raise IndexError(f"sample {index} of {len(self)}")
        shard = bisect_right(self._ends, index)
        row = index - (self._ends[shard - 1] if shard else 0)
        group, row = divmod(row, ROW_GROUP)
        if (shard, group) not in self._groups:
            self._groups[shard, group] = self._read(shard, group)
            if len(self._groups) > _KEPT_GROUPS:
                self._groups.popitem(last=False)
        return self._groups[shard, group], row

    def _read(self, shard: int, group: int) -> pa.Table:
        file = self._files[shard]
        if shard not in self._opened:
            self._opened[shard] = open_shard(file)
            if len(self._opened) > _KEPT_FILES:
                self._opened.popitem(last=False)[1].close()
        try:
            table = self._opened[shard].read_row_group(
                group, columns=self._columns, use_threads=False
            )
        except (OSError, pa.ArrowException) as error:
            raise damaged(file, error) from error
        return table.combine_chunks()


class StoredPictures:
    """The pictures of one split as a network sees them, with what is true of each.

    Args:
        folder: A finished data set.
        split: One of its splits.
        input_size: Width and height of the network's input, in pixels.
        frame: Which part of every picture; by default the eye's crop, or where the grid
            appears in a view.

    Raises:
        DataError: If the data set is not finished, damaged, or of another schema.
        UnknownNameError: If it has no such split.
    """

    def __init__(
        self,
        folder: Path,
        split: str,
        *,
        input_size: tuple[int, int] = EYE_FRAME.input_size,
        frame: PictureFrame | None = None,
    ) -> None:
        self.samples = StoredSamples(folder, split, LABEL_COLUMNS)
        self.input_size = input_size
        self.frame = frame

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
        table, row = self.samples._find(index)
        sample = {name: _value(table[name].chunk(0), row) for name in LABEL_COLUMNS}
        frame = self.frame or frame_of(sample, self.input_size)
        try:
            image = decode(sample["image"], (sample["width"], sample["height"]), frame)
        except DataError as error:
            name = f"Sample {sample['id']} in {self.samples.folder}"
            raise DataError(f"{name}: {error} Run `fusionnet dataset check` on it.") from error
        return image, labels_of(sample, frame)

    def order(self, seed: int, epoch: int) -> Int[np.ndarray, " n"]:
        """The order of one epoch."""
        return self.samples.order(seed, epoch)


def _value(column: pa.Array, row: int) -> Any:
    """A value of a column: numbers as arrays, a picture as a view of its bytes."""
    value = column[row]
    if isinstance(value, pa.StructScalar):
        if "bytes" in value:
            return memoryview(value["bytes"].as_buffer() or b"")
        return value.as_py()
    if isinstance(value, pa.ListScalar):
        inner = value.values
        if pa.types.is_fixed_size_list(inner.type):
            inner = inner.flatten()
        return inner.to_numpy(zero_copy_only=False)
    return value.as_py()
