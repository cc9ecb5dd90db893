"""How long the shipped policy takes for an answer, stage by stage, on two threads and on one.

    python benchmarks/policy_stages.py --data DIR --out results/policy-stages.json

Every command comes with a picture of its scene in a look of its own, of groups that no network
was trained on, and no sentence twice: its readings are remembered. The ways of measuring take
turns, so that all meet the same load of the machine: by the clock on the wall, on so many
threads, and by the processor's own on one, which is what an idle machine's wall would show. A
stage's number is the median over the commands; the total is the median of whole answers, which
is not the sum of the medians.
"""

import itertools
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
import torch
import tyro

from fusionnet.corpora import load_corpus
from fusionnet.errors import FusionNetError
from fusionnet.files import write_whole
from fusionnet.policy import Kind, load_policy
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, make_world

WARM_UP = 5
"""Answers of each way that do not count."""

CLOCKS = {"wall": time.perf_counter, "processor": time.process_time}


class Way(NamedTuple):
    """Of measuring: on so many threads, by a clock."""

    threads: int
    clock: str


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        data: Folder of the corpus.
        corpus: Where commands and scenes come from.
        split: Part of it.
        policy: `fusion` or `symbolic`.
        checkpoint: A shipped name or a folder of checkpoints.
        answers: So many by each way, after a few that do not count; fewer where the part has no
            more sentences.
        threads: Numbers of PyTorch's threads.
        seed: Of commands and looks.
        out: Where to write the numbers; the terminal only by default.
    """

    data: Path | None = None
    corpus: str = "treebank"
    split: str = "test"
    policy: Kind = "fusion"
    checkpoint: str = "compact"
    answers: int = 100
    threads: tuple[int, ...] = (2, 1)
    seed: int = 0
    out: Path | None = None


def main(config: Config) -> None:
    """Answer in turns, and print medians and quartiles."""
    policy = load_policy(config.checkpoint, config.policy, seed=config.seed)
    commands = load_corpus(config.corpus, config.data).split(config.split)
    order = generator(config.seed, "stages").permutation(len(commands))
    ways = [Way(count, "wall") for count in config.threads] + [Way(1, "processor")]
    spent: dict[Way, list[dict[str, float]]] = {way: [] for way in ways}
    refused, said = 0, set()
    turns = itertools.cycle(ways)
    for number, index in enumerate(order):
        command = commands[index]
        if min(map(len, spent.values())) == config.answers + WARM_UP:
            break
        if command.sentence in said:
            continue
        said.add(command.sentence)
        look = Appearance.sample(generator(config.seed, "look", number))
        image = make_world(layout=command.scene.before, appearance=look).image("left_eye")
        way = next(turns)
        torch.set_num_threads(way.threads)
        try:
            with mock.patch.object(time, "perf_counter", CLOCKS[way.clock]):
                began = time.perf_counter()
                answer = policy(image, command.sentence)
                total = 1000 * (time.perf_counter() - began)
        except FusionNetError:  # what is not understood is refused early: no time of an answer
            refused += 1
            continue
        stages = dict(answer.milliseconds)
        stages["the rest"] = total - sum(stages.values())
        spent[way].append(stages | {"total": total})
    counted = {
        f"{way.threads} thread{'s' if way.threads > 1 else ''}, {way.clock}": rows[
            WARM_UP : WARM_UP + config.answers
        ]
        for way, rows in spent.items()
    }
    report = {
        "command": f"python benchmarks/policy_stages.py --data DIR --answers {config.answers}",
        "milliseconds": {name: _summary(rows) for name, rows in counted.items()},
        "stages": {
            "see": "picture to cells, boxes, camera",
            "read": "sentence to the likely trees",
            "vote": "planner on 64 sampled layouts",
            "fuse": "layout and trees to cells and the fourteen values",
            "the rest": "boxes, likely layout and the answer itself",
        },
        "answers": {name: len(rows) for name, rows in counted.items()},
        "refused": refused,
        "corpus": config.corpus,
        "split": config.split,
        "policy": config.policy,
        "checkpoint": config.checkpoint,
        "seed": config.seed,
        **provenance(),
    }
    text = json.dumps(report, indent=1)
    print(text)
    if config.out is not None:
        write_whole(config.out, text + "\n")


def _summary(rows: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Median and quartiles of every stage."""
    quartiles = {name: np.percentile([row[name] for row in rows], (50, 25, 75)) for name in rows[0]}
    return {
        name: dict(zip(("median", "lower", "upper"), np.round(found, 1).tolist(), strict=True))
        for name, found in quartiles.items()
    }


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
