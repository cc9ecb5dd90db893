"""Views that are drawn, not photographed: any camera over any board on any table, among clutter.

Six rooms and fifteen cameras teach a detector six rooms. In these views nothing is twice the
same (domain randomisation), so that it learns what a block is, and that pale paper, stripes and
the squares of other boards are none.

References:
    Tobin et al. (2017), Domain randomization for transferring deep neural networks.
"""

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from scipy.spatial.transform import Rotation

from fusionnet.blocks import BLOCK_SIZE, GRID
from fusionnet.errors import InputError
from fusionnet.geometry import transform
from fusionnet.randomness import generator
from fusionnet.views.backdrops import Backdrops
from fusionnet.views.picture_file import check_size
from fusionnet.views.view import MOST_VIEWS, EnvironmentalView, Part, check_view

ENVIRONMENT = "drawn"
"""Environment of these views."""

GRAY = 0.4
"""Share of the views that are without colour, as many real photographs are."""

BOARDED = 0.9
"""Share of the views with a checkerboard."""

HELD = 0.4
"""Share of the views whose board is held up to the camera, as for calibrating, turned anyhow."""

PHOTOGRAPHED = 0.5
"""Share of backgrounds, tables and patterned things that show photographs, if there are any."""

_MIDDLE = np.array([GRID / 2, GRID / 2, GRID / 4]) * BLOCK_SIZE
_REACH = 0.75 * GRID * BLOCK_SIZE
_TEXEL = 24
"""Pixels a square of a checkerboard or a patch as drawn, before it is seen from somewhere."""

Picture = Float32[np.ndarray, "_ _ 3"]
"""Red, green and blue, 0 to 1."""


def drawn_views(
    count: int,
    seed: int = 0,
    size: tuple[int, int] = (960, 540),
    validation: int = 0,
    *,
    backdrops: Backdrops | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[EnvironmentalView, ...]:
    """As many views, each of a table of its own.

    Args:
        count: How many.
        seed: Source of all randomness; view `i` depends on the seed and `i` alone.
        size: Width and height of the pictures, in pixels.
        validation: How many, the last ones, are for validation only.
        backdrops: Photographs to be seen behind and among what is drawn; none by default.
        progress: Called after each view with how many there are, and will be.

    Raises:
        InputError: If fewer than one is asked for, all are for validation, or a picture of that
            size is too small or too large to be read again.
    """
    check_size("A view", *size)
    if not 0 <= validation < count <= MOST_VIEWS:
        raise InputError(
            f"1 to {MOST_VIEWS} views, of which at least one is for training; received {count}, "
            f"{validation} for validation."
        )
    views = []
    for number in range(count):
        rng = generator(seed, "drawn view", number)
        part: Part = "val" if number >= count - validation else "train"
        name = f"drawn-{number:05d}"
        views.append(drawn_view(rng, size, name=name, part=part, backdrops=backdrops))
        if progress is not None:
            progress(number + 1, count)
    return tuple(views)


def drawn_view(
    rng: np.random.Generator,
    size: tuple[int, int],
    *,
    name: str = "drawn",
    part: Part = "train",
    backdrops: Backdrops | None = None,
) -> EnvironmentalView:
    """One view: all of the grid is in it.

    Args:
        rng: Source of all randomness.
        size: Width and height of the picture, in pixels.
        name: Of the view.
        part: `train` or `val`.
        backdrops: Photographs to be seen behind and among what is drawn; none by default.
    """
    while True:
        matrix, pose = _camera(rng, size)
        view = EnvironmentalView(
            name=name,
            environment=ENVIRONMENT,
            part=part,
            image=np.zeros((size[1], size[0], 3), np.uint8),
            matrix=matrix,
            camera_from_board=pose,
        )
        try:
            check_view(view)
        except InputError:
            continue
        view.image[:] = _photograph(rng, size, matrix @ pose[:3, [0, 1, 3]], backdrops)
        return view


def _camera(
    rng: np.random.Generator, size: tuple[int, int]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "4 4"]]:
    """Intrinsics, and a pose from any side, from flat to steep, near to far, somewhat rolled.

    Of a board that is held, any side may be up.
    """
    width, height = size
    focal = max(size) * rng.uniform(0.6, 1.6)
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    distance = 2 * _REACH * focal / (min(size) * rng.uniform(0.4, 1.3))
    held = rng.random() < HELD
    elevation = np.arcsin(rng.uniform(0.6, 1.0)) if held else np.radians(rng.uniform(12, 89))
    azimuth = rng.uniform(0, 2 * np.pi)
    flat = np.cos(elevation)
    back = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    level = np.stack([right, -np.cross(back, right), -back])
    roll = rng.uniform(0, 2 * np.pi) if held else np.radians(rng.normal(0, 15))
    rotation = Rotation.from_rotvec([0, 0, roll]).as_matrix() @ level
    aim = _MIDDLE + rng.normal(0, 0.04, 3)
    return matrix, transform(rotation, -rotation @ (aim + distance * back))


