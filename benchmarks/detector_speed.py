"""How long the shipped detector takes for a picture, against torchvision's stock RetinaNet.

    python benchmarks/detector_speed.py --threads 2 --out results/detector-speed.json

Both get the same 960x540 picture of the robot's eye: ours from the picture to boxes, camera and
layout; `retinanet_resnet50_fpn_v2` to boxes, once at its own working size (shorter side 800) and
once at the size that ours works at. Its weights are random, which changes no time but that of
the suppression: almost no box passes its threshold. They take turns, so that both meet the same
load of the machine; medians are kept.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import torch
import tyro
from torchvision.models.detection import retinanet_resnet50_fpn_v2

from fusionnet.dataset.layouts import varied_layout
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import weights_folder
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        checkpoint: A shipped name, or a folder that holds the checkpoint `detector`.
        rounds: How often each network sees a picture, after one round that does not count.
        threads: Of PyTorch.
        seed: Of the pictures.
        out: Where to write the numbers; the terminal only by default.
    """

    checkpoint: str = "compact"
    rounds: int = 15
    threads: int = 2
    seed: int = 0
    out: Path | None = None


def main(config: Config) -> None:
    """Measure in turns and print the numbers."""
    torch.set_num_threads(config.threads)
    ours = RetinaNet.from_folder(weights_folder(config.checkpoint) / "detector")
    width, height = ours.frame.input_size
    stock = retinanet_resnet50_fpn_v2(weights=None, weights_backbone=None, num_classes=17).eval()
    small = retinanet_resnet50_fpn_v2(
        weights=None,
        weights_backbone=None,
        num_classes=17,
        min_size=min(width, height),
        max_size=max(width, height),
    ).eval()
    renderer = SceneRenderer("nico", size=ours.frame.eye_size)
    left, top, right, bottom = ours.frame.crop
    spent: dict[str, list[float]] = {"ours": [], "torchvision": [], "torchvision_at_our_size": []}
    for number in range(config.rounds + 1):
        rng = generator(config.seed, "speed", number)
        layout = varied_layout(rng, [], invented=1.0)
        image = renderer.view(layout, appearance=Appearance.sample(rng), labels=False).image
        whole = torch.from_numpy(image).permute(2, 0, 1).float() / 255
        part = whole[:, top:bottom, left:right]
        runs: dict[str, Callable[[], object]] = {
            "ours": lambda image=image: ours.see(image),
            "torchvision": lambda whole=whole: stock([whole]),
            "torchvision_at_our_size": lambda part=part: small([part]),
        }
        for name, run in runs.items():
            with torch.inference_mode():
                began = time.perf_counter()
                run()
                spent[name].append(time.perf_counter() - began)
    milliseconds = {name: round(1000 * median(times[1:]), 1) for name, times in spent.items()}
    parameters = {"ours": ours, "torchvision": stock}
    report = {
        "command": f"python benchmarks/detector_speed.py --threads {config.threads}",
        "milliseconds_a_picture": milliseconds,
        "times_as_fast": {
            name: round(value / milliseconds["ours"], 1)
            for name, value in milliseconds.items()
            if name != "ours"
        },
        "parameters": {n: sum(p.numel() for p in m.parameters()) for n, m in parameters.items()},
        "input": [width, height],
        "rounds": config.rounds,
        "threads": config.threads,
        "seed": config.seed,
        **provenance(),
    }
    text = json.dumps(report, indent=1)
    print(text)
    if config.out is not None:
        config.out.write_text(text + "\n")


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
