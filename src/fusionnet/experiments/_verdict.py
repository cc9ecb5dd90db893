"""What the records say of an experiment: means with intervals, and a verdict a claim."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fusionnet.evaluation.intervals import (
    PairedDifference,
    bootstrap_interval,
    paired_difference,
)
from fusionnet.experiments._experiment import Claim, Experiment, Variant
from fusionnet.experiments._records import Record

Verdict = Literal["agrees", "differs", "cannot tell", "not run"]


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One variant's results for one metric.

    Attributes:
        variant: What was run.
        values: One value a seed, in the order of the seeds.
        mean, deviation: Over the seeds; the deviation with n - 1.
        low, high: 95 % bootstrap interval of the mean.
    """

    variant: Variant
    values: tuple[float, ...]
    mean: float
    deviation: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What the records say of one claim.

    Attributes:
        claim: What was claimed.
        verdict: "cannot tell" unless the t interval of the paired difference leaves out zero.
        difference: Better minus worse by the claim, over paired seeds; None if not run.
    """

    claim: Claim
    verdict: Verdict
    difference: PairedDifference | None


def summaries(records: Sequence[Record], metric: str) -> list[Summary]:
    """Mean and interval of a metric for every variant that has it, in the records' order."""
    by_variant: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        if metric in record.metrics:
            by_variant[record.variant.name].append(record)
    found = []
    for same in by_variant.values():
        values = [r.metrics[metric] for r in sorted(same, key=lambda r: r.seed)]
        low, high = bootstrap_interval(values)
        deviation = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
        found.append(
            Summary(
                variant=same[0].variant,
                values=tuple(values),
                mean=float(np.mean(values)),
                deviation=deviation,
                low=low,
                high=high,
            )
        )
    return found


def judge(experiment: Experiment, claim: Claim, records: Sequence[Record]) -> Judgement:
    """Whether the records bear a claim, by the seeds that both variants have."""
    metric = claim.metric or experiment.metric
    results: dict[str, dict[int, float]] = {claim.better: {}, claim.worse: {}}
    for record in records:
        if record.variant.name in results and metric in record.metrics:
            results[record.variant.name][record.seed] = record.metrics[metric]
    shared = sorted(results[claim.better].keys() & results[claim.worse].keys())
    if not shared:
        return Judgement(claim=claim, verdict="not run", difference=None)
    difference = paired_difference(
        [results[claim.better][seed] for seed in shared],
        [results[claim.worse][seed] for seed in shared],
    )
    verdict: Verdict = "cannot tell"
    if difference.clear:
        less = difference.mean < 0
        lower_is_better = experiment.lower_is_better if not claim.metric else less_is_better(metric)
        verdict = "agrees" if less == lower_is_better else "differs"
    return Judgement(claim=claim, verdict=verdict, difference=difference)


def less_is_better(metric: str) -> bool:
    """Whether less of a metric is better, by its name: losses and errors are."""
    return any(word in metric for word in ("loss", "error", "mse", "entropy", "milliseconds"))
