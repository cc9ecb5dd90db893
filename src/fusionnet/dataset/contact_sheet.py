"""A picture of some samples: boxes in the blocks' colours, and what is asked below."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from fusionnet.blocks import Color
from fusionnet.dataset.frame import decoded
from fusionnet.errors import DataError
from fusionnet.simulation import BLOCK_COLORS

TILE = (480, 270)
"""Width and height of each picture on the sheet, in pixels."""

CAPTION = 64
"""Height of what is written below each, in pixels."""

_BACKGROUND, _INK, _FAINT = (250, 250, 248), (25, 25, 25), (120, 120, 120)


def contact_sheet(
    samples: Sequence[Mapping[str, Any]], columns: int = 4
) -> UInt8[np.ndarray, "h w 3"]:
    """Samples side by side.

    Args:
        samples: Stored samples, at least one.
        columns: Pictures a row.

    Raises:
        DataError: If a picture is damaged.
    """
    columns = min(columns, len(samples))
    rows = -(-len(samples) // columns)
    size = (columns * TILE[0], rows * (TILE[1] + CAPTION))
    sheet = Image.new("RGB", size, _BACKGROUND)
    for number, sample in enumerate(samples):
        row, column = divmod(number, columns)
        corner = (column * TILE[0], row * (TILE[1] + CAPTION))
        sheet.paste(Image.fromarray(_with_boxes(sample)), corner)
        _caption(ImageDraw.Draw(sheet), sample, (corner[0] + 6, corner[1] + TILE[1] + 3))
    return np.asarray(sheet)


def _with_boxes(sample: Mapping[str, Any]) -> UInt8[np.ndarray, "h w 3"]:
    image = decoded(sample["image"]["bytes"], cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise DataError(f"The picture of sample {sample['id']} is damaged.")
    scale = np.array(TILE) / [image.shape[1], image.shape[0]]
    image = cv2.resize(image, TILE, interpolation=cv2.INTER_AREA)
    colors = list(Color)
    for box, kind in zip(sample["boxes"], sample["classes"], strict=True):
        left, top, right, bottom = np.rint(np.array(box) * np.tile(scale, 2)).astype(int).tolist()
        color = [round(255 * c) for c in BLOCK_COLORS[colors[kind % len(colors)]]]
        cv2.rectangle(image, (left - 1, top - 1), (right, bottom), (0, 0, 0), 1)
        cv2.rectangle(image, (left, top), (right - 1, bottom - 1), color, 1)
    return image


def _caption(draw: ImageDraw.ImageDraw, sample: Mapping[str, Any], at: tuple[int, int]) -> None:
    font = ImageFont.load_default(size=13)
    lines = textwrap.wrap(sample["sentence"], 72)
    shown = lines[:2] if len(lines) <= 2 else [lines[0], f"{lines[1][:68]} ..."]
    draw.text(at, "\n".join(shown), fill=_INK, font=font, spacing=2)
    camera = f"{sample['camera']['environment']}, {sample['camera']['name']}"
    small = ImageFont.load_default(size=11)
    note = f"{sample['id']}  {camera}  {sample['origin']}"
    draw.text((at[0], at[1] + 40), note, fill=_FAINT, font=small)
