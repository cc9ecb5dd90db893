"""Everything that is missing of an experiment, run: the variants, then the search's."""

import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from fusionnet.errors import UnknownNameError
from fusionnet.experiments._experiment import Experiment, Progress, Variant
from fusionnet.experiments._records import Record, record_file
from fusionnet.experiments._runner import Plan, Stale, run_trial, stamps, trial_of
from fusionnet.experiments._search import PROPOSAL, forget_study, judged_by, search_variants
from fusionnet.files import check_folder

Report = Callable[[int, int], None]


def reproduce(
    experiment: Experiment,
    plan: Plan,
    *,
    progress: Report | None = None,
    within: Progress | None = None,
) -> list[Record]:
    """Make every missing run of an experiment, and return all records of its variants.

    Args:
        experiment: What to run.
        plan: At which scale, with how many seeds.
        progress: Called with runs done, of how many.
        within: Called by a run with what it has done, of how much.

    Raises:
        UnknownNameError: If the experiment has no variant of a name in `plan.only`.
        InputError, DataError: If a run needs data that is not there; the message names the
            command that makes it.
        OutputError: If a record cannot be written.
    """
    check_folder(plan.results)
    check_folder(plan.work)
    seeds = range(plan.seeds or experiment.seeds[plan.scale])
    variants = _chosen(experiment, plan)
    searched = experiment.search is not None and not plan.only
    total = len(variants) * len(seeds)
    if experiment.search is not None and searched:
        each = judged_by(experiment.search, plan.scale, len(seeds))
        total += (experiment.search.trials[plan.scale] - 1) * each + len(seeds)
    trials = [trial_of(experiment, plan, v, seed, within) for seed in seeds for v in variants]
    stale: Stale = {}
    if plan.again:
        stale = stamps(plan.results / experiment.name / plan.scale)
        _forget_states(experiment, plan, variants)
    records: dict[Path, Record] = {}

    def note(file: Path, record: Record) -> None:
        records[file] = record
        if progress is not None:
            progress(len(records), total)

    while missing := [t for t in trials if record_file(plan.results, t) not in records]:
        before = len(records)
        for trial in missing:
            record = run_trial(experiment, plan, trial, stale)
            if record is not None:
                note(record_file(plan.results, trial), record)
        if len(records) == before:
            time.sleep(1.0)  # other processes are at what is left
    if searched:
        search_variants(experiment, plan, seeds, note, within, stale)
        for file in stale.keys() - records.keys():
            if file.name.startswith(PROPOSAL):  # it is no longer made
                file.unlink(missing_ok=True)
    return list(records.values())


def _chosen(experiment: Experiment, plan: Plan) -> list[Variant]:
    """The variants that a plan names, in the experiment's order."""
    variants = {variant.name: variant for variant in experiment.variants(plan.scale)}
    for name in plan.only:
        if name not in variants:
            raise UnknownNameError(
                f"{experiment.name} has no variant {name!r} at the {plan.scale} scale; it has: "
                f"{', '.join(variants)}"
            )
    return [v for name, v in variants.items() if not plan.only or name in plan.only]


def _forget_states(experiment: Experiment, plan: Plan, variants: Sequence[Variant]) -> None:
    """Remove the states of killed runs of variants that a plan names, and what trials share.

    Where it names none, those of all variants go, and the study of its search. Records stay until
    they are replaced.
    """
    trial = trial_of(experiment, plan, variants[0], seed=0)
    shutil.rmtree(trial.shared, ignore_errors=True)
    patterns = [f"{variant.name}-seed*" for variant in variants] if plan.only else ["*"]
    for pattern in patterns:
        for state in trial.state.parent.glob(pattern):
            shutil.rmtree(state, ignore_errors=True)
    if not plan.only:
        forget_study(experiment, plan)
