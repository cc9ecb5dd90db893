"""The light of a photograph, estimated from the board in it, so that blocks fit in.

What a plane of known pattern tells: how bright and of which colour the light is (the pale
squares), and, if they grow brighter towards one side, on which side the lamp stands. Where lamps
stand is better known from all photographs of the same board (`glints.py`), if a view says so.
How much of the light comes straight from them is nominal. Everything is in the picture's own,
gamma-encoded, values, as all shading in FusionNet is. A board that is covered or missing is taken
for a pale table.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import BLOCK_SIZE, GRID
from fusionnet.geometry import apply
from fusionnet.simulation import Appearance
from fusionnet.views.view import EnvironmentalView

PAPER = 0.90
"""Share of the light that a pale square is taken to reflect."""

LEAST_SLOPE = 0.05
"""Change of brightness across the board from which on it says where the lamp stands."""


def estimate_light(view: EnvironmentalView) -> Appearance:
    """An appearance whose lights have the strength, colour and side of the view's own.

    Args:
        view: An undistorted photograph whose pose to the board is known.

    Returns:
        The nominal appearance with its lights in the directions of the view, or else turned about
        the vertical so that the main light comes from where the pale squares are brightest, and
        scaled for each colour so that paper is as bright as they. They keep the nominal direction
        where the view has none and the squares are evenly bright, and the nominal strength where
        too little of the board is in the picture.
    """
    nominal = _directed(Appearance(), view.light_directions)
    places, colors = _samples(view)
    pale = _pale(colors)
    if np.count_nonzero(pale) < GRID:
        return nominal
    places, colors = places[pale], colors[pale]
    level = np.median(colors, axis=0) / 255.0
    on_table = nominal.ambient + sum(
        strength * -direction[2] / np.linalg.norm(direction)
        for direction, strength in _lamps(nominal)
    )
    exposure = np.clip(level / PAPER, 0.05, 1.5) / on_table
    light = replace(
        nominal,
        light=nominal.light * exposure,
        fill=nominal.fill * exposure,
        ambient=nominal.ambient * exposure,
    )
    if len(view.light_directions):
        return light
    towards = _bright_side(places, colors.mean(axis=1))
    return light if towards is None else _turned(light, -towards)


def _directed(light: Appearance, rays: Float[np.ndarray, "k 3"]) -> Appearance:
    """The light along known rays; a fill light that is not known keeps its side of the main."""
    if len(rays):
        light = replace(_turned(light, rays[0, :2]), light_direction=rays[0])
    return light if len(rays) < 2 else replace(light, fill_direction=rays[1])


def _turned(light: Appearance, flat: Float[np.ndarray, "2"]) -> Appearance:
    """Both lights turned about the vertical until the main one shines along `flat`."""
    old = light.light_direction
    angle = np.arctan2(flat[1], flat[0]) - np.arctan2(old[1], old[0])
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return replace(light, light_direction=turn @ old, fill_direction=turn @ light.fill_direction)


def _lamps(light: Appearance) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(light.light_direction, light.light), (light.fill_direction, light.fill)]


def _samples(view: EnvironmentalView) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 3"]]:
    """Places inside the grid's squares (metres, board frame) and the colours seen there."""
    within = (np.arange(GRID)[:, None] + np.array([0.3, 0.5, 0.7])).ravel() * BLOCK_SIZE
    x, y = np.meshgrid(within, within)
    places = np.column_stack([x.ravel(), y.ravel()])
    points = apply(view.camera_from_board, np.column_stack([places, np.zeros(len(places))]))
    homogeneous = points @ view.matrix.T
    height, width = view.image.shape[:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = homogeneous[:, :2] / homogeneous[:, 2:]
    inside = (points[:, 2] > 0.0) & np.all((pixels >= 0) & (pixels <= [width - 1, height - 1]), 1)
    where = pixels[inside].astype(np.float32)[None]
    if not where.size:
        return np.zeros((0, 2)), np.zeros((0, 3))
    seen = cv2.remap(view.image, where[..., 0], where[..., 1], cv2.INTER_LINEAR)[0]
    return places[inside], seen.astype(float)


def _pale(colors: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """Which samples are of pale squares: the brighter half of two, all of an even surface."""
    if not len(colors):
        return np.zeros(0, bool)
    brightness = colors.mean(axis=1)
    dark, bright = np.percentile(brightness, [10, 90])
    return brightness >= (0.5 * (dark + bright) if bright - dark > 0.25 * bright else 0.0)


def _bright_side(
    places: Float[np.ndarray, "n 2"], brightness: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "2"] | None:
    """Where the brightness rises to, or None if it hardly does."""
    ground = np.column_stack([places - places.mean(axis=0), np.ones(len(places))])
    slope_x, slope_y, middle = np.linalg.lstsq(ground, brightness, rcond=None)[0]
    if np.hypot(slope_x, slope_y) * GRID * BLOCK_SIZE < LEAST_SLOPE * middle:
        return None
    return np.array([slope_x, slope_y])
