"""Pictures through the robot's eye for the detector: rendered once, read many times.

Picture `i` of a seed is the same whatever the number of workers. Shards are plain
arrays (no pickle): `images-0007.npy` is memory-mapped while training, `labels-0007.npz`
holds boxes, cells, poses. A killed build continues with the shards that are missing.
"""

import multiprocessing
import os
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from fusionnet.blocks import Layout
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.layouts import varied_layout
from fusionnet.errors import DataError
from fusionnet.randomness import derived_seed, generator
from fusionnet.simulation import Appearance, SceneRenderer

EMPTY = 16
"""Class of a cell without a block; 0 to 15 are `blocks.CLASS_NAMES`."""

LEAST_PIXELS = 12
"""Blocks with fewer visible pixels of the eye's picture get no box."""

EYE_FRAME = PictureFrame(eye_size=(960, 540), crop=(190, 28, 782, 540), input_size=(352, 304))
"""The part of NICO's left eye in which the 8x8x8 grid appears, at 0.59 of its size."""


@dataclass(frozen=True, kw_only=True)
class PicturePlan:
    """What to render.

    Attributes:
        count: Pictures, rounded up to whole shards.
        seed: Source of all randomness.
        part: Name of the set, part of the seed: "train" or "val".
        invented: Share of layouts made up by our generator rather than varied from real ones.
        robot: Name of the robot whose left eye looks.
        shard: Pictures a file.
    """

    count: int
    seed: int = 0
    part: str = "train"
    invented: float = 0.45
    robot: str = "nico"
    shard: int = 250


@dataclass(frozen=True)
class Labels:
    """What is true of one picture.

    Attributes:
        boxes: Left, top, right, bottom in pixels of the network's input.
        classes: Index into `CLASS_NAMES` for each box.
        cells: Class of each of the 512 cells; `EMPTY` where there is no block.
        visible: Visible pixels (of the eye's picture) of the block in each cell.
        holding: Whether the gripper holds a block.
        matrix: Intrinsics for the network's input.
        camera_from_board: Pose of the eye.
        by_eye: Whether the robot's left eye looked, through which layouts are read.
    """

    boxes: Float[np.ndarray, "n 4"]
    classes: Int[np.ndarray, " n"]
    cells: Int[np.ndarray, "512"]
    visible: Int[np.ndarray, "512"]
    holding: bool
    matrix: Float[np.ndarray, "3 3"]
    camera_from_board: Float[np.ndarray, "4 4"]
    by_eye: bool = True


def label(
    renderer: SceneRenderer, layout: Layout, appearance: Appearance, frame: PictureFrame = EYE_FRAME
) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
    """The network's input for a layout, and what is true of it."""
    view = renderer.view(layout, camera="left_eye", appearance=appearance)
    cells = np.full(512, EMPTY)
    visible = np.zeros(512, dtype=int)
    for block, pixels in zip(layout.blocks, view.visible, strict=True):
        cells[block.cell.index] = block.class_index
        visible[block.cell.index] = pixels
    shown = view.visible[view.indices] >= LEAST_PIXELS
    boxes = frame.to_input(view.boxes[shown].astype(float))
    return frame.prepare(view.image), Labels(
        boxes=np.clip(boxes, 0, np.tile(frame.input_size, 2)),
        classes=view.classes[shown],
        cells=cells,
        visible=visible,
        holding=layout.held is not None,
        matrix=frame.matrix(view.camera.matrix),
        camera_from_board=view.camera.camera_from_robot @ renderer.robot.robot_from_board,
    )


