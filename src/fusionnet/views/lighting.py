"""The light of a photograph, estimated from the board in it, so that blocks fit in.

What a plane of known pattern tells: how bright and of which colour the light is (the pale
squares), and, if they grow brighter towards one side, on which side the lamp stands. What
it cannot tell is how high the lamp stands and how much of the light comes straight from it:
both are nominal. Everything is in the picture's own, gamma-encoded, values, as all shading
in FusionNet is. A board that is covered or missing is taken for a pale table.
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
        The nominal appearance with its lights scaled for each colour so that paper is as bright
        as the pale squares, and turned about the vertical so that the main light comes from where
        the squares are brightest. The nominal light where too little of the board is in the
        picture or the squares are evenly bright.
    """
    nominal = Appearance()
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
    turn = _turn_towards_brightness(places, colors.mean(axis=1), nominal.light_direction)
    return replace(
        nominal,
        light=nominal.light * exposure,
        fill=nominal.fill * exposure,
        ambient=nominal.ambient * exposure,
        light_direction=turn @ nominal.light_direction,
        fill_direction=turn @ nominal.fill_direction,
    )


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


def _turn_towards_brightness(
    places: Float[np.ndarray, "n 2"],
    brightness: Float[np.ndarray, " n"],
    direction: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "3 3"]:
    """The turn about the vertical after which rays along `direction` come from the bright side."""
    ground = np.column_stack([places - places.mean(axis=0), np.ones(len(places))])
    slope_x, slope_y, middle = np.linalg.lstsq(ground, brightness, rcond=None)[0]
    if np.hypot(slope_x, slope_y) * GRID * BLOCK_SIZE < LEAST_SLOPE * middle:
        return np.eye(3)
    angle = np.arctan2(-slope_y, -slope_x) - np.arctan2(direction[1], direction[0])
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
