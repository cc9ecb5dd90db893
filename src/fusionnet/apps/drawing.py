"""Pictures of what the networks saw: boxes and labels in the blocks' own colours."""

import base64
import io
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8
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

LIT = (255, 145, 40)
"""The outline of what is lit in a picture."""

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


def around(boxes: Sequence[Box], size: tuple[int, int]) -> tuple[int, int, int, int]:
    """The part of a picture in which all boxes lie, with a margin, as wide for its height as it.

    Args:
        boxes: Corners in pixels of the picture.
        size: The picture's width and height.

    Returns:
        Left, top, right and bottom edge in pixels; the whole picture if there is no box.
    """
    width, height = size
    if not boxes:
        return (0, 0, width, height)
    corners = np.array([box.corners for box in boxes])
    low, high = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    share = float(np.max((high - low + 0.1 * width) / size))  # of the picture that is needed
    wide, tall = (min(side, round(side * share)) for side in size)
    middle = (low + high) / 2
    left = int(np.clip(middle[0] - wide / 2, 0, width - wide))
    top = int(np.clip(middle[1] - tall / 2, 0, height - tall))
    return (left, top, left + wide, top + tall)


def draw_boxes(
    image: UInt8[np.ndarray, "h w 3"], boxes: Sequence[Box], *, whole: bool = False
) -> UInt8[np.ndarray, "tall wide 3"]:
    """The part of the picture `around` the boxes, enlarged, with every box and its label.

    A label stands where it covers no other label and as little as possible of other
    boxes; one for which there is no free place is left out, so that crowded tables
    stay readable.

    Args:
        image: RGB.
        boxes: Corners in pixels of `image`.
        whole: Draw the whole picture instead of a part.
    """
    height, width = image.shape[:2]
    part = (0, 0, width, height) if whole else around(boxes, (width, height))
    scale = max(1.0, _WIDEST / (part[2] - part[0]))
    size = (round((part[2] - part[0]) * scale), round((part[3] - part[1]) * scale))
    picture = Image.fromarray(image).resize(size, Image.Resampling.BICUBIC, box=part)
    draw = ImageDraw.Draw(picture)
    line = max(2, round(size[0] / 640))
    shift = np.array([part[0], part[1], part[0], part[1]])
    scaled = [[float(c) for c in (np.array(box.corners) - shift) * scale] for box in boxes]
    for box, corners in zip(boxes, scaled, strict=True):
        paint = PAINT[box.color]
        draw.rectangle(corners, outline=ink_on(paint), width=line + 2)
        draw.rectangle(_grown(corners, -1.0), outline=paint, width=line)
    font = ImageFont.load_default(size=max(13, size[0] // 60))
    taken: list[list[float]] = []
    # The largest first: they have the most room around them.
    for index in sorted(range(len(boxes)), key=lambda i: -_area(scaled[i])):
        box = boxes[index]
        others = [corners for i, corners in enumerate(scaled) if i != index]
        left, top, right, bottom = draw.textbbox((0, 0), box.label, font=font)
        label = (float(right - left) + 12, float(bottom - top) + 10)
        place = _free_place(scaled[index], label, taken, others, size)
        if place is None:
            continue
        taken.append(place)
        paint = PAINT[box.color]
        draw.rounded_rectangle(place, radius=4, fill=paint, outline=ink_on(paint))
        middle = ((place[0] + place[2]) / 2, (place[1] + place[3]) / 2)
        draw.text(middle, box.label, fill=ink_on(paint), font=font, anchor="mm")
    return np.asarray(picture)


def spotlight(
    image: UInt8[np.ndarray, "h w 3"],
    strength: Float[np.ndarray, "h2 w2"],
    part: tuple[int, int, int, int],
    width: int = 640,
) -> UInt8[np.ndarray, "tall wide 3"]:
    """A part of a picture, dark and grey but where something is lit, and that outlined.

    Args:
        image: RGB.
        strength: How strongly each of its pixels is lit, 0 to 1; may have another resolution.
        part: Left, top, right and bottom edge of what is shown, in pixels of `image`.
        width: Of the result, in pixels.
    """
    left, top, right, bottom = part
    size = (width, round(width * (bottom - top) / (right - left)))
    height, wide = image.shape[:2]
    light = cv2.resize(strength, (wide, height))[top:bottom, left:right]
    light = cv2.resize(light, size)[..., None]
    shown = cv2.resize(image[top:bottom, left:right], size, interpolation=cv2.INTER_CUBIC)
    grey = shown.mean(axis=2, keepdims=True)
    dark = 0.5 * (0.7 * grey + 0.3 * shown)
    lit = np.ascontiguousarray(np.rint(dark + light * (shown - dark)).astype(np.uint8))
    edges, _ = cv2.findContours(
        (light[..., 0] > 0.25).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    cv2.drawContours(lit, edges, -1, LIT, 3, cv2.LINE_AA)
    return lit


def webp(image: UInt8[np.ndarray, "h w 3"]) -> str:
    """A picture as a page carries it inside: the address of its data."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "webp", quality=85)
    return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def _free_place(
    corners: list[float],
    label: tuple[float, float],
    taken: list[list[float]],
    others: list[list[float]],
    size: tuple[int, int],
) -> list[float] | None:
    """A rectangle beside a box, inside the picture, free of labels, covering little else."""
    wide, tall = label
    left, top, right, bottom = corners
    middle_x, middle_y = (left + right) / 2, (top + bottom) / 2
    best: tuple[float, list[float]] | None = None
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
        if not inside or any(_shared(place, other) > 0 for other in taken):
            continue
        covered = sum(_shared(place, other) for other in others)
        if best is None or covered < best[0]:
            best = (covered, place)
    return None if best is None else best[1]


def _shared(a: Sequence[float], b: Sequence[float]) -> float:
    """Area that two rectangles share."""
    wide = min(a[2], b[2]) - max(a[0], b[0])
    tall = min(a[3], b[3]) - max(a[1], b[1])
    return max(wide, 0.0) * max(tall, 0.0)


def _area(corners: Sequence[float]) -> float:
    return (corners[2] - corners[0]) * (corners[3] - corners[1])


def _grown(corners: Sequence[float], by: float) -> list[float]:
    left, top, right, bottom = corners
    return [left - by, top - by, max(left - by, right + by), max(top - by, bottom + by)]
