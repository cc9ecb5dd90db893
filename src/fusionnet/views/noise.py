"""Level-one noise (domain randomisation of blocks, light and background) and the sensor's noise.

What varies in one picture is a `Look`; from which ranges it is drawn is a `LevelOne`.
Level two, which moves the finished picture, is in `transformation.py`.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.errors import InputError
from fusionnet.geometry import rotation_from_vector
from fusionnet.simulation import Appearance
from fusionnet.simulation.appearance import MAX_BLOCKS

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """How one overlay departs from the plain one; the defaults change nothing.

    Attributes:
        scales: Factors on each block's size along its own axes.
        turns: Rotation of each block about x, y and z of the board through its centre, in radians.
        shifts: Displacement of each block along x, y and z of the board, in metres.
        intensities: Colour intensity of each block: 1 as it is, 0 grey.
        contrast, lightness: Of the photograph: 1 as it is, 0 even grey, or black.
        light_contrast: Share of the light that comes straight from lamps: 1 as it is, 0 none.
        light: Strength of all the light on the blocks.
        lamp_turn: By which all the light is turned about the vertical, in radians.
    """

    scales: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.ones((MAX_BLOCKS, 3)))
    turns: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.zeros((MAX_BLOCKS, 3)))
    shifts: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.zeros((MAX_BLOCKS, 3)))
    intensities: Float[np.ndarray, " n"] = field(default_factory=lambda: np.ones(MAX_BLOCKS))
    contrast: float = 1.0
    lightness: float = 1.0
    light_contrast: float = 1.0
    light: float = 1.0
    lamp_turn: float = 0.0

    def on_photograph(self, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """The background in this look."""
        if self.contrast == 1.0 and self.lightness == 1.0:
            return image
        grey = float(np.mean(cv2.mean(image)[:3]))
        levels = (grey + self.contrast * (np.arange(256) - grey)) * self.lightness
        return cv2.LUT(image, np.clip(np.rint(levels), 0, 255).astype(np.uint8))

    def on_light(self, light: Appearance) -> Appearance:
        """The light on the blocks in this look, `light_contrast` moving it to or from ambient."""
        direct = self.light * self.light_contrast
        turn = rotation_from_vector(np.array([0.0, 0.0, self.lamp_turn]))
        moved = self.light * (1.0 - self.light_contrast) * 0.8 * (light.light + light.fill)
        return replace(
            light,
            light_direction=turn @ light.light_direction,
            fill_direction=turn @ light.fill_direction,
            light=direct * light.light,
            fill=direct * light.fill,
            ambient=np.clip(self.light * light.ambient + moved, 0.0, None),
        )

    def tint(self, color: tuple[float, float, float], index: int) -> Float[np.ndarray, "3"]:
        """Factors on red, green and blue of block `index`, whose own colour is given (0 to 1)."""
        plain = np.array(color)
        grey = plain @ [0.299, 0.587, 0.114]
        changed = np.clip(grey + self.intensities[index] * (plain - grey), 0.0, 1.0)
        return changed / plain


@dataclass(frozen=True, kw_only=True)
class LevelOne:
    """Ranges of level-one noise; `level_one()` has the thesis's.

    Attributes:
        scale: Largest relative change of a block's size in each direction.
        turn: Largest rotation of a block about x, y and z, in degrees.
        shift: Largest displacement of a block in each direction, in metres.
        intensity, contrast, lightness, light_contrast, light: Ranges of `Look`'s values.
        lamp_turn: Largest turn of the light about the vertical, in degrees; not in the thesis.

    References:
        Thesis 3.2.5, level 1.
    """

    scale: float
    turn: tuple[float, float, float]
    shift: float
    intensity: Range
    contrast: Range
    lightness: Range
    light_contrast: Range
    light: Range
    lamp_turn: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.scale < 1.0:
            raise InputError(
                f"A block's size may change by 0 to below 1 of itself, not {self.scale}."
            )
        for name in ("intensity", "contrast", "lightness", "light_contrast", "light"):
            low, high = getattr(self, name)
            if not 0.0 <= low <= high:
                raise InputError(
                    f"The range of {name} must rise from 0 or more, not {low} to {high}."
                )

    def sample(self, rng: np.random.Generator, blocks: int = MAX_BLOCKS) -> Look:
        """One look for a picture of up to `blocks` blocks; every value even over its range."""
        return Look(
            scales=1.0 + rng.uniform(-self.scale, self.scale, (blocks, 3)),
            turns=rng.uniform(-1.0, 1.0, (blocks, 3)) * np.deg2rad(self.turn),
            shifts=rng.uniform(-self.shift, self.shift, (blocks, 3)),
            intensities=rng.uniform(*self.intensity, blocks),
            contrast=rng.uniform(*self.contrast),
            lightness=rng.uniform(*self.lightness),
            light_contrast=rng.uniform(*self.light_contrast),
            light=rng.uniform(*self.light),
            lamp_turn=np.deg2rad(rng.uniform(-self.lamp_turn, self.lamp_turn)),
        )


def level_one(strength: float = 1.0) -> LevelOne:
    """The thesis's level-one noise, its geometry weakened or not.

    Args:
        strength: Factor on the changes of size, rotation and displacement. At 1, as in the
            thesis, a block of 2.63 cm moves by up to 1 cm along each axis, so that neighbours cut
            into each other and some seem to stand in the next cell: fit for learning boxes, not
            cells.
            At 0.15 (1.5 mm, 1.5 degrees) cells stay readable.

    References:
        Thesis 3.2.5, level 1.
    """
    if not 0.0 <= strength <= 1.0:
        raise InputError(f"The strength of noise is 0 to 1, not {strength}.")
    around = (0.8, 1.2)
    return LevelOne(
        scale=0.10 * strength,
        turn=(6.0 * strength, 6.0 * strength, 10.0 * strength),
        shift=0.01 * strength,
        intensity=around,
        contrast=around,
        lightness=around,
        light_contrast=around,
        light=around,
    )


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Ranges of what a camera does to a picture; none of it is in the thesis.

    Attributes:
        blur: Standard deviation of a Gaussian blur, in pixels at a height of 540.
        noise: Standard deviation of the sensor's noise, of 255 grey levels.
        white_balance: Factors on red and on blue.
        gamma: Exponent on brightness.
        quality: Of a JPEG that the picture goes through, 1 to 100; None for no JPEG.
    """

    blur: Range = (0.0, 1.1)
    noise: Range = (0.0, 6.0)
    white_balance: Range = (0.94, 1.06)
    gamma: Range = (0.85, 1.2)
    quality: tuple[int, int] | None = (60, 95)

    def apply(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        """The picture as one camera might have taken it, drawn from the ranges."""
        red, blue = rng.uniform(*self.white_balance, 2)
        taken = Appearance(
            white_balance=np.array([red, 1.0, blue]),
            gamma=rng.uniform(*self.gamma),
            blur=rng.uniform(*self.blur),
            noise=rng.uniform(*self.noise),
            noise_seed=int(rng.integers(2**31)),
        ).develop(image)
        if self.quality is None:
            return taken
        quality = int(rng.integers(self.quality[0], self.quality[1] + 1))
        encoded = cv2.imencode(".jpg", taken, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        compressed: np.ndarray = cv2.imdecode(encoded, cv2.IMREAD_COLOR)  # type: ignore[assignment]
        return compressed