def _photograph(
    rng: np.random.Generator,
    size: tuple[int, int],
    image_from_table: Float[np.ndarray, "3 3"],
    backdrops: Backdrops | None,
) -> UInt8[np.ndarray, "h w 3"]:
    """A background, a table, a board, and clutter, in a light that falls off to one side."""
    picture = _surface(rng, size, backdrops)
    for _ in range(rng.integers(0, 15)):
        _clutter(rng, picture, rng.uniform(0, size), backdrops)
    if rng.random() < 0.7:
        _add_table(rng, picture, image_from_table, backdrops)
    middle = image_from_table @ [*_MIDDLE[:2], 1.0]
    for _ in range(rng.integers(0, 12)):
        _clutter(rng, picture, rng.normal(middle[:2] / middle[2], size[1] / 4), backdrops)
    if rng.random() < BOARDED:
        _add_board(rng, picture, image_from_table)
    if rng.random() < GRAY:
        picture = np.repeat(picture.mean(axis=2, keepdims=True), 3, axis=2)
    slope = rng.uniform(-0.3, 0.3, 2)
    across, down = (
        np.linspace(-s, s, n, dtype=np.float32) for s, n in zip(slope, size, strict=True)
    )
    picture *= (1 + across + down[:, None])[..., None]
    picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 1.3) * size[1] / 400)
    grain = rng.uniform(0.0, 0.03) * rng.standard_normal(picture.shape, dtype=np.float32)
    return (255 * np.clip(picture + grain, 0, 1)).astype(np.uint8)


