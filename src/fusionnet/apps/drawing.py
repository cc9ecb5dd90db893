"""Pictures of what the networks saw: boxes and labels in the blocks' own colours."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from fusionnet.blocks.grid import Color

PAINT: dict[str, tuple[int, int, int]] = {
    Color.BLUE: (45, 95, 230),
    Color.CYAN: (40, 200, 220),
    Color.RED: (226, 48, 48),
    Color.YELLOW: (245, 205, 40),
    Color.GREEN: (40, 165, 75),
    Color.MAGENTA: (214, 60, 190),
    Color.GRAY: (130, 134, 142),
    Color.WHITE: (246, 246, 243),
}
"""How a block's colour is drawn on a screen (sRGB)."""

_WIDEST = 1920
"""Pixels to which a picture is enlarged, so that small blocks have readable labels."""


class Box(NamedTuple):
    """One box to draw: a class name such as "cube_red", a score, corners in pixels."""

    class_name: str
    score: float
    corners: tuple[float, float, float, float]

    @property
    def color(self) -> str:
        """The block's colour."""
        return self.class_name.rpartition("_")[2]

    @property
    def label(self) -> str:
        """What a person calls the block; the corpus says prism where we draw a pyramid."""
        shape = "pyramid" if self.class_name.startswith("prism") else "cube"
        return f"{self.color} {shape}"


def ink_on(paint: tuple[int, int, int]) -> tuple[int, int, int]:
    """Black or white, whichever is readable on a colour (by relative luminance)."""
    linear = [(c / 255) ** 2.2 for c in paint]
    luminance = float(np.dot(linear, (0.2126, 0.7152, 0.0722)))
    return (20, 22, 26) if luminance > 0.2 else (255, 255, 255)


def hexadecimal(paint: tuple[int, int, int]) -> str:
    """The colour as a page writes it: #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*paint)


def draw_boxes(
    image: UInt8[np.ndarray, "h w 3"], boxes: Sequence[Box]
) -> UInt8[np.ndarray, "tall wide 3"]:
    """The picture, enlarged, with every box; each label stands where it covers no other one.

    A label for which there is no free place beside its box is left out, so that
    crowded tables stay readable; its box is drawn all the same.

    Args:
        image: RGB.
        boxes: Corners in pixels of `image`.
    """
    height, width = image.shape[:2]
    scale = max(1.0, _WIDEST / width) if width < _WIDEST else 1.0
    size = (round(width * scale), round(height * scale))
    picture = Image.fromarray(image).resize(size, Image.Resampling.BICUBIC)
    draw = ImageDraw.Draw(picture)
    line = max(2, round(size[0] / 640))
    scaled = [[c * scale for c in box.corners] for box in boxes]
    for box, corners in zip(boxes, scaled, strict=True):
        paint = PAINT[box.color]
        draw.rectangle(corners, outline=ink_on(paint), width=line + 2)
        draw.rectangle(_grown(corners, -1), outline=paint, width=line)
    font = ImageFont.load_default(size=max(13, size[0] // 100))
    taken: list[list[float]] = []
    # The largest first: they have the most room around them.
    for index in sorted(range(len(boxes)), key=lambda i: -_area(scaled[i])):
        box = boxes[index]
        place = _free_place(scaled[index], draw.textbbox((0, 0), box.label, font=font), taken, size)
        if place is None:
            continue
        taken.append(place)
        paint = PAINT[box.color]
        draw.rounded_rectangle(place, radius=4, fill=paint, outline=ink_on(paint))
        middle = ((place[0] + place[2]) / 2, (place[1] + place[3]) / 2)
        draw.text(middle, box.label, fill=ink_on(paint), font=font, anchor="mm")
    return np.asarray(picture)


def _free_place(
    corners: list[float],
    text: tuple[float, float, float, float],
    taken: list[list[float]],
    size: tuple[int, int],
) -> list[float] | None:
    """A rectangle beside a box that is inside the picture and free of other labels."""
    wide, tall = text[2] - text[0] + 12, text[3] - text[1] + 10
    left, top, right, bottom = corners
    middle_x, middle_y = (left + right) / 2, (top + bottom) / 2
    for x, y in (
        (middle_x - wide / 2, top - tall - 2),
        (middle_x - wide / 2, bottom + 2),
        (right + 3, middle_y - tall / 2),
        (left - wide - 3, middle_y - tall / 2),
        (right - wide / 4, top - tall - 2),
        (left - wide * 3 / 4, top - tall - 2),
        (middle_x - wide / 2, top - 2 * tall - 4),
        (middle_x - wide / 2, bottom + tall + 4),
    ):
        place = [x, y, x + wide, y + tall]
        inside = x >= 0 and y >= 0 and place[2] <= size[0] and place[3] <= size[1]
        if inside and not any(_overlap(place, other) for other in taken):
            return place
    return None


def _overlap(a: Sequence[float], b: Sequence[float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _area(corners: Sequence[float]) -> float:
    return (corners[2] - corners[0]) * (corners[3] - corners[1])


def _grown(corners: Sequence[float], by: float) -> list[float]:
    left, top, right, bottom = corners
    return [left - by, top - by, max(left - by, right + by), max(top - by, bottom + by)]
