"""Everything that may vary in a picture of one and the same layout."""

from dataclasses import dataclass, field, replace
from functools import cache

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks.grid import Color

MAX_BLOCKS = 512
"""Blocks that fill the whole grid; arrays of an appearance hold a row for each."""

BLOCK_COLORS: dict[Color, tuple[float, float, float]] = {
    Color.BLUE: (0.06, 0.13, 0.80),
    Color.CYAN: (0.10, 0.82, 0.88),
    Color.RED: (0.82, 0.07, 0.07),
    Color.YELLOW: (0.95, 0.82, 0.05),
    Color.GREEN: (0.07, 0.55, 0.12),
    Color.MAGENTA: (0.85, 0.10, 0.66),
    Color.GRAY: (0.40, 0.40, 0.41),
    Color.WHITE: (0.97, 0.97, 0.97),
}
"""Red, green and blue of a block's surface, 0 to 1, far apart in every light that is sampled."""

Rgb = Float[np.ndarray, "3"]


def _rgb(*values: float) -> Rgb:
    return np.array(values)


@dataclass(frozen=True, kw_only=True, eq=False)
class Appearance:
    """Camera, light, colours and sensor of one picture; the defaults are the nominal look.

    Offsets of blocks apply to pictures of ideal layouts, not to a simulated world,
    whose blocks are where physics put them.

    Attributes:
        camera_rotation: Of the camera about its own axes (rotation vector), in radians.
        camera_translation: Of the camera along its own axes, in metres.
        view_scale: Factor on the vertical field of view.
        light_direction: Of the main light's rays, in the board frame; any length.
        light: Colour and strength of the main light, which throws the shadows.
        fill_direction: Of the second light's rays, in the board frame.
        fill: Colour and strength of the second light, without shadows.
        ambient: Colour and strength of the light from everywhere.
        shadows: Whether shadows are drawn.
        table, floor: Surface colours, 0 to 1.
        board_light, board_dark: Colours of the two kinds of squares.
        square_tints: Factor for each square of the board, in the order x * 8 + y.
        block_tints: Factors on red, green and blue of each block of the layout.
        block_shifts: Displacement of each block along x and y of the board, in metres.
        block_turns: Rotation of each block about the vertical, in radians.
        white_balance: Factors on red, green and blue of the picture.
        gamma: Exponent on the picture's brightness.
        blur: Standard deviation of a Gaussian blur, in pixels at a height of 540; 0 is none.
        noise: Standard deviation of sensor noise, of 255 grey levels.
        noise_seed: Makes the sensor noise of this picture reproducible.
    """

    camera_rotation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    camera_translation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    view_scale: float = 1.0
    light_direction: Float[np.ndarray, "3"] = field(
        default_factory=lambda: _rgb(0.42, -0.38, -0.82)
    )
    light: Rgb = field(default_factory=lambda: _rgb(0.52, 0.51, 0.50))
    fill_direction: Float[np.ndarray, "3"] = field(default_factory=lambda: _rgb(0.25, 0.75, -0.6))
    fill: Rgb = field(default_factory=lambda: _rgb(0.20, 0.21, 0.23))
    ambient: Rgb = field(default_factory=lambda: _rgb(0.44, 0.44, 0.45))
    shadows: bool = True
    table: Rgb = field(default_factory=lambda: _rgb(0.90, 0.89, 0.87))
    floor: Rgb = field(default_factory=lambda: _rgb(0.45, 0.47, 0.50))
    board_light: Rgb = field(default_factory=lambda: _rgb(0.80, 0.80, 0.78))
    board_dark: Rgb = field(default_factory=lambda: _rgb(0.09, 0.09, 0.10))
    square_tints: Float[np.ndarray, "64"] = field(default_factory=lambda: np.ones(64))
    block_tints: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.ones((MAX_BLOCKS, 3)))
    block_shifts: Float[np.ndarray, "n 2"] = field(
        default_factory=lambda: np.zeros((MAX_BLOCKS, 2))
    )
    block_turns: Float[np.ndarray, " n"] = field(default_factory=lambda: np.zeros(MAX_BLOCKS))
    white_balance: Rgb = field(default_factory=lambda: np.ones(3))
    gamma: float = 1.0
    blur: float = 0.0
    noise: float = 0.0
    noise_seed: int = 0

    @classmethod
    def sample(cls, rng: np.random.Generator, strength: float = 1.0) -> "Appearance":
        """A random look around the nominal one (domain randomisation).

        Args:
            rng: Source of all randomness; the same generator state gives the same look.
            strength: Factor on camera and block displacement: 1 is a well mounted
                camera (2 degrees, 1 cm) over carefully placed blocks (0.6 mm, 1.5 degrees).

        References:
            Thesis 3.2.5, level 1, with displacements small enough for a cell to stay readable.
        """
        base = cls()

        def about(direction: np.ndarray, spread: float) -> np.ndarray:
            return direction / np.linalg.norm(direction) + rng.normal(0.0, spread, 3)

        exposure = rng.uniform(0.80, 1.12)
        warmth = rng.normal(0.0, 0.04) * np.array([1.0, 0.0, -1.0])
        light_direction = about(base.light_direction, 0.22)
        light_direction[2] = min(light_direction[2], -0.45)
        fill_direction = about(base.fill_direction, 0.35)
        fill_direction[2] = min(fill_direction[2], -0.25)
        dark_table = rng.random() < 0.25
        table = rng.uniform(0.15, 0.6) if dark_table else rng.uniform(0.70, 1.0)
        brightness = rng.uniform(0.85, 1.10, (MAX_BLOCKS, 1))
        return cls(
            camera_rotation=strength * rng.uniform(-1.0, 1.0, 3) * np.deg2rad(2.0),
            camera_translation=strength * rng.uniform(-1.0, 1.0, 3) * 0.01,
            view_scale=1.0 + strength * rng.uniform(-0.03, 0.03),
            light_direction=light_direction,
            light=base.light * exposure * rng.uniform(0.65, 1.15) * (1.0 + warmth),
            fill_direction=fill_direction,
            fill=base.fill * exposure * rng.uniform(0.5, 1.4) * (1.0 - warmth),
            ambient=base.ambient * exposure * rng.uniform(0.85, 1.2),
            shadows=bool(rng.random() < 0.92),
            table=np.clip(table * rng.uniform(0.88, 1.0, 3), 0.0, 1.0),
            floor=rng.uniform(0.1, 0.8) * rng.uniform(0.8, 1.0, 3),
            board_light=rng.uniform(0.72, 0.88) * rng.uniform(0.95, 1.0, 3),
            board_dark=rng.uniform(0.02, 0.20) * rng.uniform(0.8, 1.0, 3),
            square_tints=rng.uniform(0.94, 1.0, 64),
            block_tints=brightness * rng.uniform(0.92, 1.08, (MAX_BLOCKS, 3)),
            block_shifts=strength * rng.normal(0.0, 0.0006, (MAX_BLOCKS, 2)).clip(-0.0015, 0.0015),
            block_turns=strength * rng.normal(0.0, np.deg2rad(1.5), MAX_BLOCKS),
            white_balance=rng.uniform(0.94, 1.06, 3),
            gamma=rng.uniform(0.85, 1.2),
            blur=rng.uniform(0.3, 1.1) if rng.random() < 0.6 else 0.0,
            noise=rng.uniform(0.0, 6.0),
            noise_seed=int(rng.integers(2**31)),
        )

    def lit_for_film(self) -> "Appearance":
        """The same with a lamp beside the external camera, which looks against the light."""
        return replace(
            self,
            fill_direction=np.array([-0.75, 0.35, -0.55]),
            fill=2.0 * self.fill,
            ambient=0.9 * self.ambient,
        )

    def develop(self, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """The picture as the sensor gives it: white balance, gamma, blur and noise."""
        if self.gamma != 1.0 or np.any(self.white_balance != 1.0):
            levels = np.linspace(0.0, 1.0, 256)[:, None] ** self.gamma * self.white_balance
            table = np.clip(np.rint(255.0 * levels), 0, 255).astype(np.uint8)
            image = cv2.LUT(np.ascontiguousarray(image), table[:, None, :])
        if self.blur > 0.0:
            sigma = self.blur * image.shape[0] / 540.0
            image = cv2.GaussianBlur(np.ascontiguousarray(image), (0, 0), max(sigma, 0.1))
        if self.noise > 0.0:
            image = _with_noise(np.ascontiguousarray(image), self.noise, self.noise_seed)
        return np.ascontiguousarray(image)


@cache
def _noise_tile() -> Float[np.ndarray, " n"]:
    return np.random.default_rng(731).standard_normal(3 * 2**20, dtype=np.float32)


def _with_noise(image: np.ndarray, deviation: float, seed: int) -> np.ndarray:
    """Add Gaussian noise, read from a random place of a fixed tile (drawing afresh costs 20 ms)."""
    rng = np.random.default_rng(seed)
    count = image.size
    tile = _noise_tile()
    if count > tile.size:
        drawn = rng.standard_normal(count, dtype=np.float32)
    else:
        start = int(rng.integers(tile.size - count + 1))
        drawn = tile[start : start + count]
    noise = (drawn * np.float32(deviation)).reshape(image.shape)
    return cv2.add(image, noise, dtype=cv2.CV_8U)
