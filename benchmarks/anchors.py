"""How fast anchors are found, against a plain loop over boxes and against whole arrays of boxes.

    python benchmarks/anchors.py --data FOLDER_OF_THE_TREEBANK

Boxes are those of rendered pictures, drawn again with a few pixels' change until there are as
many as 30,000 pictures have. The plain loop would take an hour, so all are compared by the time
of one iteration, one way after the other; ours is also timed for ten whole repetitions.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from fusionnet.corpora import load_corpus
from fusionnet.models.anchors import ClusterConfig, k_medians
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        images: Pictures whose boxes are clustered.
        rendered: Pictures that are really rendered.
        corpus: Where their layouts come from.
        data: Folder of the corpus's files.
        loop_boxes: Boxes of the plain loop, whose time grows in proportion.
        seed: Everything random derives from it.
    """

    images: int = 30_000
    rendered: int = 150
    corpus: str = "treebank"
    data: Path | None = None
    loop_boxes: int = 20_000
    seed: int = 0


def boxes(config: Config) -> np.ndarray:
    """Widths and heights in whole pixels of as many boxes as the pictures have."""
    renderer = SceneRenderer("nico", size=(990, 540))
    scenes = [c.scene for c in load_corpus(config.corpus, config.data).split("train")]
    layouts = list({id(s.before): s.before for s in scenes}.values())
    sides, rng = [], generator(config.seed, "benchmark")
    for _ in range(config.rendered):
        layout = layouts[int(rng.integers(len(layouts)))]
        view = renderer.view(layout, camera="left_eye", appearance=Appearance.sample(rng))
        corners = view.boxes[view.visible[view.indices] >= 12]
        sides.append(corners[:, 2:] - corners[:, :2])
    found = np.concatenate(sides).astype(float)
    many = len(found) * config.images // config.rendered
    drawn = found[rng.integers(len(found), size=many)]
    scale = rng.uniform(0.8, 1.2, many)[:, None]  # views differ in distance
    return np.maximum(np.rint(drawn * scale + rng.integers(-2, 3, drawn.shape)), 1.0)


def loop_iteration(sides: np.ndarray, clusters: np.ndarray) -> None:
    """Box by box, as the source that the thesis names does it."""
    overlaps = np.empty((len(sides), len(clusters)))
    for row, (width, height) in enumerate(sides):
        shared = np.minimum(width, clusters[:, 0]) * np.minimum(height, clusters[:, 1])
        overlaps[row] = shared / (width * height + clusters.prod(1) - shared)
    _medians(sides, overlaps.argmax(1), clusters)


def array_iteration(sides: np.ndarray, clusters: np.ndarray) -> None:
    """All boxes at once, each as often as it occurs."""
    shared = np.minimum(sides[:, None], clusters).prod(-1)
    overlaps = shared / (sides.prod(-1)[:, None] + clusters.prod(-1) - shared)
    _medians(sides, overlaps.argmax(1), clusters)


def _medians(sides: np.ndarray, nearest: np.ndarray, clusters: np.ndarray) -> None:
    for cluster in range(len(clusters)):
        np.median(sides[nearest == cluster], axis=0)


def compare(sides: np.ndarray, config: Config) -> dict[str, Any]:
    """Seconds of an iteration for all boxes, and of ours for ten repetitions."""
    clusters = sides[generator(config.seed, "start").choice(len(sides), 9, replace=False)]
    part = sides[: config.loop_boxes]
    begin = time.process_time()
    found = k_medians(sides, ClusterConfig(seed=config.seed))
    ten = time.process_time() - begin
    iterations = sum(map(len, found.curves))
    seconds = {"ours": ten / iterations}
    begin = time.process_time()
    array_iteration(sides, clusters)
    seconds["arrays"] = time.process_time() - begin
    begin = time.process_time()
    loop_iteration(part, clusters)
    seconds["plain_loop"] = (time.process_time() - begin) * len(sides) / len(part)
    return {
        "boxes": len(sides),
        "shapes": len(np.unique(sides, axis=0)),
        "iterations_of_ten_repetitions": iterations,
        "seconds_of_ten_repetitions": round(ten, 3),
        "seconds_of_an_iteration": {n: round(s, 5) for n, s in seconds.items()},
        "times_as_fast": {n: round(s / seconds["ours"], 1) for n, s in seconds.items()},
        "mean_iou": round(found.mean_iou, 4),
    }


def main(config: Config) -> None:
    around = {"images": config.images, "seed": config.seed, **provenance()}
    sides = boxes(config)
    noised = sides * generator(config.seed, "noise").uniform(0.9, 1.1, sides.shape)
    for name, given in (("whole pixels", sides), ("fractions of pixels", noised)):
        print(json.dumps({"part": name, **compare(given, config), **around}), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Config))
