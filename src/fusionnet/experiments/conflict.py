"""Ours: how the gradients of the losses lie to each other, which the thesis guessed at (7.2.2).

A variant is a pair of losses. One training a seed measures all pairs of a network; the
others read what it wrote.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
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
from fusionnet.experiments._fusion import fusion_config as compact_config
from fusionnet.experiments._fusion import train_fusion
from fusionnet.experiments._locks import alone
from fusionnet.experiments._sources import corpus_for
from fusionnet.experiments._thesis_fusion import DIFFERS, fusion_config
from fusionnet.files import write_whole
from fusionnet.models.fusionnet import compact
from fusionnet.training.conflict import gradient_cosines, shared_parameters
from fusionnet.training.loop import fit
from fusionnet.training.thesis_fusion import examples_of, new_model

STEPS: dict[Scale, int] = {"smoke": 2, "small": 40, "thesis": 32_000}
EVERY: dict[Scale, int] = {"smoke": 1, "small": 4, "thesis": 500}
COMPACT_STEPS: dict[Scale, int] = {"smoke": 2, "small": 40, "thesis": 2000}
COMPACT_BATCH: dict[Scale, int] = {"smoke": 4, "small": 32, "thesis": 64}

LOSSES = {
    "thesis": ("joints", "boxes", "classes", "tree"),
    "compact": ("grasp", "place", "joints"),
}
"""The losses of each network that could share parameters."""

NOTHING_SHARED = "thesis-boxes-tree"
"""This pair shares no parameter, so that its cosine is 0: what the others are compared with."""


def variants(scale: Scale) -> list[Variant]:
    """One a pair of losses of a network."""
    return [
        Variant(
            name=f"{network}-{one}-{other}",
            values={"network": network, "pair": [one, other]},
            label=f"{one} and {other} ({network})",
        )
        for network, losses in LOSSES.items()
        for one, other in combinations(losses, 2)
    ]


class Cosines:
    """Losses of a network that are looked at every few steps.

    Args:
        network: Whose parameters are looked at.
        names: Of the losses that are looked at.
        every: Steps between looks.
    """

    def __init__(self, network: torch.nn.Module, names: tuple[str, ...], every: int) -> None:
        self.network, self.names, self.every = network, names, every
        self.steps: list[int] = []
        self.found: dict[str, list[float]] = {}
        self.shared: dict[str, int] = {}
        self._step = 0

    def __call__(self, wrapped: Any, batch: Any, losses: Callable[..., Any]) -> Mapping[str, Any]:
        """The losses of a batch, after a look at their gradients if one is due."""
        named: Mapping[str, torch.Tensor] = losses(wrapped, batch)
        if self._step % self.every == 0:
            some = {name: named[name] for name in self.names}
            parameters = [p for p in self.network.parameters() if p.requires_grad]
            if not self.shared:
                counts = shared_parameters(some, parameters)
                self.shared = {"-".join(pair): count for pair, count in counts.items()}
            cosines = gradient_cosines(some, parameters)
            self.steps.append(self._step + 1)
            for pair in combinations(self.names, 2):
                self.found.setdefault("-".join(pair), []).append(cosines.get(pair, 0.0))
        self._step += 1
        return named

    def as_json(self) -> dict[str, Any]:
        """What was found."""
        return {"steps": self.steps, "cosines": self.found, "shared": self.shared}


def run(trial: Trial) -> Outcome:
    """One pair's cosines over a training, which is made if no other pair has made it."""
    network = trial.variant.values["network"]
    file = trial.shared / f"{network}-seed{trial.seed}.json"
    with alone(trial.work, file.relative_to(trial.work)):
        if not file.is_file():
            measure = _thesis if network == "thesis" else _compact
            write_whole(file, json.dumps(measure(trial).as_json()))
    measured = json.loads(file.read_text("utf-8"))
    pair = "-".join(trial.variant.values["pair"])
    cosines = measured["cosines"][pair]
    return Outcome(
        metrics={
            "cosine": float(np.mean(cosines)),
            "share_below_zero": float(np.mean(np.array(cosines) < 0)),
            "shared_parameters": float(measured["shared"][pair]),
        },
        configuration={
            "steps": (STEPS if network == "thesis" else COMPACT_STEPS)[trial.scale],
            "every": EVERY[trial.scale],
        },
        curves={
            "step": [float(step) for step in measured["steps"]],
            "cosine": [round(value, 4) for value in cosines],
        },
    )