def _color(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    """Any, one of skin or wood, or a shade of gray."""
    kind = rng.random()
    if kind < 0.3:
        return rng.uniform(0.02, 1.0, 3)
    if kind < 0.5:
        return rng.uniform(0.2, 1.0) * np.array([0.95, 0.75, 0.6])
    return rng.uniform(0.02, 1.0) * rng.uniform(0.92, 1.0, 3)


def _crop(
    rng: np.random.Generator, size: tuple[int, int], backdrops: Backdrops | None
) -> Picture | None:
    """A part of a photograph, if there are any, and not always."""
    if backdrops is None or rng.random() >= PHOTOGRAPHED:
        return None
    return backdrops.crop(rng, size).astype(np.float32) / 255


def _surface(
    rng: np.random.Generator, size: tuple[int, int], backdrops: Backdrops | None
) -> Picture:
    """A photograph, or a colour with noise of several scales, as of wood, cloth or a wall out of
    focus.
    """
    if (photograph := _crop(rng, size, backdrops)) is not None:
        return photograph
    picture = np.full((size[1], size[0], 3), _color(rng), np.float32)
    for cells in (3, 8, 24, 64):
        shape = (cells, max(2, int(cells * rng.choice([0.15, 1.0]))))
        noise = np.float32(rng.uniform(0.0, 0.15)) * rng.standard_normal(shape, dtype=np.float32)
        picture *= 1 + cv2.resize(noise, size, interpolation=cv2.INTER_CUBIC)[..., None]
    return np.clip(picture, 0.0, 1.0)


def _clutter(
    rng: np.random.Generator,
    picture: Picture,
    place: Float[np.ndarray, "2"],
    backdrops: Backdrops | None,
) -> None:
    """A thing at a pixel: round, of any outline, a bar, or flat with a pattern."""
    unit = picture.shape[0] / 300
    x, y = (int(v) for v in place)
    color = tuple(float(v) for v in _color(rng))
    reach = unit * float(np.exp(rng.uniform(np.log(4), np.log(90))))
    kind = rng.random()
    if kind < 0.2:
        axes = (int(reach) + 1, int(reach * rng.uniform(0.2, 1.0)) + 1)
        cv2.ellipse(picture, (x, y), axes, rng.uniform(0, 180), 0, 360, color, -1, cv2.LINE_AA)
    elif kind < 0.4:
        angles = np.sort(rng.uniform(0, 2 * np.pi, 7))
        corners = np.stack([np.cos(angles), np.sin(angles)], axis=1) * reach + [x, y]
        cv2.fillConvexPoly(picture, np.rint(corners).astype(np.int32), color, cv2.LINE_AA)
    elif kind < 0.55:
        end = np.rint([x, y] + rng.normal(0, 2 * reach, 2)).astype(int)
        thick = int(rng.integers(1, 25) * unit) + 1
        cv2.line(picture, (x, y), (int(end[0]), int(end[1])), color, thick, cv2.LINE_AA)
    else:
        patch = _patch(rng, backdrops)
        tall, wide = patch.shape[:2]
        scale = np.diag([reach / tall, reach / tall, 1.0])
        turn = Rotation.from_rotvec(rng.uniform(-1, 1, 3) * [1.0, 1.0, 3.1]).as_matrix()
        turn[2, :] *= rng.uniform(0.0, 0.3) / reach
        turn[2, 2] = 1.0
        turn[:2, 2] = [x, y]
        center = np.array([[1, 0, -wide / 2], [0, 1, -tall / 2], [0, 0, 1]])
        _paste(picture, patch, turn @ scale @ center)


def _patch(rng: np.random.Generator, backdrops: Backdrops | None) -> Picture:
    """A flat thing: plain, striped, of lines as on paper, or of keys as on a keyboard; or a
    photograph.
    """
    tall, wide = int(rng.integers(30, 200)), int(rng.integers(30, 300))
    if (photograph := _crop(rng, (wide, tall), backdrops)) is not None:
        return photograph
    ground, ink = _color(rng), _color(rng)
    if rng.random() < 0.4:
        ground = rng.uniform(0.75, 1.0) * rng.uniform(0.95, 1.0, 3)
    patch = np.full((tall, wide, 3), ground, np.float32)
    step = int(rng.integers(6, 40))
    line = int(rng.integers(1, max(2, step // 2)))
    rows, columns = np.indices((tall, wide)) % step < line
    gaps = np.repeat(rng.random((tall // step + 1, wide // 6 + 1)) < 0.3, 6, axis=1)
    words = rows & ~np.repeat(gaps, step, axis=0)[:tall, :wide]
    inked = (np.zeros_like(rows), rows, words, rows | columns)[rng.integers(4)]
    patch[inked] = ink
    return patch


def _paste(picture: Picture, flat: Picture, warp: Float[np.ndarray, "3 3"]) -> None:
    """Put a flat thing before a picture, where a homography sees it."""
    tall, wide = flat.shape[:2]
    corners = np.array([[0, 0, 1], [wide, 0, 1], [wide, tall, 1], [0, tall, 1]]) @ warp.T
    if (corners[:, 2] <= 0).any():
        return
    pixels = corners[:, :2] / corners[:, 2:]
    limit = picture.shape[1::-1]
    left, top = np.clip(np.floor(pixels.min(axis=0)) - 1, 0, limit).astype(int)
    right, bottom = np.clip(np.ceil(pixels.max(axis=0)) + 2, 0, limit).astype(int)
    if left >= right or top >= bottom:
        return
    part = picture[top:bottom, left:right]
    size = (int(right - left), int(bottom - top))
    warp = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1]]) @ warp
    cover = cv2.warpPerspective(np.ones((tall, wide), np.float32), warp, size)[..., None]
    part += cover * (cv2.warpPerspective(flat, warp, size, borderMode=cv2.BORDER_REPLICATE) - part)


def _add_table(
    rng: np.random.Generator,
    picture: Picture,
    image_from_table: Float[np.ndarray, "3 3"],
    backdrops: Backdrops | None,
) -> None:
    """A rectangle or an ellipse around the grid."""
    half = _REACH * rng.uniform(0.9, 1.8, 2)
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    outline = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if rng.random() < 0.6:
        outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
        turn = Rotation.from_rotvec([0, 0, rng.uniform(0, np.pi)]).as_matrix()[:2, :2]
        outline = outline @ turn
    table = _MIDDLE[:2] + outline * half
    seen = np.column_stack([table, np.ones(len(table))]) @ image_from_table.T
    if (seen[:, 2] <= 0).any():
        return
    corners = np.rint(seen[:, :2] / seen[:, 2:]).clip(-20_000, 20_000).astype(np.int32)
    cover = np.zeros(picture.shape[:2], np.float32)
    cv2.fillConvexPoly(cover, corners, 1.0, cv2.LINE_AA)
    surface = _surface(rng, (picture.shape[1], picture.shape[0]), backdrops)
    picture += cover[..., None] * (surface - picture)


def _add_board(
    rng: np.random.Generator, picture: Picture, image_from_table: Float[np.ndarray, "3 3"]
) -> None:
    """A checkerboard with a margin on the table: under the grid's cells, or as it comes."""
    columns, rows = int(rng.integers(6, 13)), int(rng.integers(5, 11))
    square, turn = BLOCK_SIZE * rng.uniform(0.6, 1.4), rng.uniform(0, 2 * np.pi)
    place = _MIDDLE[:2] + rng.normal(0, 0.03, 2)
    if rng.random() < 0.5:
        columns, rows = (int(v) for v in rng.integers(GRID - 1, GRID + 3, 2))
        square, turn = BLOCK_SIZE, 0.5 * np.pi * rng.integers(4)
        place = _MIDDLE[:2] + 0.5 * BLOCK_SIZE * np.array([columns % 2, rows % 2])
    pale = rng.uniform(0.55, 1.0) * rng.uniform(0.93, 1.0, 3)
    dark = rng.uniform(0.0, 0.35) * rng.uniform(0.85, 1.0, 3)
    squares = (np.indices((rows, columns)).sum(axis=0) % 2)[..., None]
    board = (
        np.where(squares, pale, dark)
        .astype(np.float32)
        .repeat(_TEXEL, axis=0)
        .repeat(_TEXEL, axis=1)
    )
    margin = int(_TEXEL * rng.choice([rng.uniform(0, 1), rng.uniform(1, 3)], p=[0.7, 0.3]))
    edge = float(rng.choice([pale.mean(), rng.uniform(0.05, 1.0)]))
    board = np.pad(board, ((margin, margin), (margin, margin), (0, 0)), constant_values=edge)
    tall, wide = board.shape[:2]
    c, s = square / _TEXEL * np.array([np.cos(turn), np.sin(turn)])
    table_from_board = np.array([[c, -s, place[0]], [s, c, place[1]], [0, 0, 1]])
    center = np.array([[1, 0, -(wide - 1) / 2], [0, 1, -(tall - 1) / 2], [0, 0, 1]])
    _paste(picture, board, image_from_table @ table_from_board @ center)
