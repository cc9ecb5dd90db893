"""Ours: ways of fusing what was seen with what was said, in the thesis's FusionNet.

The thesis concatenates the nodes of both modules and names attention between them as future
work (7.5, chapter 8).
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

FUSERS = {
    "concatenate": "concatenation (thesis)",
    "kronecker": "Kronecker product",
    "attention": "attention",
}
STEPS: dict[Scale, int] = {"smoke": 2, "small": 60, "thesis": 32_000}
EPISODES: dict[Scale, int] = {"smoke": 1, "small": 0, "thesis": 300}


def variants(scale: Scale) -> list[Variant]:
    """One a fuser."""
    return [Variant(name=n, values={"fuser": n}, label=label) for n, label in FUSERS.items()]


def run(trial: Trial) -> Outcome:
    """Train the whole network with one fuser."""
    steps, fuser = STEPS[trial.scale], trial.variant.values["fuser"]
    config = fusion_config(trial, steps=steps, fuser=fuser)
    return run_fusion(trial, replace(config, episodes=EPISODES[trial.scale]))


def _better(name: str) -> Claim:
    return Claim(
        better=name,
        worse="concatenate",
        says=f"{FUSERS[name].capitalize()} beats concatenation.",
        source="ours",
    )


EXPERIMENT = Experiment(
    name="fusers",
    section="ours",
    title="Fusers: how the two modalities are brought together",
    question="Does a fuser in which the sentence can choose among what is seen do better?",
    setup="The thesis concatenates the nodes of RetinaNet and of the Transformer and reads the "
    "joints off them by one sigmoid layer (4.3); it expects attention to help (7.5).",
    differs={
        "smoke": DIFFERS["smoke"],
        "small": f"{DIFFERS['small']} Here 60 steps, all four losses with the factor 1.",
        "thesis": DIFFERS["thesis"],
    },
    metric="joint_mse",
    lower_is_better=True,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    claims=(_better("attention"), _better("kronecker")),
    figures=(
        Figure(y_label="validation MSE of the scaled joints", title="Error by fuser"),
        Figure(
            kind="curves",
            metric="joints",
            x="step",
            y_label="training MSE of the scaled joints",
            title="Learning by fuser",
        ),
    ),
    caution="At the small scale no fuser has converged; it compares how fast they begin. The tree "
    "executor of the compact FusionNet reads other inputs and so is not among them.",
)
