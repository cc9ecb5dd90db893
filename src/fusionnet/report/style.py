"""How all figures look."""

from typing import Any

from matplotlib.axes import Axes

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Of Okabe and Ito, which colour-blind people can tell apart."""

MARKS = "osv^Dp*"

PUBLISHED = "#555555"
"""The thesis's numbers."""


def bare(axes: Axes) -> None:
    """No frame where nothing is read off it."""
    axes.spines[["top", "right"]].set_visible(False)


def legend(axes: Axes, *, beside: bool = False) -> None:
    """What the colours mean, once each, in the figure or beside it; nothing if nothing."""
    handles, labels = axes.get_legend_handles_labels()
    unique = {label: handle for handle, label in zip(handles, labels, strict=True) if label}
    if unique:
        place: dict[str, Any] = (
            {"loc": "center left", "bbox_to_anchor": (1.01, 0.5)} if beside else {}
        )
        axes.legend(list(unique.values()), list(unique), frameon=False, fontsize=8, **place)
