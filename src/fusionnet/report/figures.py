"""Figures in the thesis's own form: bars or lines with intervals, its numbers as open marks.

Colours are those of Okabe and Ito, which colour-blind people can tell apart.
"""

import io
from collections import defaultdict
from collections.abc import Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from fusionnet.experiments import Figure, Summary, summaries
from fusionnet.report.chapters import Chapter
from fusionnet.report.reading import metric_words

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
PUBLISHED = "#555555"
"""The thesis's numbers: open diamonds of this colour."""


def draw(chapter: Chapter, figure: Figure) -> str:
    """One figure of a chapter as SVG."""
    canvas = Canvas(figsize=(7.2, _height(chapter, figure)), layout="constrained")
    axes = canvas.add_subplot()
    {"bars": _bars, "lines": _lines, "scatter": _scatter}[figure.kind](axes, chapter, figure)
    if figure.logarithmic:
        (axes.set_xscale if figure.kind == "bars" else axes.set_yscale)("log")
    axes.spines[["top", "right"]].set_visible(False)
    return svg(canvas)


def draw_answer(chapter: Chapter, metrics: Sequence[tuple[str, str]]) -> str:
    """Several metrics of one chapter side by side, a row a variant: the report's first figure.

    Args:
        chapter: Of the ablation.
        metrics: Names of metrics with the labels of their axes.
    """
    shown = [(summaries(chapter.records, name), label) for name, label in metrics]
    shown = [(found, label) for found, label in shown if found]
    order = [s.variant.name for s in chapter.summaries]
    canvas = Canvas(figsize=(9.5, 0.9 + 0.36 * len(order)), layout="constrained")
    for column, (found, label) in enumerate(shown):
        axes = canvas.add_subplot(1, len(shown), column + 1)
        by_name = {s.variant.name: s for s in found}
        rows = [by_name[name] for name in order if name in by_name]
        _row_bars(axes, rows, COLORS[column])
        if column:
            axes.set_yticklabels([])
        axes.set_xlabel(label)
        axes.spines[["top", "right"]].set_visible(False)
    return svg(canvas)


def svg(canvas: Canvas) -> str:
    """A figure as SVG text, the same bytes each time."""
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "fusionnet", "svg.fonttype": "none"}):
        canvas.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


def _height(chapter: Chapter, figure: Figure) -> float:
    return 0.9 + 0.32 * len(chapter.summaries) if figure.kind == "bars" else 3.6


def _bars(axes: Axes, chapter: Chapter, figure: Figure) -> None:
    _row_bars(axes, chapter.summaries, COLORS[0])
    for row, summary in enumerate(chapter.summaries):
        stated = chapter.published(summary.variant.name)
        if stated is not None:
            axes.errorbar(
                stated.mean,
                row,
                xerr=stated.deviation,
                fmt="D",
                mfc="none",
                color=PUBLISHED,
                label="thesis",
            )
    axes.set_xlabel(figure.y_label or metric_words(chapter.experiment.metric))
    _legend(axes)


def _row_bars(axes: Axes, rows: Sequence[Summary], color: str) -> None:
    means = [s.mean for s in rows]
    spread = [[s.mean - s.low for s in rows], [s.high - s.mean for s in rows]]
    axes.barh(range(len(rows)), means, xerr=spread, color=color, alpha=0.75, capsize=3)
    for row, summary in enumerate(rows):
        axes.plot(summary.values, [row] * len(summary.values), "k.", markersize=3)
    axes.set_yticks(range(len(rows)), [s.variant.label or s.variant.name for s in rows])
    axes.invert_yaxis()


def _lines(axes: Axes, chapter: Chapter, figure: Figure) -> None:
    series: dict[str, list[Summary]] = defaultdict(list)
    for summary in chapter.summaries:
        series[str(summary.variant.values.get(figure.series, ""))].append(summary)
    marks = "osv^Dp*"
    for number, (name, points) in enumerate(series.items()):
        points = sorted(points, key=lambda s: s.variant.values[figure.x])
        xs = [s.variant.values[figure.x] for s in points]
        ys = [s.mean for s in points]
        spread = [[s.mean - s.low for s in points], [s.high - s.mean for s in points]]
        color, mark = COLORS[number % len(COLORS)], marks[number % len(marks)]
        axes.errorbar(xs, ys, spread, fmt=f"-{mark}", color=color, capsize=3, label=name)
        stated = [(x, chapter.published(s.variant.name)) for x, s in zip(xs, points, strict=True)]
        for x, number_stated in stated:
            if number_stated is not None:
                axes.plot(x, number_stated.mean, "D", mfc="none", color=color)
    axes.set_xlabel(figure.x_label or metric_words(figure.x))
    axes.set_ylabel(figure.y_label or metric_words(chapter.experiment.metric))
    _legend(axes)


def _scatter(axes: Axes, chapter: Chapter, figure: Figure) -> None:
    for summary in chapter.summaries:
        x = summary.variant.values.get(figure.x)
        if x is not None:
            spread = [[summary.mean - summary.low], [summary.high - summary.mean]]
            axes.errorbar([x], [summary.mean], spread, fmt="o", color=COLORS[0], markersize=4)
    axes.set_xlabel(figure.x_label or metric_words(figure.x))
    axes.set_ylabel(figure.y_label or metric_words(chapter.experiment.metric))


def _legend(axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    unique = {label: handle for handle, label in zip(handles, labels, strict=True) if label}
    if unique:
        axes.legend(unique.values(), unique.keys(), frameon=False)
