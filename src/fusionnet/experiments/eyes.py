"""Ours: what a second eye is worth (the thesis looks with the left eye alone).

Each eye has its shipped reader. Commands of the test groups are read by either eye, or by both,
and the planner votes on what was seen, with gold trees.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Int

from fusionnet.blocks import EMPTY, plan
from fusionnet.blocks.voting import vote
from fusionnet.corpora import Command
from fusionnet.experiments._experiment import (
    Claim,
    Experiment,
    Figure,
    Outcome,
    Scale,
    Trial,
    Variant,
)
from fusionnet.experiments._sources import corpus_for
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.sight import Sight
from fusionnet.policy import EYE_WEIGHT, both_seen, weights_folder
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, make_world

LEFT, RIGHT = "left_eye", "right_eye"
EYES = {"left": (LEFT,), "right": (RIGHT,), "both": (LEFT, RIGHT)}
READERS = {LEFT: "detector", RIGHT: "detector-right"}
"""Folder of the shipped reader of each eye."""

COMMANDS: dict[Scale, int] = {"smoke": 2, "small": 80, "thesis": 324}

WEIGHTS = (0.5, 0.625, 0.75, 0.875, 1.0)
"""Exponents of `both_seen` that are compared on validation groups."""

BARELY = 15
"""A block of which the left eye sees fewer pixels than this is hidden from it."""


@dataclass(frozen=True, eq=False)
class Seen:
    """One command's scene before, as eyes saw it.

    Attributes:
        command: Whose scene it is.
        sights: Of each eye.
        cells: Class of each cell in truth.
        visible: Pixels of each block that the left eye sees, by cell; 0 where there is none.
    """

    command: Command
    sights: tuple[Sight, ...]
    cells: Int[np.ndarray, "512"]
    visible: Int[np.ndarray, "512"]


def variants(scale: Scale) -> list[Variant]:
    """Either eye, and both."""
    labels = {"left": "left eye", "right": "right eye", "both": "both eyes"}
    return [
        Variant(name=name, values={"eyes": list(eyes)}, label=labels[name])
        for name, eyes in EYES.items()
    ]


def run(trial: Trial) -> Outcome:
    """Read the seed's commands through the variant's eyes."""
    torch.set_num_threads(1)
    corpus, eyes = corpus_for(trial), trial.variant.values["eyes"]
    shipped = weights_folder("compact")
    look = [(eye, RetinaNet.from_folder(shipped / READERS[eye])) for eye in eyes]
    seen = _look(corpus.split("test"), look, trial, "test")
    details = {}
    if len(eyes) > 1:
        checked = _look(corpus.split("val"), look, trial, "val")
        entropies = [float(np.mean([_cross_entropy(s, w) for s in checked])) for w in WEIGHTS]
        details["validation_cross_entropy_by_weight"] = dict(
            zip(map(str, WEIGHTS), entropies, strict=True)
        )
    blocks = np.concatenate([_right(s)[s.cells != EMPTY] for s in seen])
    shown = np.concatenate([s.visible[s.cells != EMPTY] for s in seen])
    metrics = {
        "layout_right": float(np.mean([_whole(s) for s in seen])),
        "blocks_right": float(blocks.mean()),
        "cells_right": float(np.mean([_moved_right(s, trial.seed) for s in seen])),
    }
    if (hidden := blocks[shown < BARELY]).size:
        metrics["hidden_blocks_right"] = float(hidden.mean())
    return Outcome(
        metrics=metrics,
        configuration={
            "eyes": list(eyes),
            "commands": len(seen),
            "hidden_blocks": int(hidden.size),
            "blocks": len(shown),
            "corpus": corpus.name,
            "weight": EYE_WEIGHT,
        },
        details=details,
    )


def _look(
    commands: Sequence[Command], readers: Sequence[tuple[str, RetinaNet]], trial: Trial, part: str
) -> list[Seen]:
    """Draws commands and looks at their scenes, each in a look of its own."""
    order = generator(trial.seed, "eyes", part).permutation(len(commands))
    count = COMMANDS[trial.scale]
    seen = []
    for number, index in enumerate(order[:count]):
        command = commands[index]
        before = command.scene.before
        rng = generator(trial.seed, "eyes", "look", part, number)
        world = make_world(layout=before, appearance=Appearance.sample(rng))
        sights = tuple(reader.see(world.image(eye)) for eye, reader in readers)
        visible = np.zeros(512, dtype=int)
        visible[[block.cell.index for block in before.blocks]] = world.view(LEFT).visible
        seen.append(Seen(command, sights, before.cell_classes.reshape(512), visible))
        if trial.progress is not None:
            trial.progress(number + 1, min(count, len(commands)))
    return seen


def _cross_entropy(seen: Seen, weight: float) -> float:
    """Of the cells' true classes, added up over a layout [nats]."""
    shares = both_seen(seen.sights, weight).cells.reshape(512, -1)
    return float(-np.log(shares[np.arange(512), seen.cells].clip(1e-9)).sum())


def _right(seen: Seen) -> Bool[np.ndarray, "512"]:
    """Whether the likeliest class of each cell is the true one."""
    guess = both_seen(seen.sights).cells.reshape(512, -1).argmax(-1)
    right: np.ndarray = guess == seen.cells
    return right


def _whole(seen: Seen) -> bool:
    """Whether all cells are read right."""
    return bool(_right(seen).all())


def _moved_right(seen: Seen, seed: int) -> bool:
    """Whether the planner's vote elects the move that was asked for."""
    sight, tree = both_seen(seen.sights), seen.command.tree
    rng = generator(seed, "eyes", "vote")
    wanted = plan(tree, seen.command.scene.before)
    return vote(sight.cells, sight.holding, [(tree, 1.0)], rng).move == wanted


EXPERIMENT = Experiment(
    name="eyes",
    section="ours",
    title="Eyes: reading the layout with the left, the right, or both",
    question="What does a second eye add to reading a layout, and to doing what was said?",
    setup="The thesis's robot looks with its left eye alone.",
    differs={
        "smoke": "Two commands: it shows only that it runs.",
        "small": "80 commands of the test groups a seed.",
        "thesis": "Every test command.",
    },
    metric="layout_right",
    lower_is_better=False,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    claims=(
        Claim(
            better="both",
            worse="left",
            says="Two eyes read more layouts without a fault than the left eye.",
            source="ours",
        ),
        Claim(
            better="both",
            worse="left",
            says="Two eyes read more of the blocks that are hidden from the left one.",
            metric="hidden_blocks_right",
            source="ours",
        ),
        Claim(
            better="both",
            worse="left",
            says="Two eyes find the right cells for more commands.",
            metric="cells_right",
            source="ours",
        ),
    ),
    figures=(
        Figure(y_label="share of layouts read without a fault", title="Whole layouts"),
        Figure(
            metric="hidden_blocks_right",
            y_label="share of hidden blocks read right",
            title="Blocks of which the left eye sees fewer than 15 pixels",
        ),
        Figure(
            metric="cells_right",
            y_label="share of commands with both cells right",
            title="Commands",
        ),
    ),
    caution="The two readers are no equals: the right one began with the weights of the left one, "
    "learnt for less long, and looks from farther beside the middle of the board. Some of what two "
    "readers gain, any two would.",
)
