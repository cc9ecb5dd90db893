"""Where the lamps of an environment stand, from the glints that they leave on its board.

One picture of an evenly bright plane says nothing of where its light comes from. Many do, unless
ink and paper are perfectly matt: a dark square looks brighter from where it mirrors a lamp. What
is fitted is every dark square's brightness as a share of that of its pale neighbours, so that
exposure, vignetting and uneven light fall out. Board and lamps must stay where they are from
photograph to photograph.

References:
    Walter et al. (2007), Microfacet models for refraction through rough surfaces: the lobe.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.optimize import minimize

from fusionnet.geometry import invert
from fusionnet.views.checkerboard import Checkerboard

NO_LAMPS = np.zeros((0, 3))
"""Where none were found."""

MOST_LAMPS = 2
"""Looked for: the main lamp, and a window or a second lamp."""

FEWEST = 10
"""Photographs of a board from which on its glints are trusted."""

EXPLAINED = 0.3
"""Share of the variance of what is left to explain that a lamp must."""

AGREEMENT = np.deg2rad(10.0)
"""How near to a lamp each half of the photographs must find one too."""

OVEREXPOSED = 254.0
"""Median of the pale squares (of 255) above which a photograph is left out."""

LOWEST = np.deg2rad(15.0)
"""Height of a lamp above the table under which it does not count."""

_DIRECTIONS = 600
_ROUGHNESS = (0.1, 0.2, 0.4)


@dataclass(frozen=True, eq=False)
class Glints:
    """What one photograph tells of the dark squares between the inner corners of a board.

    Attributes:
        brightness: Of each, by the mean of its pale neighbours.
        to_camera: Directions from them to the camera, of length 1, in the pattern's frame.
    """

    brightness: Float[np.ndarray, " s"]
    to_camera: Float[np.ndarray, "s 3"]


def glints_in(
    image: UInt8[np.ndarray, "h w 3"],
    corners: Float[np.ndarray, "n 2"],
    board: Checkerboard,
    camera_from_pattern: Float[np.ndarray, "4 4"],
) -> Glints | None:
    """Measure the dark squares in a photograph; None where it is overexposed.

    Args:
        image: As the lens took it.
        corners: Of the board in it, in pixels, in the order of the board's points.
        board: One whose ends can be told apart, so that its first inner square is dark.
        camera_from_pattern: Pose of the camera, in the board's lengths.
    """
    across, down = board.inner
    steps = np.linspace(0.25, 0.75, 5)
    v, u = (each.reshape(-1, 1, 1, 1) for each in np.meshgrid(steps, steps, indexing="ij"))

    def inside(at: np.ndarray) -> np.ndarray:
        """Points within each square, by what the corners have."""
        grid = at.reshape(down, across, -1)
        first, last = ((1 - u) * row[:, :-1] + u * row[:, 1:] for row in (grid[:-1], grid[1:]))
        inner: np.ndarray = (1 - v) * first + v * last
        return inner

    pixels = inside(corners).reshape(steps.size**2, -1, 2).astype(np.float32)
    seen = cv2.remap(image, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR)
    level = seen.mean(axis=(0, 2)).reshape(down - 1, across - 1)
    dark = np.indices(level.shape).sum(axis=0) % 2 == 0
    if np.median(level[~dark]) > OVEREXPOSED:
        return None
    around = _around(np.where(dark, 0.0, level)) / np.maximum(_around(~dark), 1.0)
    back = invert(camera_from_pattern)[:3, 3] - inside(board.points).mean(axis=0)[dark]
    return Glints(
        brightness=level[dark] / np.maximum(around[dark], 1.0),
        to_camera=back / np.linalg.norm(back, axis=1, keepdims=True),
    )


def lamp_rays(glints: Sequence[Glints]) -> Float[np.ndarray, "k 3"]:
    """The rays of the lamps that glints tell of, strongest first.

    A lamp counts if it explains much of how the brightness changes from photograph to photograph,
    and if the odd and the even photographs find it each by themselves.

    Args:
        glints: In the photographs of one board that lies still under the same lamps.

    Returns:
        Directions of length 1 in the pattern's frame, rounded to four decimals; at most
        `MOST_LAMPS`, and none where the photographs are too few, do not agree, or see no glint.
    """
    if len(glints) < FEWEST:
        return NO_LAMPS
    found = _lamps(glints)
    halves = [np.array([lamp for lamp, _ in _lamps(glints[start::2])]) for start in (0, 1)]
    rays = []
    for lamp, explained in found:
        agreed = all((half @ lamp).max() >= np.cos(AGREEMENT) for half in halves)
        if explained < EXPLAINED or -lamp[2] < np.sin(LOWEST) or not agreed:
            break
        rays.append(-lamp.round(4))
    return np.array(rays).reshape(-1, 3)


def _lamps(glints: Sequence[Glints]) -> list[tuple[Float[np.ndarray, "3"], float]]:
    """Directions to lamps, each with the share of what is left by those before that it explains."""
    to_camera = np.array([each.to_camera for each in glints])
    left = _changes(np.array([each.brightness for each in glints]))
    lamps = []
    for _ in range(MOST_LAMPS):
        lamp, roughness = _best(left, to_camera)
        lobe = _changes(_lobe(lamp, roughness, to_camera))
        strength = (lobe * left).sum() / max((lobe**2).sum(), 1e-12)
        lamps.append((lamp, _explained(lobe, left)))
        left = left - strength * lobe
    return lamps


def _best(
    left: Float[np.ndarray, "v s"], to_camera: Float[np.ndarray, "v s 3"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """The direction to a lamp, and the roughness, that explain most."""

    def loss(parameters: np.ndarray) -> float:
        lobe = _lobe(_lamp(parameters), np.exp(parameters[2]), to_camera)
        return -_explained(_changes(lobe), left)

    starts = [
        np.append(-each[:2] / each[2], np.log(roughness))
        for each in _upwards()
        for roughness in _ROUGHNESS
    ]
    best = minimize(
        loss,
        min(starts, key=loss),
        method="Nelder-Mead",
        options={"xatol": 1e-3, "fatol": 1e-6},
    ).x
    return _lamp(best), float(np.exp(best[2]))


def _lamp(parameters: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The direction to a lamp by where it passes a plane above the board."""
    direction = np.array([parameters[0], parameters[1], -1.0])
    return direction / np.linalg.norm(direction)


