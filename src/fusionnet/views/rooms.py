"""Six furnished rooms whose every lens, pose and lamp is known (thesis 3.2.2, rendered).

Photographs of them go through the same calibration as a person's, so that its error against the
truth can be told. The world's frame is that of the 8x8x8 grid, on a board of 10 x 7 squares.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks.grid import BLOCK_SIZE, GRID
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera, invert, transform
from fusionnet.geometry.fisheye import FisheyeLens
from fusionnet.randomness import generator
from fusionnet.simulation.offscreen import Offscreen
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.furniture import add_distractors, add_room, add_table
from fusionnet.views.pose import GridPlacement

Table = Literal["round-white", "rectangular-black"]
Lighting = Literal["bright", "dim", "mixed"]

BOARD = Checkerboard()
PLACEMENT = GridPlacement()

FOCAL = 620.0 / 960.0
"""Focal length of the lens as a share of the picture's width: 84 degrees from side to side."""

COEFFICIENTS = np.array([-0.03, 0.006, -0.004, 0.0])
"""k1 to k4: a little barrel beyond the equidistant fisheye's own."""

_CASTS_SHADOW = 0.1
"""Half size (metres) below which a thing throws shadows: toys do, table, board and walls do not."""

_PAPER = 0.0004
"""Half the thickness of the board's plates, whose tops are at height 0, in metres."""

MOST_TRIES = 2000
"""Poses in a row from which the whole grid is not in the picture, until we give up."""

OVERSAMPLING = 2
"""Rays along each side of a pixel."""


@dataclass(frozen=True, kw_only=True)
class Room:
    """One environmental set-up.

    Attributes:
        name: Of its folder of photographs.
        table: Round and white, or rectangular and black.
        lighting: Bright, dim, or mixed (a warm lamp and a cool window).
        distractors: Whether toys and fruit lie around the board.
        focus: Factor on the focal length: refocusing a lens changes it.
        lamp: Where the main lamp is seen from the grid's middle, a direction; by default
            the lighting's own.
        lamp_distance: Of the main lamp from there, in metres; None is far away, like the sun.
        gloss: Factor on how much all surfaces mirror the lamps; 0 is perfectly matt.
    """

    name: str
    table: Table
    lighting: Lighting
    distractors: bool
    focus: float
    lamp: tuple[float, float, float] | None = None
    lamp_distance: float | None = None
    gloss: float = 1.0

    @property
    def light_direction(self) -> Float[np.ndarray, "3"]:
        """Of the main lamp's rays, of length 1, in the frame of the grid."""
        rays = {"bright": (0.35, -0.30, -0.89), "dim": (-0.25, 0.45, -0.86)}
        ray = np.array(rays.get(self.lighting, (0.50, 0.40, -0.77)))
        ray = ray if self.lamp is None else -np.array(self.lamp)
        return ray / np.linalg.norm(ray)


_SET_UPS: tuple[tuple[Table, Lighting, bool, float], ...] = (
    ("round-white", "bright", False, 1.0),
    ("round-white", "dim", False, 1.008),
    ("round-white", "mixed", True, 0.992),
    ("rectangular-black", "bright", False, 1.012),
    ("rectangular-black", "dim", False, 0.988),
    ("rectangular-black", "mixed", True, 1.004),
)

ROOMS = tuple(
    Room(name=f"{table}-{light}", table=table, lighting=light, distractors=toys, focus=focus)
    for table, light, toys, focus in _SET_UPS
)
"""The six of thesis 3.2.2."""


def lens_of(room: Room, size: tuple[int, int]) -> FisheyeLens:
    """The true lens that a room is photographed with."""
    width, height = size
    focal = FOCAL * width * room.focus
    matrix = np.array([[focal, 0.0, 0.503 * width], [0.0, focal, 0.496 * height], [0.0, 0.0, 1.0]])
    return FisheyeLens(width, height, matrix, COEFFICIENTS)


