"""`fusionnet detect IMAGE...`: the blocks in pictures, and the layout where a board is seen."""

import io
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from PIL import Image
from rich.console import Console
from rich.table import Table

from fusionnet.apps.board_text import LEGEND, board_text
from fusionnet.apps.cli import EXIT_BAD_INPUT, EXIT_REACHED
from fusionnet.apps.drawing import Box, draw_boxes
from fusionnet.apps.progress import bars
from fusionnet.blocks import CLASS_NAMES, layout_to_json
from fusionnet.errors import InputError, OutputError
from fusionnet.files import write_whole
from fusionnet.models.look import Look, look
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import LEAST_SCORE, detector_folder, view_detector_folder
from fusionnet.views.picture_file import read_picture

NO_BOARD = "no board is seen where the estimated camera would have it; boxes only"
BOXES_ONLY = "this detector finds boxes only"


@dataclass(frozen=True, kw_only=True)
class DetectConfig:
    """Which pictures, and what is made of them."""

    images: tyro.conf.Positional[tuple[Path, ...]]
    """Pictures (PNG, JPEG, WEBP, BMP) of any size from 64 pixels a side to 40 million."""
    out: Path | None = None
    """Folder for NAME-boxes.png, with every box in its block's colour, and NAME.json."""
    checkpoint: str = "compact"
    """A shipped name, a folder that holds the checkpoint `detector`, or a detector's folder."""
    score: float = LEAST_SCORE
    """Boxes below this score are left out."""
    json: bool = False
    """Print one JSON object a line for each picture."""

    def __post_init__(self) -> None:
        """Refuse what cannot be looked at."""
        if not self.images:
            raise InputError("Which pictures? Name at least one file.")
        if not 0 <= self.score <= 1:
            raise InputError(f"A score goes from 0 to 1; received {self.score}.")


def detect(config: DetectConfig) -> int:
    """Find the blocks in pictures; where the board is seen, read the layout with probabilities.

    A picture that cannot be read is named and left out; the exit status is then 2.
    """
    if config.out is not None and config.out.exists() and not config.out.is_dir():
        raise OutputError(f"{config.out} is a file; name a folder (--out).")
    model = RetinaNet.from_folder(detector_folder(config.checkpoint))
    elsewhere = RetinaNet.from_folder(view_detector_folder(config.checkpoint))
    names = _names(config.images)
    status, several = EXIT_REACHED, len(config.images) > 1
    with bars() as bar:
        progress = bar("pictures")
        for number, (path, name) in enumerate(zip(config.images, names, strict=True), 1):
            try:
                document, seen = _look_at((model, elsewhere), path, name, config)
            except InputError as error:
                if not several:
                    raise
                status = EXIT_BAD_INPUT
                print(f"fusionnet: {error}", file=sys.stderr)
                document, seen = {"file": str(path), "error": str(error)}, None
            if config.json:
                print(json.dumps(document), flush=True)
            elif seen is not None:
                _show(document, seen)
            if several:
                progress(number, len(names))
    return status


def _names(images: Sequence[Path]) -> list[str]:
    """A name for each picture's files: its own, numbered where two are alike."""
    names: list[str] = []
    for path in images:
        name, number = path.stem, 1
        while name in names:
            number += 1
            name = f"{path.stem}-{number}"
        names.append(name)
    return names


def _look_at(
    models: tuple[RetinaNet, RetinaNet], path: Path, name: str, config: DetectConfig
) -> tuple[dict[str, Any], Look]:
    """Look at one picture, and write its files."""
    image = read_picture(path)
    began = time.perf_counter()
    seen = look(models[0], image, models[1])
    spent = 1000 * (time.perf_counter() - began)
    document = _as_json(seen, config.score)
    height, width = image.shape[:2]
    document = {"file": str(path), "width": width, "height": height} | document
    document["milliseconds"] = round(spent, 1)
    if config.out is not None:
        boxes = [Box(b["class"], b["score"], tuple(b["box"])) for b in document["boxes"]]
        drawn = io.BytesIO()
        Image.fromarray(draw_boxes(image, boxes, whole=True)).save(drawn, "PNG")
        write_whole(config.out / f"{name}-boxes.png", drawn.getvalue())
        write_whole(config.out / f"{name}.json", json.dumps(document, indent=1) + "\n")
    return document, seen


def _as_json(seen: Look, least: float) -> dict[str, Any]:
    boxes = [
        {
            "class": CLASS_NAMES[int(kind)],
            "score": round(float(score), 4),
            "box": [round(float(edge), 1) for edge in box],
        }
        for box, kind, score in zip(
            seen.boxes.xyxy, seen.boxes.classes, seen.boxes.scores, strict=True
        )
        if score >= least
    ]
    document: dict[str, Any] = {"boxes": boxes, "layout": None}
    if seen.board is not None:
        document["board_evidence"] = round(seen.board, 3)
    if seen.layout is None or seen.holding is None:
        document["no_layout"] = BOXES_ONLY if seen.board is None else NO_BOARD
        return document
    layout = layout_to_json(seen.layout)
    if seen.layout.held is None:
        del layout["gripper"]  # only a held block says where it is
    for block, probability in zip(layout["blocks"], seen.probabilities, strict=True):
        block["probability"] = round(probability, 4)
    return document | {"layout": layout, "holding": round(seen.holding, 4)}


def _show(document: dict[str, Any], seen: Look) -> None:
    """A picture's boxes as a table, and its layout as a board."""
    console = Console(highlight=False)
    found = document["boxes"]
    size = f"{document['width']} x {document['height']}"
    many = {0: "no block", 1: "1 block"}.get(len(found), f"{len(found)} blocks")
    console.print(f"{document['file']} ({size}): {many} found", style="bold", soft_wrap=True)
    if found:
        table = Table("block", "score", "left", "top", "right", "bottom", title_justify="left")
        for entry in found:
            box = Box(entry["class"], entry["score"], tuple(entry["box"]))
            edges = (f"{edge:.0f}" for edge in box.corners)
            table.add_row(box.label, f"{box.score:.0%}", *edges)
        console.print(table)
    if seen.layout is None:
        console.print(f"no layout: {document['no_layout']}", soft_wrap=True)
        return
    console.print(board_text(seen.layout, "layout", gripper=seen.layout.held is not None))
    console.print(f"a block is held with {seen.holding:.0%}", soft_wrap=True)
    console.print(LEGEND, style="dim", soft_wrap=True)
    unsure = [
        f"{block.color} {block.shape} at {tuple(block.cell)} {probability:.0%}"
        for block, probability in zip(seen.layout.blocks, seen.probabilities, strict=True)
        if probability < 0.9
    ]
    said = f"least sure of: {'; '.join(unsure)}" if unsure else "sure of every block (90 % or more)"
    if seen.layout.blocks:
        console.print(said, soft_wrap=True)
