"""A picture of where a translator looked while it wrote: words down, symbols across.

References:
    Thesis, figure 5.5.
"""

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

from fusionnet.files import write_whole
from fusionnet.models.reading import Reading

INK, PAPER = "#1d2430", "#fefefe"

_CELL = 0.17
_LETTER = 0.075
"""Inches: side of a cell, width of a letter."""


def draw_attention(reading: Reading, file: Path) -> None:
    """Draw a reading's attention into a file; its ending (.png, .svg) says how.

    Raises:
        OutputError: If the file cannot be written.
    """
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot
    from matplotlib.ticker import MaxNLocator

    rows, columns = len(reading.words), len(reading.symbols)
    left = 0.3 + _LETTER * max(map(len, reading.words))
    below = 0.3 + _LETTER * max(map(len, reading.symbols))
    width, height = columns * _CELL, rows * _CELL
    whole = max(left + width + 0.9, 4.5), below + height + 0.5
    style: dict[Any, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": "fusionnet",
        "font.family": ["DejaVu Sans"],
        "font.size": 8,
        "text.parse_math": False,
        "text.color": INK,
    }
    with matplotlib.rc_context(style), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # words in scripts that the font lacks
        figure = pyplot.figure(figsize=whole, facecolor=PAPER)
        try:
            box = (left / whole[0], below / whole[1], width / whole[0], height / whole[1])
            axes = figure.add_axes(box)
            shown = axes.imshow(reading.attention.T, cmap="viridis", vmin=0, aspect="auto")
            axes.set_xticks(range(columns), reading.symbols, rotation=90, family="monospace")
            axes.set_yticks(range(rows), reading.words)
            axes.tick_params(length=0, colors=INK)
            axes.set_title("attention: words down, what was written across", loc="left", fontsize=8)
            bar = figure.add_axes(
                ((left + width + 0.15) / whole[0], box[1], 0.1 / whole[0], box[3])
            )
            figure.colorbar(shown, cax=bar, ticks=MaxNLocator(3)).outline.set_visible(False)
            metadata = {"Date": None} if file.suffix == ".svg" else None
            content = BytesIO()
            figure.savefig(content, format=file.suffix[1:], dpi=150, metadata=metadata)
        finally:
            pyplot.close(figure)
    write_whole(file, content.getvalue())
