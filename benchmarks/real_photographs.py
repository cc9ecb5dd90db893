"""What the shipped detector finds in real photographs of a checkerboard, and in blocks upon them.

    python benchmarks/real_photographs.py FOLDER --square 0.025 --out results/detector-real.json

The photographs hold no blocks: each box is a mistake. Then they are calibrated, blocks are drawn
upon their boards (at most three high, and only where the photograph shows them whole), and their
boxes are looked for around the board.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import tyro

from fusionnet.blocks import BLOCK_SIZE, GRID, Cell, Layout
from fusionnet.dataset.frame import PictureFrame
from fusionnet.dataset.layouts import varied_layout
from fusionnet.dataset.pictures import LEAST_PIXELS
from fusionnet.models.labelled_boxes import Boxes, BoxPrecision
from fusionnet.models.look import look
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import LEAST_SCORE, weights_folder
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.views import EnvironmentalView, OverlayRenderer
from fusionnet.views.calibration import calibrate
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.importing import view_of
from fusionnet.views.photographs import find_boards, picture_files
from fusionnet.views.picture_file import read_picture

MARGIN = 0.45
"""Of the crop on each side, as a share of the extent of the grid's lowest levels."""

LEVELS = 3
"""Blocks upon one another at most."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to look at.

    Attributes:
        folder: Of photographs of one checkerboard, by one camera.
        board: Squares along the board's long and short side.
        square: Edge of a square, in metres.
        layouts: How many layouts are drawn upon each photograph.
        checkpoint: A shipped name, or a folder that holds the checkpoint `detector`.
        seed: Of the layouts.
        out: Where to write the numbers; the terminal only by default.
        show: Where to write a picture of what was found; nowhere by default.
    """

    folder: tyro.conf.Positional[Path]
    board: tuple[int, int] = (10, 7)
    square: float = 0.025
    layouts: int = 8
    checkpoint: str = "compact"
    seed: int = 0
    out: Path | None = None
    show: Path | None = None


def low_layout(seed: int, number: int, view: EnvironmentalView) -> Layout:
    """A layout without a held block, nothing higher than `LEVELS`, all within the photograph."""
    layout = varied_layout(generator(seed, "real", number), [], invented=1.0)
    low = [b for b in layout.blocks if b is not layout.held and b.cell.z < LEVELS]
    outside = {b.cell[:2] for b in low if not _shown(b.cell, view)}
    return Layout(tuple(b for b in low if b.cell[:2] not in outside))


def _shown(cell: Cell, view: EnvironmentalView) -> bool:
    """Whether all of a cell appears in the photograph."""
    ends = np.stack(np.meshgrid(*([c, c + 1] for c in cell)), axis=-1).reshape(-1, 3)
    pixels = view.camera.project(ends * BLOCK_SIZE) + 0.5
    size = np.array(view.image.shape[1::-1])
    return bool(((pixels >= 0) & (pixels <= size)).all())


def framed(view: EnvironmentalView, frame: PictureFrame) -> tuple[EnvironmentalView, PictureFrame]:
    """The view with a grey border, and a crop that shows blocks as large as views of rooms do.

    There all eight levels of the grid fit into the network's input; here they would not fit
    into the photograph, so that there is a border and the crop has a wide margin.
    """
    height, width = view.image.shape[:2]
    grey = (127, 127, 127)
    image = cv2.copyMakeBorder(
        view.image, height, height, width, width, cv2.BORDER_CONSTANT, value=grey
    )
    matrix = view.matrix.copy()
    matrix[:2, 2] += [width, height]
    wide = replace(view, image=image, matrix=matrix)
    ends, tall = (0.0, GRID * BLOCK_SIZE), (0.0, LEVELS * BLOCK_SIZE)
    corners = np.array([[x, y, z] for x in ends for y in ends for z in tall])
    pixels = wide.camera.project(corners) + 0.5
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    wanted = np.array(frame.input_size, dtype=float)
    half = wanted * ((high - low) / wanted).max() * (0.5 + MARGIN)
    size = np.array(image.shape[1::-1])
    start = np.clip((low + high) / 2 - half, 0, size - 8).astype(int)
    end = np.clip((low + high) / 2 + half, start + 8, size).astype(int)
    crop = (int(start[0]), int(start[1]), int(end[0]), int(end[1]))
    shown = PictureFrame(
        eye_size=(int(size[0]), int(size[1])), crop=crop, input_size=frame.input_size
    )
    return wide, shown


def overlaid(config: Config, model: RetinaNet) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Precision of the box head upon calibrated photographs, and pictures of what it found."""
    calibration = calibrate(
        [find_boards(config.folder, Checkerboard(*config.board, config.square))],
        Checkerboard(*config.board, config.square),
    )
    environment = calibration.environments[0]
    width, height = calibration.size
    renderer = OverlayRenderer((3 * width, 3 * height))
    strict, lenient, pictures, shown = BoxPrecision(), BoxPrecision(), [], 0
    for row, photograph in enumerate(environment.used):
        alone = view_of(calibration, environment, photograph)
        view, frame = framed(alone, model.frame)
        for turn in range(config.layouts):
            layout = low_layout(config.seed, row * config.layouts + turn, alone)
            seen = renderer.view(layout, view)
            kept = seen.visible[seen.indices] >= LEAST_PIXELS
            boxes = np.clip(frame.to_input(seen.boxes), 0, np.tile(frame.input_size, 2))
            kept &= (boxes[:, 2:] - boxes[:, :2]).min(axis=1) > 1
            truth = Boxes(
                torch.from_numpy(boxes[kept]).float(),
                torch.from_numpy(seen.classes[kept]),
                torch.ones(int(kept.sum())),
            )
            prepared = frame.prepare(seen.image)
            found = model.detect_prepared(prepared)
            strict.update(found, truth)
            lenient.update(found, truth, torch.from_numpy(seen.mostly_hidden[kept]))
            shown += 1
            if turn == 0:
                for box in found.xyxy[found.scores >= LEAST_SCORE].int().tolist():
                    cv2.rectangle(prepared, box[:2], box[2:], (255, 0, 255), 1)
                pictures.append(prepared)
    numbers = {
        "photographs": len(environment.used),
        "n": shown,
        "all_boxes": strict.compute(),
        "without_mostly_hidden_blocks": lenient.compute(),
    }
    return numbers, pictures


def main(config: Config) -> None:
    """Look at all photographs and print what was found."""
    model = RetinaNet.from_folder(weights_folder(config.checkpoint) / "detector")
    empty = {}
    for file in picture_files(config.folder):
        boxes = look(model, read_picture(file)).boxes
        empty[file.name] = int((boxes.scores >= LEAST_SCORE).sum())
    numbers, pictures = overlaid(config, model)
    report = {
        "command": f"python benchmarks/real_photographs.py FOLDER --square {config.square}",
        "empty_photographs": {
            "n": len(empty),
            "least_score": LEAST_SCORE,
            "without_any_box": sum(count == 0 for count in empty.values()),
            "boxes": empty,
        },
        "overlaid": numbers,
        "seed": config.seed,
        **provenance(),
    }
    text = json.dumps(report, indent=1)
    print(text)
    if config.out is not None:
        config.out.write_text(text + "\n")
    if config.show is not None:
        rows = [np.hstack(pictures[i : i + 4]) for i in range(0, len(pictures) - 3, 4)]
        cv2.imwrite(str(config.show), cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR))


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
