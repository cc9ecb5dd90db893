"""What a trained reader said of rendered pictures, kept in a file with the truth.

One `.npz` without pickles:

- `occupancy` (n, 512, 17) float16: probabilities of the classes of each cell
- `holding` (n) float16: probability that a block is held
- `cells` (n, 512) uint8: the true class of each cell, 16 for empty
- `held` (n) int16: index of the held block's cell, or -1

`collect_reader_outputs` renders such pictures from layouts of training groups.
"""

import io
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Integer

from fusionnet.blocks import Layout
from fusionnet.blocks.plausibility import CELLS, CLASSES, layout_from_classes
from fusionnet.dataset.layouts import varied_layout
from fusionnet.errors import DataError
from fusionnet.files import write_whole
from fusionnet.models.retinanet import RetinaNet
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.training.simulated_readings import cells_of

_SHAPES = {
    "occupancy": ((CELLS, CLASSES + 1), "f"),
    "holding": ((), "f"),
    "cells": ((CELLS,), "iu"),
    "held": ((), "i"),
}


@dataclass(frozen=True)
class ReaderOutputs:
    """Readings with the layouts that were read; see the module's docstring."""

    occupancy: Float[np.ndarray, "n 512 17"]
    holding: Float[np.ndarray, " n"]
    cells: Integer[np.ndarray, "n 512"]
    held: Integer[np.ndarray, " n"]

    def __len__(self) -> int:
        """Number of readings."""
        return len(self.holding)

    def layout(self, place: int) -> Layout:
        """The true layout of one picture."""
        return layout_from_classes(self.cells[place], int(self.held[place]))

    def reading(self, place: int) -> tuple[Float[np.ndarray, "8 8 8 17"], float]:
        """What the reader said of one picture: occupancy, and probability of holding."""
        occupancy = self.occupancy[place].astype(np.float32).reshape(8, 8, 8, CLASSES + 1)
        return occupancy, float(self.holding[place])


def save_reader_outputs(
    file: Path,
    occupancy: Float[np.ndarray, "n 8 8 8 17"],
    holding: Float[np.ndarray, " n"],
    layouts: Sequence[Layout],
) -> None:
    """Write readings and the layouts that were read, whole or not at all.

    Raises:
        OutputError: If the file cannot be written.
    """
    cells, held = cells_of(layouts)
    stream = io.BytesIO()
    np.savez(
        stream,
        occupancy=occupancy.reshape(-1, CELLS, CLASSES + 1).astype(np.float16),
        holding=holding.astype(np.float16),
        cells=cells.reshape(-1, CELLS).astype(np.uint8),
        held=held.astype(np.int16),
    )
    write_whole(file, stream.getvalue())


def collect_reader_outputs(
    file: Path,
    reader: RetinaNet,
    real: Sequence[Layout],
    *,
    count: int,
    seed: int,
    robot: str = "nico",
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Render varied layouts through the robot's eye and keep what a reader says of them.

    Args:
        file: Where to keep it.
        reader: What reads the pictures.
        real: Layouts of training groups, to be varied.
        count: How many pictures.
        seed: Of the layouts and of how they look; not that of the reader's own pictures.
        robot: Whose left eye looks.
        progress: Called with pictures done and pictures in all.

    Raises:
        RenderingError: If pictures cannot be rendered here.
        OutputError: If the file cannot be written.
    """
    renderer = SceneRenderer(robot)
    layouts, occupancy, holding = [], [], []
    for index in range(count):
        rng = generator(seed, "reader output", index)
        layouts.append(varied_layout(rng, real, invented=0.1))
        view = renderer.view(
            layouts[-1],
            camera="left_eye",
            appearance=Appearance.sample(rng),
            labels=False,
        )
        sight = reader.see(view.image)
        occupancy.append(sight.cells.astype(np.float16))
        holding.append(sight.holding)
        if progress is not None:
            progress(index + 1, count)
    save_reader_outputs(file, np.stack(occupancy), np.array(holding), layouts)


def load_reader_outputs(file: Path) -> ReaderOutputs:
    """Read what `save_reader_outputs` wrote.

    Raises:
        DataError: If the file is missing, damaged or not in that form.
    """
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in _SHAPES}
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise DataError(f"Cannot read the readings {file}: {error}") from error
    count = len(arrays["holding"])
    for name, (shape, kind) in _SHAPES.items():
        if arrays[name].shape != (count, *shape) or arrays[name].dtype.kind not in kind:
            raise DataError(
                f"In the readings {file}, {name!r} has shape {arrays[name].shape} and type "
                f"{arrays[name].dtype}; expected {(count, *shape)}."
            )
    return ReaderOutputs(**arrays)