class RoomPhotographer:
    """Takes photographs of one room through its fisheye lens.

    Args:
        room: What to photograph.
        size: Width and height of the photographs, in pixels.
        seed: Places the distractors.

    Raises:
        RenderingError: If pictures cannot be rendered here.
    """

    def __init__(self, room: Room, size: tuple[int, int] = (960, 540), seed: int = 0) -> None:
        self.room, self.lens = room, lens_of(room, size)
        self._maps, self._wide = _lens_maps(self.lens)
        spec = mujoco.MjSpec()
        visual = spec.visual
        visual.global_.offwidth, visual.global_.offheight = self._wide.width, self._wide.height
        visual.quality.offsamples = 0
        visual.quality.shadowsize = 2048
        visual.quality.numslices, visual.quality.numstacks = 96, 24
        visual.map.znear, visual.map.zfar, visual.map.shadowclip = 0.02, 12.0, 0.6
        visual.headlight.active = False
        spec.stat.extent = 1.0
        add_room(spec, room.lighting, room.light_direction, room.lamp_distance)
        add_table(spec, room.table)
        _add_board(spec)
        if room.distractors:
            add_distractors(spec, generator(seed, "distractors", room.name))
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._offscreen = Offscreen(model, (self._wide.width, self._wide.height))
        mujoco.mjv_updateScene(
            model,
            data,
            mujoco.MjvOption(),
            None,
            mujoco.MjvCamera(),
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._offscreen.scene,
        )
        scene = self._offscreen.scene
        for geom in scene.geoms[: scene.ngeom]:  # wide surfaces would shadow themselves in stripes
            geom.castshadow = max(geom.size) < _CASTS_SHADOW
            geom.specular *= room.gloss

    def take(
        self, camera_from_board: Float[np.ndarray, "4 4"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        """A photograph from a pose, with a little sensor noise drawn from `rng`."""
        wide = PinholeCamera(
            self._wide.width, self._wide.height, self._wide.matrix, camera_from_board
        )
        self._offscreen.aim(wide)
        bent = cv2.remap(self._offscreen.picture(), *self._maps, interpolation=cv2.INTER_LINEAR)
        image = cv2.resize(bent, self.lens.size, interpolation=cv2.INTER_AREA)
        noise = np.asarray(rng.normal(0.0, 1.5, image.shape), np.float32)
        noisy: np.ndarray = cv2.add(image, noise, dtype=cv2.CV_8U)
        return noisy

    def close(self) -> None:
        """Free the OpenGL context."""
        self._offscreen.close()


def calibration_pose(rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """`camera_from_board` of a photograph for calibration: near and far, slanted, off centre."""
    middle = GRID * BLOCK_SIZE / 2
    target = np.array([middle, middle, 0.0]) + np.append(rng.uniform(-0.12, 0.12, 2), 0.0)
    azimuth, elevation = rng.uniform(-np.pi, np.pi), np.deg2rad(rng.uniform(28.0, 80.0))
    return looking_at(target, azimuth, elevation, rng.uniform(0.26, 0.6), rng.uniform(-0.5, 0.5))


def view_poses(
    room: Room, size: tuple[int, int], rng: np.random.Generator
) -> Iterator[Float[np.ndarray, "4 4"]]:
    """Poses without end from which the whole grid, eight levels high, is in the picture.

    Raises:
        InputError: If it hardly ever is, in a picture of that size.
    """
    camera = lens_of(room, size).matrix
    middle = np.array([GRID, GRID, GRID * 0.75]) * BLOCK_SIZE / 2
    edges = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = edges * GRID * BLOCK_SIZE
    limits = np.array(size)
    left = MOST_TRIES
    while left:
        left -= 1
        target = middle + rng.uniform(-0.02, 0.02, 3)
        azimuth, elevation = rng.uniform(-np.pi, np.pi), np.deg2rad(rng.uniform(28.0, 58.0))
        pose = looking_at(
            target, azimuth, elevation, rng.uniform(0.42, 0.75), rng.uniform(-0.08, 0.08)
        )
        pixels = PinholeCamera(*size, camera, pose).project(corners) / limits
        if pixels.min() > 0.02 and pixels.max() < 0.98:
            yield pose
            left = MOST_TRIES
    raise InputError(
        f"The whole grid does not fit into photographs of {size[0]} x {size[1]} pixels; make "
        "them less wide for their height."
    )


def robot_pose(eye: Float[np.ndarray, "3"], rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """A pose a few centimetres from the robot's eye (in the grid's frame), aimed at the grid."""
    position = eye + rng.uniform(-0.02, 0.02, 3)
    middle = np.array([GRID, GRID, GRID * 0.75]) * BLOCK_SIZE / 2
    back = position - middle
    distance = float(np.linalg.norm(back)) * 1.25  # the whole of it must be in the picture
    azimuth = float(np.arctan2(back[1], back[0]))
    elevation = float(np.arcsin(back[2] / np.linalg.norm(back)))
    return looking_at(middle, azimuth, elevation, distance, rng.uniform(-0.03, 0.03))


def looking_at(
    target: Float[np.ndarray, "3"], azimuth: float, elevation: float, distance: float, roll: float
) -> Float[np.ndarray, "4 4"]:
    """`camera_from_board` of a camera at an azimuth and elevation from the target (rad, metres)."""
    out = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    forward = -out
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    turned = np.cos(roll) * right + np.sin(roll) * down
    axes = np.column_stack([turned, np.cross(forward, turned), forward])
    return invert(transform(axes, target + distance * out))


@dataclass(frozen=True, eq=False)
class _Wide:
    width: int
    height: int
    matrix: Float[np.ndarray, "3 3"]


def _lens_maps(lens: FisheyeLens) -> tuple[tuple[np.ndarray, np.ndarray], _Wide]:
    """Where each ray of the lens meets a pinhole picture wide enough for all, and that picture."""
    focal = OVERSAMPLING * lens.matrix[0, 0]
    steps = [
        (np.arange(OVERSAMPLING * side) + 0.5) / OVERSAMPLING - 0.5
        for side in (lens.width, lens.height)
    ]
    grid = np.stack(np.meshgrid(*steps), axis=-1)
    slopes = lens.slopes(grid.reshape(-1, 2)).reshape(grid.shape)
    reach = np.abs(slopes).reshape(-1, 2).max(axis=0)
    width, height = (2 * (int(np.ceil(focal * side)) + 2) for side in reach)
    matrix = np.array(
        [[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]]
    )
    pixels = (focal * slopes + np.array([width - 1, height - 1]) / 2).astype(np.float32)
    return (pixels[..., 0], pixels[..., 1]), _Wide(width, height, matrix)


def _add_board(spec: mujoco.MjSpec) -> None:
    """The paper and its squares, where the grid says that they are."""
    board_from_pattern = invert(PLACEMENT.pattern_from_board(BOARD))
    square = BOARD.square
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    mujoco.mju_mat2Quat(quaternion, board_from_pattern[:3, :3].ravel())

    def plate(x: float, y: float, below: float, half: tuple[float, float], color: float) -> None:
        geom = spec.worldbody.add_geom()
        geom.type = mujoco.mjtGeom.mjGEOM_BOX
        center = np.array([x, y, below + _PAPER])  # z of the pattern points into the board
        geom.pos = board_from_pattern[:3, :3] @ center + board_from_pattern[:3, 3]
        geom.quat = quaternion
        geom.size = np.array([*half, _PAPER])
        geom.rgba = np.array([color, color, 1.02 * color, 1.0]).clip(0.0, 1.0)

    width, height = BOARD.columns * square, BOARD.rows * square
    border = 0.01
    half = (width / 2 + border, height / 2 + border)
    plate(width / 2 - square, height / 2 - square, 0.00005, half, 0.86)
    for column in range(BOARD.columns):
        for row in range(BOARD.rows):
            if (column + row) % 2 == 0:
                x, y = (column - 0.5) * square, (row - 0.5) * square
                plate(x, y, 0.0, (square / 2, square / 2), 0.06)
