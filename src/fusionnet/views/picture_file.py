"""A picture from a file, after everything that can be wrong with one has been ruled out.

The header is read first, so that a file of a few bytes which would unpack to gigabytes
(a decompression bomb) is refused before anything is unpacked.
"""

import struct
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import ExifTags, Image, UnidentifiedImageError

from fusionnet.errors import InputError

FORMATS = ("PNG", "JPEG", "WEBP", "BMP")
SMALLEST_SIDE = 64
"""Pixels: below this no block of the board has a shape."""

MOST_PIXELS = 40_000_000
MOST_BYTES = 200 * 2**20

_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""What makes a picture upright, by its EXIF orientation; 1 is upright already."""


def read_picture(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """The picture in a file, as RGB, turned the way its camera was held.

    Raises:
        InputError: If there is no such file, or it is no picture, or one that is
            damaged, too small or too large; the message says which.
    """
    return read_turned(path)[0]


def read_turned(path: Path) -> tuple[UInt8[np.ndarray, "h w 3"], int]:
    """The picture as `read_picture`, and the EXIF orientation from which it was turned, 1 to 8.

    Raises:
        InputError: As `read_picture`.
    """
    try:
        if not path.exists():
            raise InputError(f"There is no picture {path}.")
        if not path.is_file():
            raise InputError(f"{path} is not a file; expected a picture ({', '.join(FORMATS)}).")
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"The picture {path} has more than {MOST_BYTES // 2**20} MiB.")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # we refuse below
            picture = Image.open(path, formats=FORMATS)
        with picture:
            check_size(f"The picture {path}", *picture.size)
            orientation = _orientation(picture)
            upright = _eight_bits(_upright(picture, orientation)).convert("RGB")
    except InputError:
        raise
    except UnidentifiedImageError:
        raise InputError(f"{path} is not a picture; expected {', '.join(FORMATS)}.") from None
    except Image.DecompressionBombError:
        raise InputError(f"The picture {path} is too large: {_limits()}.") from None
    except PermissionError as error:
        raise InputError(f"The picture {path} cannot be read: {error.strerror}.") from None
    except (OSError, ValueError, TypeError, SyntaxError, EOFError, struct.error) as error:
        raise InputError(f"The picture {path} is damaged: {error}.") from None
    return np.asarray(upright), orientation


def _orientation(picture: Image.Image) -> int:
    """EXIF's only tag that matters here; one that says nothing sensible counts as upright."""
    found = picture.getexif().get(ExifTags.Base.Orientation)
    return found if isinstance(found, int) and found in _TURNS else 1


def _upright(picture: Image.Image, orientation: int) -> Image.Image:
    return picture.transpose(_TURNS[orientation]) if orientation in _TURNS else picture


def _eight_bits(picture: Image.Image) -> Image.Image:
    """A grey picture of sixteen bits with its upper eight; PIL would clip it to white."""
    if not picture.mode.startswith("I"):
        return picture
    return Image.fromarray(np.clip(np.asarray(picture) >> 8, 0, 255).astype(np.uint8))


def check_size(what: str, width: int, height: int) -> None:
    """Accept the size of a picture that can be read; `what` begins the message.

    Raises:
        InputError: If it is too small or too large, in pixels.
    """
    if min(width, height) < SMALLEST_SIDE:
        raise InputError(f"{what} is too small, {width} x {height}: {_limits()}.")
    if width * height > MOST_PIXELS:
        raise InputError(f"{what} is too large, {width} x {height}: {_limits()}.")


def _limits() -> str:
    return (
        f"each side needs at least {SMALLEST_SIDE} pixels, and all of it at most "
        f"{MOST_PIXELS // 10**6} million"
    )
