"""Figures 6.1 and 6.2 of the thesis: how k-medians went, and the boxes that it found."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle

from fusionnet.errors import OutputError
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
        color = COLORS[number % len(COLORS)]
        left.plot(range(1, len(curve) + 1), [100 * v for v in curve], color=color, lw=1.2)
        left.plot(len(curve), 100 * curve[-1], ".", color=color)
    left.set_xlabel("iteration (a dot where no box changed cluster any more)")
    left.set_ylabel("mean IoU [%]")
    left.set_title("(a) each repetition", fontsize=10)
    _boxes(right, clusters.shapes.tolist())
    right.set_title("(b) the boxes of the best one [px]", fontsize=10)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    return canvas


def save_drawing(canvas: Canvas, file: Path) -> None:
    """Write a figure as a picture, aside first.

    Raises:
        OutputError: If it cannot be written.
    """
    aside = file.with_name(f".{file.name}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        canvas.savefig(aside, format="png", dpi=130)
        aside.replace(file)
    except OSError as error:
        raise OutputError(f"Cannot write {file}: {error.strerror or error}.") from error
    finally:
        aside.unlink(missing_ok=True)


def _boxes(axes: Axes, shapes: Sequence[Sequence[float]]) -> None:
    """All boxes about one centre, each with its size."""
    reach = 0.55 * max(max(shape) for shape in shapes)
    for number, (width, height) in enumerate(shapes):
        color = COLORS[number % len(COLORS)]
        label = f"{width:.4g} x {height:.4g}"
        corner = (-width / 2, -height / 2)
        axes.add_patch(Rectangle(corner, width, height, fill=False, ec=color, lw=1.6, label=label))
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False, fontsize=8)
