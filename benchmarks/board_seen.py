"""From which evidence on a board is taken to be seen: what `fusionnet detect` decides by.

    python benchmarks/board_seen.py --data DIR

Boards are rendered through the robot's eye, half of them with recorded layouts of the validation
groups and half with invented, often crowded ones; pictures in which the eye's board is not are
drawn views, most of which show a board of another kind from elsewhere.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from jaxtyping import UInt8

from fusionnet.blocks import Layout
from fusionnet.corpora import load_corpus
from fusionnet.dataset.layouts import varied_layout
from fusionnet.models.look import look
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import detector_folder
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.views import drawn_view

THRESHOLDS = (0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6)


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to look at.

    Attributes:
        data: Folder of the treebank.
        boards: How many pictures with the board.
        others: How many without.
        checkpoint: A shipped name, or a folder that holds the checkpoint `detector`.
        seed: Of layouts, looks and views.
    """

    data: Path
    boards: int = 150
    others: int = 300
    checkpoint: str = "compact"
    seed: int = 0


def main(config: Config) -> None:
    """Measure, and print one JSON object."""
    torch.set_num_threads(1)
    model = RetinaNet.from_folder(detector_folder(config.checkpoint))
    renderer = SceneRenderer("nico", size=model.frame.eye_size)
    recorded = [c.scene.before for c in load_corpus("treebank", config.data).split("val")]
    boards, others = [], []
    for number in range(config.boards):
        rng = generator(config.seed, "board", number)
        layout: Layout = varied_layout(rng, [], invented=1.0)
        if number % 2:
            layout = recorded[int(rng.integers(len(recorded)))]
        view = renderer.view(layout, appearance=Appearance.sample(rng), labels=False)
        boards.append(_evidence(model, view.image))
    for number in range(config.others):
        drawn = drawn_view(generator(config.seed, "other", number), model.frame.eye_size)
        others.append(_evidence(model, drawn.image))
    report = {
        "command": "python benchmarks/board_seen.py --data DIR",
        "boards": config.boards,
        "others": config.others,
        "thresholds": [
            {
                "evidence": least,
                "boards_overlooked": int((np.array(boards) < least).sum()),
                "others_taken_for_one": int((np.array(others) >= least).sum()),
            }
            for least in THRESHOLDS
        ],
        **provenance(),
    }
    print(json.dumps(report, indent=1))


def _evidence(model: RetinaNet, image: UInt8[np.ndarray, "h w 3"]) -> float:
    return look(model, image).board or 0.0


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