def build_pictures(
    folder: Path,
    plan: PicturePlan,
    real: Sequence[Layout],
    *,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Render what is missing in `folder`.

    Args:
        folder: Where the shards go.
        plan: What to render.
        real: Layouts of the training groups to vary; may be empty.
        workers: Processes.
        progress: Called with shards done and shards in all.

    Raises:
        RenderingError: If pictures cannot be rendered here.
    """
    folder.mkdir(parents=True, exist_ok=True)
    shards = -(-plan.count // plan.shard)
    missing = [s for s in range(shards) if not (folder / f"labels-{s:04d}.npz").is_file()]
    done = shards - len(missing)
    work = partial(_render_shard, folder, plan, tuple(real))
    if workers == 1:
        for shard in missing:
            work(shard)
            done += 1
            if progress is not None:
                progress(done, shards)
        return
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for _ in pool.imap_unordered(work, missing):
            done += 1
            if progress is not None:
                progress(done, shards)


def _render_shard(folder: Path, plan: PicturePlan, real: Sequence[Layout], shard: int) -> None:
    renderer = _renderer(plan.robot)
    images, labels = [], []
    for index in range(shard * plan.shard, (shard + 1) * plan.shard):
        rng = generator(plan.seed, "picture", plan.part, index)
        layout = varied_layout(rng, real, invented=plan.invented)
        image, truth = label(renderer, layout, Appearance.sample(rng))
        images.append(image)
        labels.append(truth)
    aside = folder / f".images-{shard:04d}.npy"
    np.save(aside, np.stack(images))
    os.replace(aside, folder / f"images-{shard:04d}.npy")
    aside = folder / f".labels-{shard:04d}.npz"
    np.savez_compressed(
        aside,
        counts=np.array([len(t.boxes) for t in labels]),
        boxes=np.concatenate([t.boxes for t in labels]).astype(np.float32),
        classes=np.concatenate([t.classes for t in labels]).astype(np.uint8),
        cells=np.stack([t.cells for t in labels]).astype(np.uint8),
        visible=np.stack([t.visible for t in labels]).astype(np.int32),
        holding=np.array([t.holding for t in labels]),
        matrix=np.stack([t.matrix for t in labels]),
        camera_from_board=np.stack([t.camera_from_board for t in labels]),
    )
    os.replace(aside, folder / f"labels-{shard:04d}.npz")


_RENDERERS: dict[str, SceneRenderer] = {}


def _renderer(robot: str) -> SceneRenderer:
    """One renderer a process: its model and OpenGL context are costly to make."""
    if robot not in _RENDERERS:
        _RENDERERS[robot] = SceneRenderer(robot)
    return _RENDERERS[robot]


class Pictures:
    """All finished shards of a folder, as one indexable set.

    Raises:
        DataError: If there are none, or one is damaged.
    """

    def __init__(self, folder: Path) -> None:
        names = sorted(file.stem.removeprefix("labels-") for file in folder.glob("labels-*.npz"))
        if not names:
            raise DataError(f"No pictures in {folder}; render them with build_pictures.")
        self._images: list[np.ndarray] = []
        self._labels: list[list[Labels]] = []
        for name in names:
            try:
                images = np.load(folder / f"images-{name}.npy", mmap_mode="r", allow_pickle=False)
                with np.load(folder / f"labels-{name}.npz", allow_pickle=False) as stored:
                    labels = _unpack(dict(stored))
            except (OSError, ValueError, KeyError) as error:
                raise DataError(
                    f"Shard {name} in {folder} is damaged ({error}); delete it and build again."
                ) from error
            self._images.append(images)
            self._labels.append(labels)
        self._ends = list(accumulate(len(labels) for labels in self._labels))

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: int) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
        shard = bisect_right(self._ends, index)
        row = index - (self._ends[shard - 1] if shard else 0)
        return np.array(self._images[shard][row]), self._labels[shard][row]

    def order(self, seed: int, epoch: int) -> Int[np.ndarray, " n"]:
        """The order of one epoch."""
        return np.random.default_rng(derived_seed(seed, "order", epoch)).permutation(len(self))


def _unpack(stored: dict[str, np.ndarray]) -> list[Labels]:
    ends = np.cumsum(stored["counts"])
    starts = ends - stored["counts"]
    return [
        Labels(
            boxes=stored["boxes"][start:end],
            classes=stored["classes"][start:end].astype(int),
            cells=stored["cells"][row].astype(int),
            visible=stored["visible"][row].astype(int),
            holding=bool(stored["holding"][row]),
            matrix=stored["matrix"][row],
            camera_from_board=stored["camera_from_board"][row],
        )
        for row, (start, end) in enumerate(zip(starts, ends, strict=True))
    ]
