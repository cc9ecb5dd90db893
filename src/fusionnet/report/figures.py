"""Figures in the thesis's own form: its numbers on the left, ours with intervals on the right.

Colours are those of Okabe and Ito, which colour-blind people can tell apart.
"""

import io
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from fusionnet.experiments import Figure, Published, Summary, Variant, less_is_better, summaries
from fusionnet.report.chapters import Chapter
from fusionnet.report.reading import metric_words
from fusionnet.report.run_figures import draw_curves, draw_matrix
from fusionnet.report.style import COLORS, MARKS, PUBLISHED, bare, legend

MOST_RANKED = 40
"""Bars of a ranking; the worst ones beyond are left out."""


def draw(chapter: Chapter, figure: Figure) -> str:
    """One figure of a chapter as SVG."""
    if figure.kind == "curves":
        return svg(draw_curves(chapter, figure))
    if figure.kind == "matrix":
        return svg(draw_matrix(chapter, figure))
    stated = chapter.stated(figure.metric)
    canvas = Canvas(figsize=(8.6, _height(chapter, figure, stated)), layout="constrained")
    panels = list(canvas.subplots(1, 2 if stated else 1, squeeze=False)[0])
    draw_kind = {"bars": _bars, "ranked": _ranked, "lines": _lines, "scatter": _scatter}
    draw_kind[figure.kind](panels, chapter, figure, stated)
    panels[0].set_title("the thesis", fontsize=10)
    panels[-1].set_title(f"ours ({chapter.scale})", fontsize=10)
    for axes in panels:
        if figure.logarithmic:
            (axes.set_xscale if figure.kind in ("bars", "ranked") else axes.set_yscale)("log")
        bare(axes)
    return svg(canvas)


def draw_answer(chapter: Chapter, metrics: Sequence[tuple[str, str]]) -> str:
    """Several metrics of one chapter side by side, a row a variant: the report's first figure.

    Each network of the ablation (the value `network` of its variants) has its own row of panels.

    Args:
        chapter: Of the ablation.
        metrics: Names of metrics with the labels of their axes.
    """
    shown = [(summaries(chapter.records, name), label) for name, label in metrics]
    shown = [(found, label) for found, label in shown if found]
    groups: dict[str, list[str]] = defaultdict(list)
    for variant in chapter.variants_with([name for name, _ in metrics]):
        groups[str(variant.values.get("network", ""))].append(variant.name)
    groups = dict(sorted(groups.items(), key=lambda group: len(group[1])))
    heights = [len(names) + 2.5 for names in groups.values()]
    canvas = Canvas(figsize=(9.5, 0.27 * sum(heights)), layout="constrained")
    grid = canvas.subplots(
        len(groups), len(shown), squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    for (network, names), panels in zip(groups.items(), grid, strict=True):
        for column, (axes, (found, label)) in enumerate(zip(panels, shown, strict=True)):
            by_name = {s.variant.name: s for s in found}
            rows = [by_name[name] for name in names if name in by_name]
            places = [names.index(s.variant.name) for s in rows]
            if not rows:  # a metric of other networks alone
                axes.set_axis_off()
                continue
            _rows(axes, [chapter.variants[name] for name in names])
            _bars_of_ours(axes, rows, places, COLORS[column])
            axes.tick_params(axis="y", labelsize=8)
            if column:
                axes.set_yticklabels([])
            else:
                axes.set_title(f"network: {network}" if network else "", fontsize=9, loc="left")
            axes.set_xlim(0, None if any(s.mean > 0 for s in rows) else 1)
            axes.set_xlabel(label, fontsize=9)
            bare(axes)
    return svg(canvas)


def svg(canvas: Canvas) -> str:
    """A figure as SVG text, the same bytes each time."""
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "fusionnet", "svg.fonttype": "none"}):
        canvas.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


def _height(chapter: Chapter, figure: Figure, stated: dict[str, Published]) -> float:
    if figure.kind == "ranked":
        most = max(len(chapter.summaries), len(stated))
        return 1.0 + 0.19 * min(most, MOST_RANKED)
    if figure.kind == "bars":
        return 1.1 + 0.3 * len({*stated, *(s.variant.name for s in chapter.summaries)})
    return 3.6


def _label(chapter: Chapter, figure: Figure) -> str:
    return figure.y_label or metric_words(figure.metric or chapter.experiment.metric)


def _bars(
    panels: list[Axes], chapter: Chapter, figure: Figure, stated: dict[str, Published]
) -> None:
    """A row a variant, the same rows in both panels."""
    found = {s.variant.name: s for s in chapter.summaries_of(figure.metric)}
    names = [n for n in chapter.variants if n in found or n in stated]
    places = {name: row for row, name in enumerate(names)}
    for axes in panels:
        _rows(axes, [chapter.variants[name] for name in names])
        axes.set_xlabel(_label(chapter, figure))
    _bars_of_ours(panels[-1], list(found.values()), [places[name] for name in found])
    if stated:
        _bars_of_thesis(panels[0], list(stated.values()), [places[name] for name in stated])
        panels[-1].set_yticklabels([])


