"""What an experiment is: variants that are run with seeds, and what is claimed of them."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import optuna

Scale = Literal["smoke", "small", "thesis"]
"""*smoke*: seconds, shows that it runs; *small*: under 90 minutes on two cores, says something;
*thesis*: the thesis's own size, for a GPU or a cluster."""

Progress = Callable[..., None]
"""Called with what is done, of how much, and maybe a line of a log (as `training.fit` does)."""

PAIRED = (
    "Paired seeds: a claim is borne out, or contradicted, only where the 95 % t interval of the "
    "mean difference leaves out zero, over three seeds or more; otherwise it cannot be told."
)

_NAME = re.compile(r"[a-z0-9][a-z0-9.+=_-]*")


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One set-up of those that are compared.

    Attributes:
        name: Unique in its experiment; also the name of its files.
        values: What sets it apart: JSON values by name.
        label: For figures and tables; the name by default.
    """

    name: str
    values: Mapping[str, Any]
    label: str = ""

    def __post_init__(self) -> None:
        """Our own names must be fit for files."""
        assert _NAME.fullmatch(self.name), self.name


@dataclass(frozen=True, kw_only=True)
class Published:
    """A number that the thesis states.

    Attributes:
        variant: Name of our variant that it corresponds to.
        metric: Name of our metric.
        mean: Over its repetitions.
        deviation: Standard deviation over its repetitions, if stated.
        where: Section, table or figure.
    """

    variant: str
    metric: str
    mean: float
    deviation: float | None = None
    where: str


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A comparison of two variants by paired seeds, and what the thesis found of it.

    Attributes:
        better, worse: Names of variants; the thesis (or our expectation) holds the first better.
        says: The finding in one sentence.
        metric: Metric to compare; the experiment's by default.
        source: "thesis", or "ours" for an expectation of our own.
    """

    better: str
    worse: str
    says: str
    metric: str = ""
    source: Literal["thesis", "ours"] = "thesis"


@dataclass(frozen=True, kw_only=True)
class Figure:
    """How the results are drawn, in the thesis's own form.

    Attributes:
        kind: "bars" a variant; "ranked" points, the best first, the thesis's own variants beside
            ours; "lines" and "scatter" over `x`; "curves" of the runs, a line a variant;
            "matrix", colours by row and column.
        metric: What is drawn; the experiment's by default. Of "curves" the name of a curve, of
            "matrix" the name of a detail: {"rows": [...], "columns": [...], "values": [[...]]}.
        x: Key of the variants' values on the horizontal axis (lines, scatter); of "curves" the
            name of the curve that holds the steps.
        series: Key of the variants' values that tells lines apart (lines).
        title: What it shows, where an experiment has several figures.
        like: The thesis's figure or table that it corresponds to.
        x_label, y_label: With units.
        logarithmic: Whether the vertical axis is.
    """

    kind: Literal["bars", "ranked", "lines", "scatter", "curves", "matrix"] = "bars"
    metric: str = ""
    x: str = ""
    series: str = ""
    title: str = ""
    like: str = ""
    x_label: str = ""
    y_label: str = ""
    logarithmic: bool = False


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one run gives.

    Attributes:
        metrics: Numbers measured on data that was not learnt from.
        configuration: All that was set, as JSON: sizes, steps, rates, what was measured on.
        curves: Lists of numbers by name (a loss over steps, say).
        details: Anything else that is JSON: a confusion table, an example.
    """

    metrics: Mapping[str, float]
    configuration: Mapping[str, Any] = field(default_factory=dict)
    curves: Mapping[str, Sequence[float]] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run to be made: a variant with a seed at a scale.

    Attributes:
        experiment: Name.
        variant: What to run.
        seed: Of everything random; the variants of one seed are compared as pairs.
        scale: Size.
        data: Folder of the treebank, if it was given; `corpus_for` reads it.
        work: Folder for data sets and weights that the trials of a scale share.
        progress: Called with what is done, of how much, and maybe a line of a log.
    """

    experiment: str
    variant: Variant
    seed: int
    scale: Scale
    data: Path | None = None
    work: Path = Path("runs/reproduce")
    progress: Progress | None = None

    @property
    def state(self) -> Path:
        """Folder of this trial alone, for a state that it resumes from after a kill.

        It is removed once the record is written.
        """
        return self.work / "states" / self.experiment / f"{self.variant.name}-seed{self.seed}"

    @property
    def shared(self) -> Path:
        """Folder for what trials of this experiment measure together; `--again` removes it."""
        return self.work / "shared" / self.experiment


@dataclass(frozen=True, kw_only=True)
class Search:
    """Variants that a search proposes, one after the other, each from what it saw before.

    Attributes:
        trials: How many, by scale.
        propose: Draws a variant from an Optuna trial; the same values give the same variant.
        seeds: How many seeds a trial is judged by, by scale; all by default. The best trial is
            run with all at the end.
    """

    trials: Mapping[Scale, int]
    propose: Callable[[optuna.trial.BaseTrial], Variant]
    seeds: Mapping[Scale, int] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One table or figure of the thesis, or one of ours.

    Attributes:
        name: As in the catalogue.
        section: Of the thesis, or "ours".
        title: What is varied.
        question: What it is to answer.
        setup: The thesis's set-up in our words.
        differs: How ours differs from it, by scale.
        metric: Name of the metric that decides.
        lower_is_better: Whether less of it is better.
        variants: What is compared, by scale; with a `search` those that are run beside it.
        run: Makes one run.
        seeds: How many, by scale.
        published: Numbers of the thesis.
        claims: What is tested, by paired seeds.
        test: With which test the claims are judged.
        figures: How it is drawn.
        search: Proposes further variants.
        caution: What the numbers cannot say, in a sentence for the report.
    """

    name: str
    section: str
    title: str
    question: str
    setup: str
    differs: Mapping[Scale, str]
    metric: str
    lower_is_better: bool
    variants: Callable[[Scale], Sequence[Variant]]
    run: Callable[[Trial], Outcome]
    seeds: Mapping[Scale, int]
    published: tuple[Published, ...] = ()
    claims: tuple[Claim, ...] = ()
    test: str = PAIRED
    figures: tuple[Figure, ...] = (Figure(),)
    search: Search | None = None
    caution: str = ""
