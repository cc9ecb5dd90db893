"""An experiment that takes no time: a straight line with a little noise by seed."""

import os
import sys
import time
from dataclasses import replace
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
from fusionnet.files import write_whole
from fusionnet.randomness import generator

SLOW = float(os.environ.get("TOY_SECONDS", "0"))


def variants(scale: str) -> list[Variant]:
    return [Variant(name=f"x{x}", values={"x": x}) for x in (1, 2, 3)]


def propose(trial: optuna.trial.BaseTrial) -> Variant:
    values = {"x": round(trial.suggest_float("x", 0.0, 5.0), 3)}
    return Variant(name=proposal_name(values), values=values)


def run(trial: Trial) -> Outcome:
    trial.work.mkdir(parents=True, exist_ok=True)
    with (trial.work / "made.txt").open("a") as made:
        made.write(f"{trial.variant.name} {trial.seed}\n")
    time.sleep(SLOW)
    noise = generator(trial.seed, "toy").normal(0, 0.1)
    x = trial.variant.values["x"]
    return Outcome(
        metrics={"error": (x - 2.0) ** 2 + noise},
        configuration={"slope": 2.0},
        curves={"loss": [1.0, 0.5]},
        details={"table": {"rows": ["a"], "columns": ["b", "c"], "values": [[0.5, x]]}},
    )


STEPS = 20


def run_in_steps(trial: Trial) -> Outcome:
    """A run that keeps a state after each step, and goes on from it."""
    state = trial.state / "step.txt"
    done = int(state.read_text()) if state.is_file() else 0
    for step in range(done, STEPS):
        trial.work.mkdir(parents=True, exist_ok=True)
        with (trial.work / "steps.txt").open("a") as made:
            made.write(f"{trial.variant.name} {trial.seed}\n")
        time.sleep(SLOW)
        write_whole(state, str(step + 1))
    return run(trial)


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
        published=(
            Published(variant="x2", metric="error", mean=0.0, deviation=0.1, where="nowhere"),
        ),
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
    experiment = toy(trials=trials)
    if sys.argv[3:] == ["steps"]:
        experiment = replace(experiment, run=run_in_steps)
    reproduce(experiment, Plan(scale="smoke", results=folder / "results", work=folder / "work"))