def _thesis(trial: Trial) -> Cosines:
    """Train the thesis's FusionNet with all losses alike."""
    config = fusion_config(trial, steps=STEPS[trial.scale])
    torch.set_num_threads(1)
    model = new_model(config)
    learnt = examples_of(config, "train", model.config.detector.frame)

    def batches(first: int) -> Iterator[Any]:
        for examples in learnt.batches(
            model,
            config.batch,
            first,
            config.seed,
            sentences=config.noised_sentences,
            pictures=config.noised_pictures,
        ):
            yield model.batch_of(examples)

    cosines = Cosines(model, LOSSES["thesis"], EVERY[trial.scale])
    fit(
        model,
        batches,
        lambda wrapped, batch: cosines(wrapped, batch, lambda n, b: n.losses(b)),
        replace(config.loop, loss_weights=dict.fromkeys(LOSSES["thesis"], 1.0)),
        seed=config.seed,
        progress=trial.progress,
    )
    return cosines


def _compact(trial: Trial) -> Cosines:
    """Train the compact FusionNet's fusion with its own weights."""
    scale = trial.scale
    config = compact_config(COMPACT_STEPS[scale], trial.seed, COMPACT_BATCH[scale])
    model = compact(config.robot)
    cosines = Cosines(model, LOSSES["compact"], EVERY[scale])
    learnt = corpus_for(trial).split("train")
    train_fusion(
        learnt,
        config,
        trial,
        model,
        lambda wrapped, batch: cosines(wrapped, batch, lambda n, b: n.losses(*b)),
        resumed=False,  # the cosines of the steps before would be lost
    )
    return cosines


def _against(pair: str, says: str, source: Any = "ours") -> Claim:
    return Claim(better=pair, worse=NOTHING_SHARED, says=says, source=source)


EXPERIMENT = Experiment(
    name="conflict",
    section="ours",
    title="Conflict: cosines between the gradients of the losses",
    question="Do the losses pull the parameters that they share in opposite directions?",
    setup="The thesis deduces from its errors that the Transformer's loss and RetinaNet's "
    "regression loss act against each other (7.2.2, destructive interference), and did not look "
    "at gradients.",
    differs={
        "smoke": "Two steps: it shows only that it runs.",
        "small": f"{DIFFERS['small']} Here 40 steps with the factor 1 for every loss, a look at "
        "every fourth batch; the compact FusionNet's fusion over 40 steps of 32 examples.",
        "thesis": f"{DIFFERS['thesis']} A look at every 500th batch; the compact FusionNet's "
        "fusion over 2000 steps.",
    },
    metric="cosine",
    lower_is_better=True,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 3},
    claims=(
        _against("thesis-joints-boxes", "Joints and boxes act against each other.", "thesis"),
        _against("thesis-joints-tree", "Joints and tree act against each other.", "thesis"),
        _against("thesis-joints-classes", "Joints and classes act against each other."),
        _against("thesis-boxes-classes", "Boxes and classes act against each other."),
        _against("compact-grasp-place", "In the compact network grasp and place do."),
        _against("compact-grasp-joints", "In the compact network grasp and joints do."),
        _against("compact-place-joints", "In the compact network place and joints do."),
    ),
    figures=(
        Figure(
            y_label="mean cosine of the gradients (below 0: conflict)",
            title="Mean cosine at the parameters that both losses reach",
        ),
        Figure(
            kind="curves",
            metric="cosine",
            x="step",
            y_label="cosine of the gradients",
            title="Cosine over the training",
        ),
        Figure(
            metric="share_below_zero",
            y_label="share of batches with a cosine below 0",
            title="How often they conflict",
        ),
    ),
    caution="A claim here is judged against a cosine of 0. In the thesis's network the tree's loss "
    "reaches only the Transformer, and those of boxes and classes only RetinaNet: they share no "
    "parameter, their cosine is 0 by construction, and the interference between them that the "
    "thesis deduces cannot be one of gradients; it can only go through the joints' loss.",
)
