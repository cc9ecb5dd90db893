"""What keeps the boxes that a layout explains from being exact: cells, camera or offsets.

    python benchmarks/box_ceiling.py --data DIR --pictures 40

Pictures of one part of the treebank are read; then cells, camera and offsets of the blocks are
put in as they are in truth, one after the other, and the boxes are drawn anew. What is left with
all three true is the drawing's own error.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro

from fusionnet.blocks import EMPTY
from fusionnet.corpora import Part, load_corpus
from fusionnet.dataset.pictures import label
from fusionnet.models.labelled_boxes import Boxes, BoxPrecision
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import detector_folder
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.training.detector_batches import collate


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to look at.

    Attributes:
        data: Folder of the treebank.
        split: Its part.
        pictures: How many.
        checkpoint: A shipped name, or a folder that holds the checkpoint `detector`.
        seed: Of the looks.
    """

    data: Path
    split: Part = "val"
    pictures: int = 40
    checkpoint: str = "compact"
    seed: int = 7


@torch.inference_mode()
def main(config: Config) -> None:
    """Measure, and print one JSON object."""
    torch.set_num_threads(1)
    model = RetinaNet.from_folder(detector_folder(config.checkpoint))
    frame = model.frame
    scenes = [c.scene for c in load_corpus("treebank", config.data).split(config.split)]
    layouts = list({id(layout): layout for s in scenes for layout in (s.before, s.after)}.values())
    renderer = SceneRenderer("nico", size=frame.eye_size)
    found: dict[str, BoxPrecision] = {}
    off: dict[str, list[float]] = {"estimated": [], "put right": []}
    for index in range(config.pictures):
        look = Appearance.sample(generator(config.seed, "detection", config.split, index))
        picture, truth = label(renderer, layouts[index % len(layouts)], look, frame)
        outputs = model(torch.from_numpy(picture)[None], refine=True)
        logits = outputs["cells"].logits[0].double() / model.config.temperature
        batch, estimated = collate([(picture, truth)]), outputs["used_pose"]
        camera = model.pose_head.target(batch.matrix, batch.camera_from_board)
        for name, pose in zip(off, (outputs["pose"][-1], estimated), strict=True):
            off[name].append(float(model.pose_head.metric([pose], camera)[0]))
        read, offsets = logits.softmax(-1).numpy(), outputs["cells"].offsets
        true, beside = np.eye(EMPTY + 1)[truth.cells], model.offsets(camera, camera, batch)
        wanted = batch.boxes[0]
        for name, cells, pose, moved in (
            ("read", read, estimated, offsets),
            ("read, blocks in the middle", read, estimated, None),
            ("true cells", true, estimated, offsets),
            ("true cells and camera, blocks in the middle", true, camera, None),
            ("true cells, camera and offsets", true, camera, beside),
        ):
            drawn = model.explained(cells, pose, moved)
            xyxy = torch.from_numpy(frame.to_input(drawn.xyxy.double().numpy()))
            boxes = Boxes(xyxy, drawn.classes, drawn.scores)
            found.setdefault(name, BoxPrecision()).update(boxes, wanted)
    numbers: dict[str, Any] = {name: precision.compute() for name, precision in found.items()}
    report = {
        "command": f"python benchmarks/box_ceiling.py --data DIR --pictures {config.pictures}",
        "split": config.split,
        "n": config.pictures,
        "camera_pixels_off": {name: round(float(np.mean(o)), 3) for name, o in off.items()},
        "precision": {
            name: {key: value[key] for key in ("map_50", "map_50_95")}
            for name, value in numbers.items()
        },
        **provenance(),
    }
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
