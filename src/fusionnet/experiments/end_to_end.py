"""Ours: what teaches a reader of layouts, its own representation or the arm's error.

The compact FusionNet as one graph from picture and sentence to the fourteen values. The output
layer of its reader forgets which block is where; then everything learns again, by the error of
the arm alone, by the occupancy of the cells alone, or by both.
"""

from dataclasses import replace

import torch

from fusionnet.experiments._experiment import (
    Claim,
    Experiment,
    Figure,
    Outcome,
    Scale,
    Trial,
    Variant,
)
from fusionnet.experiments._vision import CHECKED, pictures_for
from fusionnet.models.end_to_end import EndToEnd
from fusionnet.randomness import derived_seed
from fusionnet.training.end_to_end import (
    LOSS_WEIGHTS,
    EndToEndConfig,
    Representation,
    end_to_end_losses,
    load,
    measure,
)
from fusionnet.training.eye_commands import EyeCommands
from fusionnet.training.loop import LoopConfig, fit

TASK = ("grasp", "place", "holds", "joints")

PICTURES: dict[Scale, tuple[int, int]] = {
    "smoke": (8, 2),
    "small": (1200, 200),
    "thesis": (9000, 1000),
}
"""To learn from, and to measure."""

STEPS: dict[Scale, int] = {"smoke": 1, "small": 120, "thesis": 6000}
BATCH: dict[Scale, int] = {"smoke": 2, "small": 8, "thesis": 16}
READINGS = 4

TAUGHT: dict[str, tuple[tuple[Representation, ...], bool]] = {
    "joints": ((), True),
    "occupancy": (("occupancy",), False),
    "both": (("occupancy",), True),
}
"""Representations with a loss of their own, and whether the arm's error is learnt from."""


def variants(scale: Scale) -> list[Variant]:
    """By the arm's error, by the occupancy, by both."""
    labels = {"joints": "the arm's error alone", "occupancy": "occupancy alone", "both": "both"}
    return [
        Variant(name=name, values={"representations": list(kept), "task": task}, label=labels[name])
        for name, (kept, task) in TAUGHT.items()
    ]


def run(trial: Trial) -> Outcome:
    """Forget, learn again as the variant says, and measure on groups that were not learnt from."""
    torch.set_num_threads(1)
    scale, (kept, task) = trial.scale, TAUGHT[trial.variant.name]
    folder = pictures_for(trial, *PICTURES[scale], (960, 540))
    learnt, checked = EyeCommands(folder, "train"), EyeCommands(folder, CHECKED)
    model = load("compact", readings=READINGS)
    forget(model, trial.seed)
    loop = LoopConfig(
        steps=STEPS[scale],
        learning_rate=5e-4,
        precision="bf16-mixed",
        loss_weights=LOSS_WEIGHTS if task else LOSS_WEIGHTS | dict.fromkeys(TASK, 0.0),
        log_every=max(1, STEPS[scale] // 12),
        save_every=20,
        tensorboard=False,
    )
    config = EndToEndConfig(
        dataset=folder,
        representations=kept,
        readings=READINGS,
        batch=BATCH[scale],
        loop=loop,
        seed=trial.seed,
    )
    history = fit(
        model,
        lambda first: learnt.batches(model.translator, BATCH[scale], trial.seed, first),
        lambda wrapped, batch: end_to_end_losses(wrapped, model, batch, kept),
        loop,
        folder=trial.state,
        settings=config,
        seed=trial.seed,
        progress=trial.progress,
    )
    measured = measure(model, checked, PICTURES[scale][1])
    return Outcome(
        metrics={n: measured[n] for n in ("cells_right", "blocks_right", "joint_mse")},
        configuration={
            "representations": list(kept),
            "task": task,
            "train": len(learnt),
            "measured": int(measured["samples"]),
            "steps": STEPS[scale],
            "batch": BATCH[scale],
            "learning_rate": loop.learning_rate,
            "readings": READINGS,
        },
        curves={
            name: [round(float(line[name]), 5) for line in history] for name in ("step", *TASK[:2])
        },
    )


def forget(model: EndToEnd, seed: int) -> None:
    """Give the reader an output layer that has learnt nothing."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derived_seed(seed, "end to end", "forget"))
        model.detector.occupancy_head.classify.reset_parameters()
    model.detector.config = replace(model.detector.config, temperature=1.0)


EXPERIMENT = Experiment(
    name="end_to_end",
    section="ours",
    title="One graph: what teaches a reader, its representation or the arm",
    question="Can the error of the arm take the place of an intermediate representation's loss?",
    setup="The thesis has no such experiment. It switches losses off in a network whose parts "
    "share nothing but the joints' layer (7.1).",
    differs={
        "smoke": "One step of two pictures: it shows only that it runs.",
        "small": "The shipped policy, the output layer of whose reader begins anew: 120 steps of 8 "
        "pictures of training groups through the robot's left eye with sentences, AdamW, one cycle "
        "up to 5e-4, everything learns; 200 pictures of validation groups are measured.",
        "thesis": "6,000 steps of 16 of 9,000 pictures, 1,000 measured.",
    },
    metric="cells_right",
    lower_is_better=False,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    claims=(
        Claim(
            better="both",
            worse="joints",
            says="With a loss for the occupancy more moves are right than without.",
            source="ours",
        ),
        Claim(
            better="both",
            worse="occupancy",
            says="The arm's error adds to what the occupancy teaches.",
            source="ours",
        ),
        Claim(
            better="occupancy",
            worse="joints",
            says="The occupancy's loss alone teaches the arm more than the arm's own error.",
            source="ours",
        ),
        Claim(
            better="both",
            worse="joints",
            says="With a loss for the occupancy more blocks are read right.",
            metric="blocks_right",
            source="ours",
        ),
    ),
    figures=(
        Figure(y_label="grasp and place cell both right", title="Moves"),
        Figure(metric="blocks_right", y_label="blocks read right", title="Blocks"),
        Figure(
            kind="curves",
            metric="grasp",
            x="step",
            y_label="grasp: training cross-entropy [nats]",
            title="Learning",
        ),
    ),
    caution="The reader's filters were learnt with the occupancy's loss before; what is compared "
    "is how fast its output comes back, not what would be learnt from nothing. The runs of commit "
    "b3b779486df9 were made before two more losses of the reader, `first_look` and `offset`, "
    "joined those of the occupancy. Runs begin with the policy that is shipped at their commit; "
    "that of those has been replaced since.",
)
