"""The thesis's FusionNet as several experiments train it: the same set, small and quick."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.sources import Sources
from fusionnet.experiments._experiment import Outcome, Scale, Trial
from fusionnet.experiments._fusion import curves_of
from fusionnet.experiments._locks import alone
from fusionnet.experiments._sources import corpus_for
from fusionnet.models.anchors import AnchorShapes
from fusionnet.training.thesis_fusion import run
from fusionnet.training.thesis_fusion_config import (
    SmallThesisFusionConfig,
    ThesisFusionConfig,
)

SAMPLES: Mapping[Scale, str] = {"smoke": "smoke", "small": "4000", "thesis": "thesis"}
STEPS: Mapping[Scale, int] = {"smoke": 2, "small": 120, "thesis": 32_000}
CHECKED: Mapping[Scale, int] = {"smoke": 4, "small": 150, "thesis": 500}
EPISODES: Mapping[Scale, int] = {"smoke": 2, "small": 20, "thesis": 300}

INPUT_SIZE = (112, 62)
ANCHORS = AnchorShapes(sizes=(4.0, 6.5, 10.0, 12.5, 17.0), ratios=(17 / 20, 1.0, 11 / 10))
"""Pictures of every scale but the thesis's, in pixels, and the anchors for their blocks."""

DIFFERS: Mapping[Scale, str] = {
    "smoke": "Commands of our own, 2 steps: it shows only that it runs.",
    "small": "Pictures of 112 x 62 pixels through the robot's left eye instead of 990 x 540 "
    "overlays, a tiny backbone, pyramid and subnets of 32 channels, two layers in the "
    "Transformer, the tree's values (about 9 tokens) instead of its text; 120 steps of 16 "
    "samples with the rate 1e-3 instead of 32,000 of one with 1e-5. 4,000 pictures of recorded "
    "layouts and sentences of the training groups, none moved by level-two noise; measured on "
    "groups not learnt from.",
    "thesis": "ResNet-152, 990 x 540, the tree's text, 32,000 steps of one sample, as in the "
    "thesis; pictures through the robot's eyes unless views are given to the data set.",
}


def fusion_set(trial: Trial) -> Path:
    """The data set of all these experiments at a scale, built by one process; others wait.

    Raises:
        DataError: If the treebank is needed and was not given.
        InputError: If the folder holds a data set of another plan.
    """
    folder = trial.work / "fusion-set"
    with alone(trial.work, folder.relative_to(trial.work)):
        corpus = corpus_for(trial).name
        sources = Sources(data=trial.data)
        size = (160, 90) if trial.scale == "smoke" else (480, 270)
        if trial.scale == "thesis":
            size = (960, 540)
        plan = plan_for(SAMPLES[trial.scale], corpus, sources, size=size, quality=85)
        build(folder, plan, sources, progress=trial.progress)
    return folder


def fusion_config(trial: Trial, **changes: Any) -> ThesisFusionConfig:
    """The recipe at a trial's scale.

    Args:
        trial: To be run.
        changes: Of the recipe; `loss_weights`, `steps` and `nodes` are those of its parts.
    """
    kind = ThesisFusionConfig if trial.scale == "thesis" else SmallThesisFusionConfig
    config: ThesisFusionConfig = kind(dataset=fusion_set(trial))
    steps = int(changes.pop("steps", STEPS[trial.scale]))
    loop = replace(
        config.loop,
        steps=steps,
        schedule=replace(config.loop.schedule, check_every=max(1, steps // 10)),
        log_every=max(1, steps // 10),
        save_every=100,
        tensorboard=False,
    )
    if trial.scale == "thesis":
        loop = replace(config.loop, steps=steps, tensorboard=False)
    if "loss_weights" in changes:
        loop = replace(loop, loss_weights=changes.pop("loss_weights"))
    sizes = config.sizes
    if trial.scale != "thesis":
        sizes = replace(sizes, input_size=INPUT_SIZE, anchors=ANCHORS)
    if trial.scale == "smoke":
        sizes = replace(sizes, pyramid_width=16, subnet_depth=1, layers=1)
    if "nodes" in changes:
        sizes = replace(sizes, nodes=int(changes.pop("nodes")))
    chosen: dict[str, Any] = {
        "work": trial.state,
        "sizes": sizes,
        "check": ("sim_val",),
        "checked": CHECKED[trial.scale],
        "episodes": EPISODES[trial.scale],
        "batch": 4 if trial.scale == "smoke" else config.batch,
        "loop": loop,
        "noised_pictures": trial.scale == "thesis",
        "seed": trial.seed,
        "threads": 0 if trial.scale == "thesis" else 1,
    }
    return replace(config, **(chosen | changes))


def run_fusion(trial: Trial, config: ThesisFusionConfig) -> Outcome:
    """Train and measure: the numbers of the first split that is checked, all in the details."""
    _, history, measured = run(config, progress=trial.progress)
    first = measured[config.check[0]]
    described = asdict(config)
    for name in ("dataset", "out", "work", "detector", "translator"):
        described.pop(name)
    return Outcome(
        metrics={k: float(v) for k, v in first.items() if k not in ("samples", "episodes")},
        configuration=described,
        curves=curves_of(history),
        details={"measured": measured},
    )
