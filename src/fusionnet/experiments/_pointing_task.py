"""A reduced task on which representations can be ablated in minutes: few blocks, short commands.

Two to five blocks on the table, none above the fourth level, a sentence of at most twelve words
of our own grammar that moves one of them, one picture through the robot's left eye with chance in
light, camera and blocks. Training and test commands are drawn from different numbers of the same
generator, so their layouts differ; their kind does not.
"""

import hashlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from dataclasses import replace as replaced
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from fusionnet.blocks import BLOCK_SIZE, GRID, plan
from fusionnet.corpora import Command, synthetic
from fusionnet.dataset.pictures import EYE_FRAME, Labels, label
from fusionnet.files import write_whole
from fusionnet.models.target_text import source_tokens, target_tokens
from fusionnet.randomness import generator
from fusionnet.rcl import format as format_tree
from fusionnet.simulation import Appearance
from fusionnet.simulation.renderer import SceneRenderer

FEWEST, MOST = 2, 5
LONGEST = 12
LEVELS = 4
CELLS = np.flatnonzero(np.arange(GRID**3) % GRID < LEVELS)
"""The 256 of the grid's 512 cells in which there may be blocks."""

INPUT_SIZE = (132, 114)
"""Width and height of the pictures."""

_SEED = 7_000


@dataclass(frozen=True)
class PointingSet:
    """Commands with their pictures.

    Attributes:
        commands: What is asked, in which scene.
        pictures: Through the left eye, cropped to the grid.
        pixels: Where points of each cell appear to the eye in its nominal pose, in pixels.
        cells: Class of each of the `CELLS`; 16 where there is no block.
        source, target: Positions in `CELLS` of the cell to grasp at and of the one to place at.
        sentences, trees: Their tokens.
    """

    commands: tuple[Command, ...]
    pictures: UInt8[np.ndarray, "n h w 3"]
    pixels: Float[np.ndarray, "256 p 2"]
    cells: Int[np.ndarray, "n 256"]
    source: Int[np.ndarray, " n"]
    target: Int[np.ndarray, " n"]
    sentences: list[list[str]]
    trees: list[list[str]]


def pointing_set(
    folder: Path, count: int, first: int, progress: Callable[[int, int], None] | None = None
) -> PointingSet:
    """Commands from number `first` on that are short and simple enough; pictures are kept.

    Args:
        folder: Where pictures are kept between runs.
        count: Commands wanted.
        first: Number of the generator's command to begin with.
        progress: Called with pictures done and pictures in all.
    """
    commands = _simple(count, first)
    file = folder / f"pointing-{LEVELS}-{first}-{_digest(commands)}.npz"
    if not file.is_file():
        _render(file, commands, first, progress)
    with np.load(file, allow_pickle=False) as stored:
        pictures, pixels, cells = stored["pictures"], stored["pixels"], stored["cells"]
    moves = [plan(command.tree, command.scene.before) for command in commands]
    return PointingSet(
        commands=commands,
        pictures=pictures,
        pixels=pixels,
        cells=cells,
        source=np.searchsorted(CELLS, [move.source.index for move in moves]),
        target=np.searchsorted(CELLS, [move.target.index for move in moves]),
        sentences=[source_tokens(command.sentence) for command in commands],
        trees=[
            target_tokens("short", command.sentence, format_tree(command.tree))
            for command in commands
        ],
    )


def _digest(commands: Sequence[Command]) -> str:
    """Of the layouts that are drawn."""
    drawn = repr([command.scene.before.blocks for command in commands])
    return hashlib.blake2b(drawn.encode(), digest_size=6).hexdigest()


@lru_cache(maxsize=2)
def _simple(count: int, first: int) -> tuple[Command, ...]:
    """The next commands that move one of few blocks from the table or a stack to another place."""
    found: list[Command] = []
    for command in synthetic.commands(_SEED, first):
        before = command.scene.before
        if not FEWEST <= len(before.blocks) <= MOST or before.held is not None:
            continue
        if len(source_tokens(command.sentence)) > LONGEST:
            continue
        move = plan(command.tree, before)
        if move.begins_held or move.ends_held:
            continue
        if max(cell.z for cell in (move.target, *(b.cell for b in before.blocks))) >= LEVELS:
            continue
        found.append(command)
        if len(found) == count:
            break
    return tuple(found)


def _render(
    file: Path,
    commands: tuple[Command, ...],
    first: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    renderer = SceneRenderer("nico", (480, 270))
    left, top, right, bottom = (edge // 2 for edge in EYE_FRAME.crop)
    frame = replaced(
        EYE_FRAME,
        eye_size=(480, 270),
        crop=(left, top, right, bottom),
        input_size=INPUT_SIZE,
    )
    pictures, cells = [], []
    for number, command in enumerate(commands):
        look = Appearance.sample(generator(_SEED, "pointing look", first, number), strength=0.5)
        picture, labels = label(renderer, command.scene.before, look, frame)
        pictures.append(picture)
        cells.append(labels.cells[CELLS])
        if progress is not None:
            progress(number + 1, len(commands))
    _, nominal = label(renderer, commands[0].scene.before, Appearance(), frame)
    stream = io.BytesIO()
    np.savez_compressed(
        stream,
        pictures=np.stack(pictures),
        pixels=_projected(nominal),
        cells=np.stack(cells),
    )
    write_whole(file, stream.getvalue())


def _projected(labels: Labels) -> Float[np.ndarray, "256 p 2"]:
    """Where the middle of each cell, of its top, its front and its sides appear."""
    offsets = np.array(
        [[0.5, 0.5, 0.5], [0.5, 0.5, 1.0], [0.0, 0.5, 0.5], [0.3, 0.0, 0.5], [0.3, 1.0, 0.5]]
    )
    corners = np.stack(np.unravel_index(CELLS, (GRID, GRID, GRID)), axis=-1)[:, None]
    points = (corners + offsets) * BLOCK_SIZE
    pose = labels.camera_from_board
    in_camera = points @ pose[:3, :3].T + pose[:3, 3]
    projected = in_camera @ labels.matrix.T
    return projected[..., :2] / projected[..., 2:]
