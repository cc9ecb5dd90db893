"""What has been run of each experiment, with its summary and verdicts."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fusionnet import experiments
from fusionnet.experiments import (
    Experiment,
    Judgement,
    Published,
    Record,
    Scale,
    Summary,
    Variant,
    judge,
    of_one_setup,
    read_records,
    summaries,
)

SCALES: tuple[Scale, ...] = ("thesis", "small", "smoke")
"""Which records are shown where there are several: the largest scale."""


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """One experiment and its finished runs.

    Attributes:
        experiment: What was to be run.
        scale: Of the runs; None if nothing was run.
        records: The runs, all of one set-up.
        left_out: How many runs of other set-ups there are beside them.
        summaries: Of the deciding metric, a variant each.
        judgements: A verdict for each claim.
    """

    experiment: Experiment
    scale: Scale | None
    records: tuple[Record, ...]
    left_out: int
    summaries: tuple[Summary, ...]
    judgements: tuple[Judgement, ...]

    @property
    def seeds(self) -> int:
        """The most seeds that a variant was run with."""
        return max((len(s.values) for s in self.summaries), default=0)

    @property
    def minutes(self) -> float:
        """Wall time of all runs together."""
        return sum(record.seconds for record in self.records) / 60

    def published(self, variant: str, metric: str = "") -> Published | None:
        """What the thesis states for a variant, if anything."""
        return self.stated(metric).get(variant)

    def stated(self, metric: str = "") -> dict[str, Published]:
        """What the thesis states of a metric (the deciding one by default), by variant."""
        metric = metric or self.experiment.metric
        return {p.variant: p for p in self.experiment.published if p.metric == metric}

    @cached_property
    def variants(self) -> dict[str, Variant]:
        """All variants by name: those of the thesis's scale, and those that were run."""
        found = {v.name: v for v in self.experiment.variants("thesis")}
        found |= {s.variant.name: s.variant for s in self.summaries}
        return found | {r.variant.name: r.variant for r in self.records}

    def variants_with(self, metrics: Sequence[str]) -> list[Variant]:
        """The variants that have any of some metrics, in the experiment's order."""
        ran = {r.variant.name for r in self.records if set(metrics) & r.metrics.keys()}
        return [variant for name, variant in self.variants.items() if name in ran]

    def summaries_of(self, metric: str = "") -> list[Summary]:
        """The runs' summaries of any metric, in the same order of variants."""
        if metric in ("", self.experiment.metric):
            return list(self.summaries)
        by_name = {s.variant.name: s for s in summaries(self.records, metric)}
        return [by_name[name] for name in self.variants if name in by_name]


def gather(results: Path, scales: Sequence[Scale] = SCALES) -> list[Chapter]:
    """A chapter for every experiment, in the order of the thesis's sections, ours last.

    Raises:
        DataError: If a record is damaged.
    """
    loaded = [experiments.load(name) for name in experiments.names()]
    return [chapter(e, results, scales) for e in sorted(loaded, key=_order)]


def chapter(experiment: Experiment, results: Path, scales: Sequence[Scale] = SCALES) -> Chapter:
    """What has been run of one experiment, at the first of the scales that has records."""
    for scale in scales:
        records = read_records(results, experiment.name, scale)
        if records:
            break
    else:
        scale, records = None, []
    kept = of_one_setup(records, experiment.differs.get(scale, "") if scale else "")
    return Chapter(
        experiment=experiment,
        scale=scale,
        records=tuple(kept),
        left_out=len(records) - len(kept),
        summaries=tuple(_in_order(experiment, scale, summaries(kept, experiment.metric))),
        judgements=tuple(judge(experiment, claim, kept) for claim in experiment.claims),
    )


def _in_order(experiment: Experiment, scale: Scale | None, found: list[Summary]) -> list[Summary]:
    """As the experiment lists its variants; proposals of a search after them, best first."""
    if scale is None:
        return found
    place = {variant.name: i for i, variant in enumerate(experiment.variants(scale))}
    sign = 1 if experiment.lower_is_better else -1
    return sorted(found, key=lambda s: (place.get(s.variant.name, len(place)), sign * s.mean))


def _order(experiment: Experiment) -> tuple[int, str, str]:
    ours = experiment.section == "ours"
    return int(ours), experiment.section, experiment.name
