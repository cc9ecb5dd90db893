"""Figures of what happened within runs: curves over steps, and matrices (attention, confusion)."""

from collections import defaultdict

import numpy as np
from matplotlib.figure import Figure as Canvas

from fusionnet.experiments import Figure, Record
from fusionnet.report.chapters import Chapter
from fusionnet.report.reading import metric_words
from fusionnet.report.style import COLORS, bare, legend

MOST_TICKS = 40
DARK = 0.6
"""Share of a matrix's range from which numbers upon it are white."""


def draw_curves(chapter: Chapter, figure: Figure) -> Canvas:
    """A curve of every run (thin) and the mean of each variant's (thick)."""
    canvas = Canvas(figsize=(8.6, 3.6), layout="constrained")
    axes = canvas.add_subplot()
    by_variant: dict[str, list[Record]] = defaultdict(list)
    for record in chapter.records:
        if figure.metric in record.curves:
            by_variant[record.variant.name].append(record)
    names = [n for n in chapter.variants if n in by_variant]
    for place, name in enumerate(names):
        color = COLORS[place % len(COLORS)]
        line = ("-", "--", ":")[place // len(COLORS) % 3]
        curves = [r.curves[figure.metric] for r in by_variant[name]]
        length = min(map(len, curves))
        steps = by_variant[name][0].curves.get(figure.x, list(range(1, length + 1)))[:length]
        for curve in curves:
            axes.plot(steps, curve[:length], line, color=color, lw=0.5, alpha=0.5)
        mean = np.mean([curve[:length] for curve in curves], axis=0)
        label = chapter.variants[name].label or name
        axes.plot(steps, mean, line, color=color, lw=1.8, label=label)
    axes.set_xlabel(figure.x_label or metric_words(figure.x or "step"))
    axes.set_ylabel(figure.y_label or metric_words(figure.metric))
    if figure.logarithmic:
        axes.set_yscale("log")
    bare(axes)
    if len(names) > 1:
        legend(axes, beside=len(names) > 3)
    return canvas


def draw_matrix(chapter: Chapter, figure: Figure) -> Canvas:
    """The matrix of the first run that has it, dark where it is large."""
    found = [r.details[figure.metric] for r in chapter.records if figure.metric in r.details]
    if not found:
        return Canvas(figsize=(1.0, 0.1))
    rows, columns = found[0]["rows"], found[0]["columns"]
    values = np.array(found[0]["values"], dtype=float)
    size = (2.2 + 0.26 * len(columns), 1.6 + 0.24 * len(rows))
    canvas = Canvas(figsize=size, layout="constrained")
    axes = canvas.add_subplot()
    image = axes.imshow(values, cmap="Blues", aspect="auto", vmin=min(0.0, float(values.min())))
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    if values.size <= MOST_TICKS**2 // 4 and len(columns) <= MOST_TICKS // 2:
        limit = DARK * float(values.max())
        for (row, column), value in np.ndenumerate(values):
            color = "white" if value > limit else "black"
            axes.text(column, row, f"{value:.2g}", ha="center", va="center", c=color, fontsize=5.5)
    axes.set_xlabel(figure.x_label)
    axes.set_ylabel(figure.y_label)
    canvas.colorbar(image, ax=axes, shrink=0.8)
    return canvas
