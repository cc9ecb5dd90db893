"""Figures 6.1 and 6.2 of the thesis: how k-medians went, and the boxes that it found."""

import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from fusionnet.files import write_whole
from fusionnet.models.anchors import Clusters
from fusionnet.report.figures import COLORS


def draw_clusters(title: str, clusters: Clusters) -> Canvas:
    """Mean IoU of every repetition (a), and the boxes of the best one about one centre (b).

    Args:
        title: What was clustered, for example "training pictures, cropped".
        clusters: What k-medians found.
    """
    canvas = Canvas(figsize=(9.0, 4.0), layout="constrained")
    left, right = canvas.subplots(1, 2)
    canvas.suptitle(f"{title}: mean IoU {clusters.mean_iou:.2%}")
    for number, curve in enumerate(clusters.curves):
        color, style = COLORS[number % len(COLORS)], "-" if number < len(COLORS) else "--"
        left.plot(range(1, len(curve) + 1), [100 * v for v in curve], style, color=color, lw=1.2)
        left.plot(len(curve), 100 * curve[-1], ".", color=color)
    left.set_xlabel("iteration (a dot where no box changed cluster any more)")
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    left.set_ylabel("mean IoU [%]")
    left.set_title("(a) each repetition", fontsize=10)
    _boxes(right, clusters.shapes.tolist())
    right.set_title("(b) the boxes of the best one [px]", fontsize=10)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    return canvas


def save_drawing(canvas: Canvas, file: Path) -> None:
    """Write a figure as a picture, whole or not at all.

    Raises:
        OutputError: If it cannot be written.
    """
    picture = io.BytesIO()
    canvas.savefig(picture, format="png", dpi=130)
    write_whole(file, picture.getvalue())


def _boxes(axes: Axes, shapes: Sequence[Sequence[float]]) -> None:
    """All boxes about one centre, each with its size."""
    reach = 0.55 * max(max(shape) for shape in shapes)
    for number, (width, height) in enumerate(shapes):
        color, style = COLORS[number % len(COLORS)], "-" if number < len(COLORS) else "--"
        label = f"{width:.4g} x {height:.4g}"
        corner = (-width / 2, -height / 2)
        drawn = Rectangle(
            corner, width, height, fill=False, ec=color, ls=style, lw=1.6, label=label
        )
        axes.add_patch(drawn)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False, fontsize=8)
