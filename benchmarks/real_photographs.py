"""What the shipped detector finds in real photographs of a checkerboard, and in blocks upon them.

    python benchmarks/real_photographs.py FOLDER --square 0.025 --out results/detector-real.json

The photographs hold no blocks: each box is a mistake. Then they are calibrated, blocks are drawn
upon their boards (at most three high, and only where the photograph shows them whole), and their
boxes are looked for in all of the photograph, as `fusionnet detect` does where no table is seen.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import tyro

from fusionnet.blocks import BLOCK_SIZE, Cell, Layout
from fusionnet.dataset.layouts import varied_layout
from fusionnet.dataset.pictures import LEAST_PIXELS
from fusionnet.models.labelled_boxes import Boxes, BoxPrecision
from fusionnet.models.look import look
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import LEAST_SCORE, detector_folder, view_detector_folder
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.views import EnvironmentalView, OverlayRenderer
from fusionnet.views.calibration import calibrate
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.importing import view_of
from fusionnet.views.photographs import find_boards, picture_files
from fusionnet.views.picture_file import read_picture

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


def overlaid(config: Config, model: RetinaNet) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Precision of the boxes upon calibrated photographs, and pictures of what was found."""
    calibration = calibrate(
        [find_boards(config.folder, Checkerboard(*config.board, config.square))],
        Checkerboard(*config.board, config.square),
    )
    environment = calibration.environments[0]
    renderer = OverlayRenderer(calibration.size)
    strict, lenient, pictures, shown = BoxPrecision(), BoxPrecision(), [], 0
    for row, photograph in enumerate(environment.used):
        view = view_of(calibration, environment, photograph)
        for turn in range(config.layouts):
            layout = low_layout(config.seed, row * config.layouts + turn, view)
            seen = renderer.view(layout, view)
            kept = seen.visible[seen.indices] >= LEAST_PIXELS
            truth = Boxes(
                torch.from_numpy(seen.boxes[kept]).float(),
                torch.from_numpy(seen.classes[kept]),
                torch.ones(int(kept.sum())),
            )
            found = model.detect(seen.image)
            strict.update(found, truth)
            lenient.update(found, truth, torch.from_numpy(seen.mostly_hidden[kept]))
            shown += 1
            if turn == 0:
                drawn = seen.image.copy()
                for box in found.xyxy[found.scores >= LEAST_SCORE].int().tolist():
                    cv2.rectangle(drawn, box[:2], box[2:], (255, 0, 255), 1)
                pictures.append(drawn)
    numbers = {
        "photographs": len(environment.used),
        "n": shown,
        "all_boxes": strict.compute(),
        "without_mostly_hidden_blocks": lenient.compute(),
    }
    return numbers, pictures


def main(config: Config) -> None:
    """Look at all photographs and print what was found."""
    eye = RetinaNet.from_folder(detector_folder(config.checkpoint))
    model = RetinaNet.from_folder(view_detector_folder(config.checkpoint))
    empty = {}
    for file in picture_files(config.folder):
        boxes = look(eye, read_picture(file), model).boxes
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