def _lobe(
    lamp: Float[np.ndarray, "3"], roughness: float, to_camera: Float[np.ndarray, "v s 3"]
) -> Float[np.ndarray, "v s"]:
    """How strongly a plane glints: Trowbridge and Reitz's distribution of its facets."""
    half = to_camera + lamp
    cosine = half[..., 2] ** 2 / (half**2).sum(axis=-1)
    lobe: np.ndarray = (cosine * (roughness**2 - 1.0) + 1.0) ** -2
    return lobe


def _changes(values: Float[np.ndarray, "v s"]) -> Float[np.ndarray, "v s"]:
    """By how much each square differs from its mean over the photographs."""
    return values - values.mean(axis=0)


def _explained(lobe: Float[np.ndarray, "v s"], left: Float[np.ndarray, "v s"]) -> float:
    """Share of the variance that a lobe of positive strength explains."""
    common = max(float((lobe * left).sum()), 0.0)
    return common**2 / max(float((lobe**2).sum() * (left**2).sum()), 1e-12)


@cache
def _upwards() -> Float[np.ndarray, "n 3"]:
    """Directions spread evenly over the sky of the board (Fibonacci's spiral)."""
    index = np.arange(_DIRECTIONS) + 0.5
    height = np.sin(LOWEST) + (1.0 - np.sin(LOWEST)) * index / _DIRECTIONS
    turn, flat = np.pi * (1.0 + np.sqrt(5.0)) * index, np.sqrt(1.0 - height**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), -height])


def _around(values: Float[np.ndarray, "r c"] | Bool[np.ndarray, "r c"]) -> np.ndarray:
    """Sums over the four neighbours."""
    edged = np.pad(values.astype(float), 1)
    return edged[:-2, 1:-1] + edged[2:, 1:-1] + edged[1:-1, :-2] + edged[1:-1, 2:]
