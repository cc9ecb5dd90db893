"""`fusionnet reproduce NAME`: run the experiments of the thesis, and ours."""

from dataclasses import dataclass, field, replace

import tyro
from rich.console import Console
from rich.table import Table

from fusionnet import experiments
from fusionnet.apps.progress import bars
from fusionnet.corpora import named_data
from fusionnet.errors import DataError, FusionNetError, InputError, OutputError
from fusionnet.experiments import Experiment, Plan, Record, judge, of_one_setup, summaries


@dataclass(frozen=True, kw_only=True)
class ReproduceConfig:
    """Which experiment, at which scale."""

    name: tyro.conf.Positional[str] = "all"
    """An experiment's name, "all", or "list" to see what there is."""
    plan: tyro.conf.OmitArgPrefixes[Plan] = field(default_factory=Plan)
    resume: bool = False
    """Go on where a killed run stopped. This is what happens anyway, without --again."""

    def __post_init__(self) -> None:
        """Refuse to go on and to begin again at once."""
        if self.resume and self.plan.again:
            raise InputError("--resume keeps finished runs and --again makes them again; say one.")


def reproduce(config: ReproduceConfig) -> None:
    """Run what is missing of an experiment, and print its comparison with the thesis.

    Finished runs are kept; several processes may work on the same experiment at once.
    The treebank is --data DIR, or where the variable FUSIONNET_DATA points.
    `fusionnet report` draws what has been run.
    """
    console = Console(highlight=False)
    if config.name == "list":
        console.print(_contents())
        return
    plan = config.plan
    if plan.data is None and (named := named_data()):
        plan = replace(plan, data=named)
    if config.name != "all":
        _one(experiments.load(config.name), plan, console)
        return
    missing = []
    for name in experiments.names():
        try:
            _one(experiments.load(name), plan, console)
        except OutputError:
            raise
        except FusionNetError as error:
            console.print(f"{name}: {error}", soft_wrap=True)
            missing.append(name)
    if missing:
        raise DataError(f"Not run to the end, see above: {', '.join(missing)}.")


def _one(experiment: Experiment, plan: Plan, console: Console) -> None:
    """Run one experiment and print what came out."""
    with bars() as bar:
        runs, within = bar(f"{experiment.name}: runs"), bar("this run")
        records = experiments.reproduce(experiment, plan, progress=runs, within=within)
    today = experiment.differs.get(plan.scale, "")
    kept = of_one_setup(records, today)
    if others := sum((record.setup or today) != today for record in records):
        console.print(
            f"{experiment.name}: {others} of {len(records)} runs were made with another set-up "
            f"than today's, {len(records) - len(kept)} are left out below; --again makes them "
            "anew.",
            soft_wrap=True,
        )
    console.print(_table(experiment, kept), soft_wrap=not console.is_terminal)
    for claim in experiment.claims:
        judged = judge(experiment, claim, kept)
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