def _ranked(
    panels: list[Axes], chapter: Chapter, figure: Figure, stated: dict[str, Published]
) -> None:
    """A row a variant, the best first, in each panel its own rows and its own part of the axis."""
    metric = figure.metric or chapter.experiment.metric
    less = chapter.experiment.lower_is_better if not figure.metric else less_is_better(metric)
    sign = 1 if less else -1
    ours = sorted(chapter.summaries_of(figure.metric), key=lambda s: sign * s.mean)[:MOST_RANKED]
    theirs = sorted(stated.values(), key=lambda p: sign * p.mean)[:MOST_RANKED]
    _rows(panels[-1], [s.variant for s in ours])
    look: dict[str, Any] = {"fmt": "o", "ms": 4, "capsize": 2, "lw": 1}
    means = [s.mean for s in ours]
    panels[-1].errorbar(means, range(len(ours)), xerr=_spread(ours), color=COLORS[0], **look)
    if theirs:
        _rows(panels[0], [chapter.variants[p.variant] for p in theirs])
        spread = [p.deviation or 0.0 for p in theirs]
        means = [p.mean for p in theirs]
        panels[0].errorbar(means, range(len(theirs)), xerr=spread, color=PUBLISHED, **look)
    for axes in panels:
        axes.tick_params(axis="y", labelsize=6.5)
        axes.set_xlabel(_label(chapter, figure))


def _rows(axes: Axes, variants: Sequence[Variant]) -> None:
    axes.set_yticks(range(len(variants)), [v.label or v.name for v in variants])
    axes.set_ylim(len(variants) - 0.4, -0.6)


def _bars_of_ours(
    axes: Axes, rows: Sequence[Summary], places: Sequence[int], color: str = COLORS[0]
) -> None:
    means = [s.mean for s in rows]
    axes.barh(places, means, xerr=_spread(rows), color=color, alpha=0.75, capsize=3)
    for place, summary in zip(places, rows, strict=True):
        axes.plot(summary.values, [place] * len(summary.values), "k.", markersize=3)


def _bars_of_thesis(axes: Axes, stated: Sequence[Published], places: Sequence[int]) -> None:
    spread = [p.deviation or 0.0 for p in stated]
    axes.barh(places, [p.mean for p in stated], xerr=spread, color=PUBLISHED, alpha=0.6, capsize=3)


def _spread(rows: Sequence[Summary]) -> list[list[float]]:
    """How far below and above the mean each interval goes; rounding may leave less than nothing."""
    return [[max(0.0, s.mean - s.low) for s in rows], [max(0.0, s.high - s.mean) for s in rows]]


def _lines(
    panels: list[Axes], chapter: Chapter, figure: Figure, stated: dict[str, Published]
) -> None:
    """A line a value of `series`, with the same colour and mark in both panels."""
    series: dict[str, list[Summary]] = defaultdict(list)
    theirs: dict[str, list[Published]] = defaultdict(list)
    for summary in chapter.summaries_of(figure.metric):
        series[str(summary.variant.values.get(figure.series, ""))].append(summary)
    for number in stated.values():
        values = chapter.variants[number.variant].values
        theirs[str(values.get(figure.series, ""))].append(number)
    for place, name in enumerate(dict.fromkeys([*series, *theirs])):
        look: dict[str, Any] = {
            "color": COLORS[place % len(COLORS)],
            "marker": MARKS[place % len(MARKS)],
        }
        points = sorted(series[name], key=lambda s: s.variant.values[figure.x])
        if points:
            xs = [s.variant.values[figure.x] for s in points]
            means = [s.mean for s in points]
            panels[-1].errorbar(xs, means, _spread(points), capsize=3, label=name, **look)
        numbers = [(chapter.variants[p.variant].values[figure.x], p) for p in theirs[name]]
        if numbers:
            numbers.sort(key=lambda pair: pair[0])
            xs = [x for x, _ in numbers]
            spread = [p.deviation or 0.0 for _, p in numbers]
            panels[0].errorbar(xs, [p.mean for _, p in numbers], spread, capsize=3, **look)
    _over_x(panels, chapter, figure)
    legend(panels[-1])


def _scatter(
    panels: list[Axes], chapter: Chapter, figure: Figure, stated: dict[str, Published]
) -> None:
    for summary in chapter.summaries_of(figure.metric):
        x = summary.variant.values.get(figure.x)
        if x is not None:
            spread = _spread([summary])
            panels[-1].errorbar([x], [summary.mean], spread, fmt="o", color=COLORS[0], ms=4)
    for number in stated.values():
        x = chapter.variants[number.variant].values.get(figure.x)
        if x is not None:
            panels[0].errorbar([x], number.mean, number.deviation, fmt="D", color=PUBLISHED, ms=4)
    _over_x(panels, chapter, figure)


def _over_x(panels: list[Axes], chapter: Chapter, figure: Figure) -> None:
    for axes in panels:
        axes.set_xlabel(figure.x_label or metric_words(figure.x))
        axes.set_ylabel(_label(chapter, figure))
