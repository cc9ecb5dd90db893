"""Masks as COCO's uncompressed run lengths, without COCO's library.

The lengths alternate between pixels outside and inside, column by column from the top
left, and begin with those outside (which may be 0).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int

from fusionnet.errors import DataError


def encode_masks(
    block_at: Int[np.ndarray, "h w"], blocks: Sequence[int] | Int[np.ndarray, " n"]
) -> list[list[int]]:
    """The run lengths of each of some blocks.

    Args:
        block_at: For each pixel the block that is seen there, -1 for none.
        blocks: Which blocks' masks are wanted.
    """
    height, width = block_at.shape
    columns = np.flatnonzero((block_at >= 0).any(axis=0))
    first, last = (columns[0], columns[-1] + 1) if len(columns) else (0, 0)
    flat = np.ascontiguousarray(block_at[:, first:last].T).ravel()
    starts = np.concatenate([[0], np.flatnonzero(np.diff(flat)) + 1]).astype(np.int64)
    ends = np.append(starts[1:], len(flat))
    seen = flat[starts] if len(flat) else np.empty(0, flat.dtype)
    starts, ends = starts + first * height, ends + first * height
    encoded = []
    for block in blocks:
        mine = np.flatnonzero(seen == block)
        borders = np.column_stack([starts[mine], ends[mine]]).ravel()
        lengths = np.diff(np.concatenate([[0], borders, [height * width]]))
        encoded.append((lengths if lengths[-1] else lengths[:-1]).tolist())
    return encoded


def mask_extent(
    lengths: Sequence[int] | Int[np.ndarray, " n"], size: tuple[int, int]
) -> tuple[list[int], int]:
    """The box around a mask (left, top, right, bottom edge) and its pixels, without decoding it.

    Raises:
        DataError: If the lengths do not cover the picture.
    """
    height = size[1]
    ends = np.cumsum(_checked(lengths, size))
    first, last = ends[:-1:2], ends[1::2] - 1  # of each run inside, first and last pixel
    first, last = first[last >= first], last[last >= first]
    if not len(first):
        return [0, 0, 0, 0], 0
    around = first // height != last // height  # from the foot of a column to the next one's head
    top = 0 if around.any() else int((first % height).min())
    bottom = height if around.any() else int((last % height).max()) + 1
    box = [int(first[0] // height), top, int(last[-1] // height) + 1, bottom]
    return box, int((last - first + 1).sum())


def decode_mask(
    lengths: Sequence[int] | Int[np.ndarray, " n"], size: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """The mask of some run lengths.

    Args:
        lengths: As `encode_masks` gives them.
        size: Width and height of the picture, in pixels.

    Raises:
        DataError: If they do not cover the picture.
    """
    runs = _checked(lengths, size)
    inside = np.arange(len(runs)) % 2 == 1
    return np.repeat(inside, runs).reshape(size).T


def _checked(
    lengths: Sequence[int] | Int[np.ndarray, " n"], size: tuple[int, int]
) -> Int[np.ndarray, " n"]:
    runs = np.asarray(lengths, dtype=np.int64)
    if (runs < 0).any() or runs.sum() != size[0] * size[1]:
        raise DataError(
            f"The run lengths of a mask cover {runs.sum()} pixels; its picture has "
            f"{size[0]} x {size[1]}."
        )
    return runs
