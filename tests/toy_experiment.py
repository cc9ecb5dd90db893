"""An experiment that takes no time: a straight line with a little noise by seed."""

import os
import sys
import time
from pathlib import Path

import optuna

from fusionnet.experiments import (
    Claim,
    Experiment,
    Outcome,
    Plan,
    Published,
    Search,
    Trial,
    Variant,
    proposal_name,
    reproduce,
)
from fusionnet.randomness import generator

SLOW = float(os.environ.get("TOY_SECONDS", "0"))


def variants(scale: str) -> list[Variant]:
    return [Variant(name=f"x{x}", values={"x": x}) for x in (1, 2, 3)]


def propose(trial: optuna.Trial) -> Variant:
    values = {"x": round(trial.suggest_float("x", 0.0, 5.0), 3)}
    return Variant(name=proposal_name(values), values=values)


def run(trial: Trial) -> Outcome:
    trial.work.mkdir(parents=True, exist_ok=True)
    with (trial.work / "made.txt").open("a") as made:
        made.write(f"{trial.variant.name} {trial.seed}\n")
    time.sleep(SLOW)
    noise = generator(trial.seed, "toy").normal(0, 0.1)
    x = trial.variant.values["x"]
    return Outcome(metrics={"error": (x - 2.0) ** 2 + noise}, curves={"loss": [1.0, 0.5]})


def toy(*, trials: int = 0) -> Experiment:
    return Experiment(
        name="toy",
        section="none",
        title="a parabola",
        question="Where is it least?",
        setup="None.",
        differs={},
        metric="error",
        lower_is_better=True,
        variants=variants,
        run=run,
        seeds={"smoke": 2, "small": 5, "thesis": 5},
        published=(Published(variant="x2", metric="error", mean=0.0, where="nowhere"),),
        claims=(
            Claim(better="x2", worse="x1", says="Two is better than one."),
            Claim(better="x1", worse="x2", says="One is better than two."),
            Claim(better="x1", worse="x3", says="One is better than three."),
        ),
        search=Search(trials={"smoke": trials, "small": trials, "thesis": 35}, propose=propose)
        if trials
        else None,
    )


if __name__ == "__main__":
    folder, trials = Path(sys.argv[1]), int(sys.argv[2])
    reproduce(
        toy(trials=trials), Plan(scale="smoke", results=folder / "results", work=folder / "work")
    )
