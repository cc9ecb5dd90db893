"""Variants that a search proposes: a study that several processes work on, killed or not.

The study is a journal file beside the records. Every trial under way holds a lock; a
trial whose lock is free has lost its process, is failed, and its values are tried again.
Runs that were finished for it are found by their records and not made again.
"""

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import optuna
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from fusionnet.experiments._experiment import (
    Experiment,
    Progress,
    Scale,
    Search,
    Variant,
)
from fusionnet.experiments._locks import Lock
from fusionnet.experiments._records import Record, record_file
from fusionnet.experiments._runner import Plan, Stale, run_trial, trial_of

JOURNAL = "study.journal"
"""The study's file, beside the records."""

PROPOSAL = "proposal-"
"""How the names of proposed variants begin."""

PAUSE = 0.2
"""Seconds between looks at what other processes do."""


def search_variants(
    experiment: Experiment,
    plan: Plan,
    seeds: range,
    note: Callable[[Path, Record], None],
    within: Progress | None = None,
    stale: Stale | None = None,
) -> None:
    """Let a tree-structured Parzen estimator propose variants until enough are finished.

    References:
        Bergstra et al. (2011), Algorithms for hyper-parameter optimization; thesis 7.2.
    """
    assert experiment.search is not None
    folder = plan.results / _name(experiment, plan)
    folder.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        study_name=experiment.name,
        storage=optuna.storages.JournalStorage(JournalFileBackend(str(folder / JOURNAL))),
        direction="minimize" if experiment.lower_is_better else "maximize",
        load_if_exists=True,
    )
    search = experiment.search
    wanted = search.trials[plan.scale]
    some = seeds[: judged_by(search, plan.scale, len(seeds))]
    asking = Lock(plan.work, _name(experiment, plan) / "ask")
    while _count(study, TrialState.COMPLETE) < wanted:
        if not asking.acquire():
            time.sleep(PAUSE)
            continue
        with asking:
            mine = _next(study, wanted, plan, _name(experiment, plan))
        if mine is None:
            time.sleep(PAUSE)  # other processes are at the last ones
            continue
        trial, lock = mine
        with lock:
            variant = search.propose(trial)
            study.tell(trial, _mean(experiment, plan, variant, some, note, within, stale))
    best = study.best_trial.number
    for finished in study.get_trials(deepcopy=False, states=[TrialState.COMPLETE]):
        variant = search.propose(optuna.trial.FixedTrial(finished.params))
        own = seeds if finished.number == best else some
        _mean(experiment, plan, variant, own, note, within, stale)


def judged_by(search: Search, scale: Scale, seeds: int) -> int:
    """How many of some seeds each trial of a search is judged by."""
    return min(seeds, search.seeds.get(scale, seeds))


def _next(
    study: optuna.Study, wanted: int, plan: Plan, name: Path
) -> tuple[optuna.Trial, Lock] | None:
    """A new trial and its lock, or None if enough are finished or under way."""
    for trial in study.get_trials(deepcopy=False, states=[TrialState.RUNNING]):
        lock = Lock(plan.work, name / str(trial.number))
        if lock.acquire():  # its process has died
            with lock:
                study.tell(trial.number, state=TrialState.FAIL)
                if trial.params:
                    study.enqueue_trial(trial.params)
    if _count(study, TrialState.COMPLETE, TrialState.RUNNING) >= wanted:
        return None
    number = len(study.get_trials(deepcopy=False))
    study.sampler = optuna.samplers.TPESampler(seed=number)  # else processes draw alike
    asked = study.ask()
    lock = Lock(plan.work, name / str(asked.number))
    held = lock.acquire()
    assert held, "nobody else knows of this trial"
    return asked, lock


def _count(study: optuna.Study, *states: TrialState) -> int:
    return len(study.get_trials(deepcopy=False, states=list(states)))


def forget_study(experiment: Experiment, plan: Plan) -> None:
    """Remove the study of an experiment at a scale."""
    folder = plan.results / _name(experiment, plan)
    for file in folder.glob(f"{JOURNAL}*"):
        file.unlink(missing_ok=True)


def _name(experiment: Experiment, plan: Plan) -> Path:
    return Path(experiment.name) / plan.scale


def _mean(
    experiment: Experiment,
    plan: Plan,
    variant: Variant,
    seeds: range,
    note: Callable[[Path, Record], None],
    within: Progress | None,
    stale: Stale | None,
) -> float:
    """Mean of the deciding metric over the seeds, from records that are made if missing."""
    values = []
    for seed in seeds:
        trial = trial_of(experiment, plan, variant, seed, within)
        while (record := run_trial(experiment, plan, trial, stale)) is None:
            time.sleep(PAUSE)
        note(record_file(plan.results, trial), record)
        values.append(record.metrics[experiment.metric])
    return sum(values) / len(values)


def proposal_name(values: Mapping[str, float]) -> str:
    """A short name for proposed values, the same for the same values."""
    text = json.dumps(dict(values), sort_keys=True)
    return PROPOSAL + hashlib.blake2b(text.encode(), digest_size=5).hexdigest()
