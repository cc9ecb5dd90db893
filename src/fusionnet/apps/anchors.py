"""`fusionnet anchors DATASET`: which boxes a detector should start from (thesis 6.1)."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from fusionnet.apps.progress import Bar, bars
from fusionnet.dataset.framing import whole_frame
from fusionnet.errors import InputError, OutputError
from fusionnet.models.anchors import (
    THESIS_MEAN_IOU,
    ClusterConfig,
    Clusters,
    k_medians,
    mean_iou,
    pyramid_anchors,
    thesis_anchors,
)
from fusionnet.report.anchors import draw_clusters, save_drawing
from fusionnet.training.placement_pictures import box_sides

PARTS = {"whole": False, "cropped": True}
"""The pictures as they are (figure 6.1), and cropped to the placement region (figure 6.2)."""


@dataclass(frozen=True, kw_only=True)
class AnchorsConfig:
    """Whose boxes, and how they are clustered."""

    dataset: tyro.conf.Positional[Path]
    """A data set that `fusionnet dataset build` made."""
    split: str = "train"
    """Which split."""
    size: tuple[int, int] = (990, 540)
    """Width and height of the network's input, in pixels: the unit of all boxes."""
    clusters: int = 9
    """Shapes to find."""
    repetitions: int = 10
    """Starts from other boxes; the best is kept."""
    iterations: int = 100
    """After which a repetition stops anyway."""
    seed: int = 0
    """Of the boxes that the repetitions start from."""
    out: Path | None = None
    """Folder for the figures, anchors-whole.png and anchors-cropped.png."""
    json: bool = False
    """Print one JSON object instead of the table."""

    def __post_init__(self) -> None:
        """Refuse sizes without pictures."""
        if not all(32 <= side <= 4096 for side in self.size):
            raise InputError(f"A picture has 32 to 4096 pixels a side; received {self.size}.")


def anchors(config: AnchorsConfig) -> None:
    """Cluster a data set's boxes by k-medians under IoU, and derive a detector's anchors.

    Once on the whole pictures and once cropped to where blocks can be placed. Says how well
    the clusters cover the boxes, beside the thesis's, and which sizes, ratios and scales a
    detector should be given.
    """
    how = ClusterConfig(
        clusters=config.clusters,
        repetitions=config.repetitions,
        iterations=config.iterations,
        seed=config.seed,
    )
    files = {part: config.out / f"anchors-{part}.png" for part in PARTS} if config.out else {}
    if config.out and config.out.exists() and not config.out.is_dir():
        raise OutputError(f"{config.out} is a file; name a folder (--out).")
    found, drawings = {}, {}
    with bars() as bar:
        for part in PARTS:
            sides, clusters, found[part] = _measure(config, how, part, bar)
            if part in files:
                title = f"{config.split} pictures, {part}, {len(sides)} boxes"
                drawings[part] = draw_clusters(title, clusters)
    for part, drawing in drawings.items():
        save_drawing(drawing, files[part])
    if config.json:
        print(json.dumps({"dataset": str(config.dataset), "split": config.split, **found}))
    else:
        _show(config, found)


def _measure(
    config: AnchorsConfig, how: ClusterConfig, part: str, bar: Callable[[str], Bar]
) -> tuple[np.ndarray, Clusters, dict[str, Any]]:
    """The boxes of one part, their clusters, and all that is said of them."""
    frame = whole_frame(config.size, config.size)
    sides = np.concatenate(
        box_sides(
            config.dataset,
            config.split,
            frame,
            crop=PARTS[part],
            progress=bar(f"boxes, {part}"),
        )
    )
    began = time.perf_counter()
    clusters = k_medians(sides, how, progress=bar(f"clusters, {part}"))
    seconds = time.perf_counter() - began
    pyramid = pyramid_anchors(clusters.shapes)
    return (
        sides,
        clusters,
        {
            "boxes": len(sides),
            "mean_iou": round(clusters.mean_iou, 4),
            "thesis_mean_iou": THESIS_MEAN_IOU[part],
            "points_above_the_thesis": round(100 * (clusters.mean_iou - THESIS_MEAN_IOU[part]), 2),
            "clusters": clusters.shapes.round(2).tolist(),
            "iterations": [len(curve) for curve in clusters.curves],
            "seconds": round(seconds, 3),
            "anchors": asdict(pyramid),
            "mean_iou_of_these_anchors": round(mean_iou(sides, pyramid.shapes()), 4),
            "mean_iou_of_the_thesis_anchors": round(mean_iou(sides, thesis_anchors().shapes()), 4),
        },
    )


def _show(config: AnchorsConfig, found: dict[str, dict[str, Any]]) -> None:
    """Both parts side by side."""
    table = Table(title=f"anchors of {config.dataset}, {config.split}", title_justify="left")
    table.add_column("")
    for part in found:
        table.add_column(f"{part} pictures")

    def row(name: str, say: Callable[[dict[str, Any]], str]) -> None:
        table.add_row(name, *(say(values) for values in found.values()))

    row("boxes", lambda v: str(v["boxes"]))
    row("mean IoU with the nearest cluster", lambda v: f"{v['mean_iou']:.2%}")
    row("the thesis's, on its own pictures", lambda v: f"{v['thesis_mean_iou']:.2%}")
    row("clusters [px]", lambda v: "\n".join(f"{w:g} x {h:g}" for w, h in v["clusters"]))
    row("iterations of each repetition", lambda v: " ".join(map(str, v["iterations"])))
    row("seconds for all repetitions", lambda v: f"{v['seconds']:.3g}")
    row("sizes of the levels [px]", lambda v: _numbers(v["anchors"]["sizes"]))
    row("ratios, height : width", lambda v: _numbers(v["anchors"]["ratios"]))
    row("scales", lambda v: _numbers(v["anchors"]["scales"]))
    row("mean IoU of these anchors", lambda v: f"{v['mean_iou_of_these_anchors']:.2%}")
    row("of the thesis's anchors", lambda v: f"{v['mean_iou_of_the_thesis_anchors']:.2%}")
    console = Console(highlight=False)
    console.print(table, soft_wrap=not console.is_terminal)


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
