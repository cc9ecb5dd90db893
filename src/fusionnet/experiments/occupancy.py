"""Ours: the occupancy of the grid's cells as an intermediate representation of FusionNet.

The thesis has boxes, classes and the tree. Which block is in which cell says what the joints
need more directly, and has never been tried there.
"""

from dataclasses import replace

from fusionnet.experiments._experiment import (
    Claim,
    Experiment,
    Figure,
    Outcome,
    Scale,
    Trial,
    Variant,
)
from fusionnet.experiments._thesis_fusion import DIFFERS, fusion_config, run_fusion

OUTPUTS = {
    "none": (("joints",), "joints alone"),
    "occupancy": (("occupancy", "joints"), "with occupancy"),
    "boxes+classes": (("boxes", "classes", "joints"), "with boxes and classes"),
}
STEPS: dict[Scale, int] = {"smoke": 2, "small": 60, "thesis": 32_000}
EPISODES: dict[Scale, int] = {"smoke": 1, "small": 0, "thesis": 300}


def variants(scale: Scale) -> list[Variant]:
    """With and without the representation, and with the thesis's own of the picture."""
    return [
        Variant(name=name, values={"outputs": list(outputs)}, label=label)
        for name, (outputs, label) in OUTPUTS.items()
    ]


def run(trial: Trial) -> Outcome:
    """Train the whole network with some outputs."""
    outputs = tuple(trial.variant.values["outputs"])
    weights = dict.fromkeys(outputs, 1.0)
    steps = STEPS[trial.scale]
    config = fusion_config(trial, steps=steps, outputs=outputs, loss_weights=weights)
    return run_fusion(trial, replace(config, episodes=EPISODES[trial.scale]))


EXPERIMENT = Experiment(
    name="occupancy",
    section="ours",
    title="Occupancy of the cells as an intermediate representation",
    question="Does saying which block is in which cell help the joints, as boxes are meant to?",
    setup="The thesis's intermediate representations of the picture are boxes and classes (7.1).",
    differs={
        "smoke": DIFFERS["smoke"],
        "small": f"{DIFFERS['small']} Here 60 steps, every loss with the factor 1.",
        "thesis": DIFFERS["thesis"],
    },
    metric="joint_mse",
    lower_is_better=True,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    claims=(
        Claim(
            better="occupancy",
            worse="none",
            says="The occupancy lowers the error of the joints.",
            source="ours",
        ),
        Claim(
            better="occupancy",
            worse="boxes+classes",
            says="The occupancy serves the joints better than boxes and classes.",
            source="ours",
        ),
    ),
    figures=(
        Figure(y_label="validation MSE of the scaled joints", title="Error by representation"),
        Figure(
            kind="curves",
            metric="joints",
            x="step",
            y_label="training MSE of the scaled joints",
            title="Learning by representation",
        ),
    ),
    caution="The tree's loss is off in all three, so the picture's representations are compared "
    "alone. At the small scale nothing has converged.",
)
