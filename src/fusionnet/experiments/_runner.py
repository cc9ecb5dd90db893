"""Run what is missing of an experiment; several processes may work on it at once.

A run is claimed by a lock on a file, which the system lets go when its process ends,
however it ends. Its record is written whole at the end. So finished runs are never lost
nor made twice, and a killed process costs only the run that it was at.
"""

import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fusionnet.errors import InputError
from fusionnet.experiments._experiment import Experiment, Progress, Scale, Trial, Variant
from fusionnet.experiments._locks import Lock
from fusionnet.experiments._records import Record, read_record, record_file, write_record

Stale = Mapping[Path, tuple[int, int]]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What to run, and where to keep it.

    Attributes:
        scale: Size of the runs.
        seeds: How many seeds; as the experiment says by default.
        only: Names of the variants to run; all of them, and the search's, by default.
        data: Folder of the treebank; only the smoke scale does without.
        results: Folder of the records.
        work: Folder for data sets, states and locks.
        again: Make finished runs again, those of `only` where it names some, each record staying
            until it is replaced; otherwise they are kept, and what is missing is made.
    """

    scale: Scale = "small"
    seeds: int | None = None
    only: tuple[str, ...] = ()
    data: Path | None = None
    results: Path = Path("results/experiments")
    work: Path = Path("runs/reproduce")
    again: bool = False

    def __post_init__(self) -> None:
        """Refuse numbers of seeds that make no run."""
        if self.seeds is not None and self.seeds < 1:
            raise InputError(f"At least one seed is needed; received {self.seeds}.")


def trial_of(
    experiment: Experiment,
    plan: Plan,
    variant: Variant,
    seed: int,
    progress: Progress | None = None,
) -> Trial:
    """The trial of a variant with a seed in a plan."""
    return Trial(
        experiment=experiment.name,
        variant=variant,
        seed=seed,
        scale=plan.scale,
        data=plan.data,
        work=plan.work / plan.scale,
        progress=progress,
    )


def run_trial(
    experiment: Experiment, plan: Plan, trial: Trial, stale: Stale | None = None
) -> Record | None:
    """The trial's record, made now if it is not there; None while another process makes it.

    Args:
        experiment: What to run.
        plan: Where records are kept.
        trial: One variant with one seed.
        stale: Records that are to be made again, as `stamps` saw them.
    """
    file = record_file(plan.results, trial)
    if _is_there(file, stale):
        return read_record(file)
    lock = Lock(plan.work, file.relative_to(plan.results))
    if not lock.acquire():
        return None
    with lock:
        if _is_there(file, stale):  # finished by another process in the meantime
            return read_record(file)
        began = time.monotonic()
        outcome = experiment.run(trial)
        setup = experiment.differs.get(trial.scale, "")
        record = write_record(file, trial, outcome, time.monotonic() - began, setup)
        shutil.rmtree(trial.state, ignore_errors=True)
        return record


def stamps(folder: Path) -> Stale:
    """The records of a folder, and by what each is told from one that replaces it."""
    return {file: _stamp(file) for file in folder.glob("*.json")}


def _is_there(file: Path, stale: Stale | None) -> bool:
    return file.is_file() and (stale or {}).get(file) != _stamp(file)


def _stamp(file: Path) -> tuple[int, int]:
    found = file.stat()
    return found.st_ino, found.st_mtime_ns
