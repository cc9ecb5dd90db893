"""`fusionnet reproduce NAME`: run the experiments of the thesis, and ours."""

from dataclasses import dataclass, field

import tyro
from rich.console import Console
from rich.table import Table

from fusionnet import experiments
from fusionnet.apps.progress import bars
from fusionnet.experiments import Experiment, Plan, Record, judge, summaries


@dataclass(frozen=True, kw_only=True)
class ReproduceConfig:
    """Which experiment, at which scale."""

    name: tyro.conf.Positional[str] = "all"
    """An experiment's name, "all", or "list" to see what there is."""
    plan: tyro.conf.OmitArgPrefixes[Plan] = field(default_factory=Plan)


def reproduce(config: ReproduceConfig) -> None:
    """Run what is missing of an experiment, and print its comparison with the thesis.

    Finished runs are kept; several processes may work on the same experiment at once.
    `fusionnet report` draws what has been run.
    """
    console = Console(highlight=False)
    if config.name == "list":
        console.print(_contents())
        return
    names = experiments.names() if config.name == "all" else [config.name]
    for name in names:
        experiment = experiments.load(name)
        with bars() as bar:
            records = experiments.reproduce(experiment, config.plan, progress=bar(name))
        console.print(_table(experiment, records), soft_wrap=not console.is_terminal)
        for claim in experiment.claims:
            judged = judge(experiment, claim, records)
            console.print(f"  {judged.verdict}: {claim.says}")


def _contents() -> Table:
    table = Table(title="experiments", title_justify="left")
    for column in ("name", "thesis", "what is varied"):
        table.add_column(column)
    for name in experiments.names():
        experiment = experiments.load(name)
        table.add_row(name, experiment.section, experiment.title)
    return table


def _table(experiment: Experiment, records: list[Record]) -> Table:
    published = {p.variant: p for p in experiment.published if p.metric == experiment.metric}
    table = Table(title=f"{experiment.name}: {experiment.title}", title_justify="left")
    for column in ("variant", experiment.metric, "95 % interval", "seeds", "thesis"):
        table.add_column(column)
    for summary in summaries(records, experiment.metric):
        stated = published.get(summary.variant.name)
        table.add_row(
            summary.variant.label or summary.variant.name,
            f"{summary.mean:.4g} ± {summary.deviation:.2g}",
            f"{summary.low:.4g} to {summary.high:.4g}",
            str(len(summary.values)),
            "" if stated is None else _stated(stated.mean, stated.deviation),
        )
    return table


def _stated(mean: float, deviation: float | None) -> str:
    return f"{mean:g}" if deviation is None else f"{mean:g} ± {deviation:g}"
