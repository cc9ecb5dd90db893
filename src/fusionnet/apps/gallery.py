"""A page of the episodes that failed: what was seen, read, wanted and done, one card each.

Everything is inside the one file: no scripts, no external resources; it follows the reader's
light or dark setting.
"""

from collections import Counter
from collections.abc import Mapping
from html import escape
from importlib import resources
from typing import Any

from fusionnet.apps.board_drawing import board_svg, highest_level
from fusionnet.apps.drawing import Box, draw_boxes, webp
from fusionnet.blocks import Cell
from fusionnet.evaluation.policy import Watched
from fusionnet.policy import Answer

MOST = 100
"""Failures that a page shows; with more it would not open."""

_EXPLAINED = {
    "not understood": "the sentence was refused",
    "doubted": "the two policies disagreed, so nothing was moved",
    "read wrong": "the tree that was acted on does not reach the layout that was asked for",
    "saw wrong": "the planner, given what was seen, moves another block or to another place",
    "pointed wrong": "seen and read right, but the arm was sent to another cell",
    "slipped": "the right cells, but the block did not come to rest there",
}

_STYLE = """
.cards { display: grid; gap: 20px; }
.card { display: grid; grid-template-columns: repeat(auto-fit, minmax(280px, 1fr)); gap: 18px; }
.card h2 { grid-column: 1 / -1; }
.card h2::before { content: "\\201C"; } .card h2::after { content: "\\201D"; }
.card figure { margin: 0; } .card figcaption { color: var(--soft); font-size: 14px; }
.card img, .card svg { width: 100%; height: auto; border-radius: 8px; }
.card dl { margin: 0; font-size: 15px; } .card dt { color: var(--soft); margin-top: 8px; }
.card dd { margin: 0; overflow-wrap: anywhere; }
h1::before, h1::after { content: none; }
"""


class Gallery:
    """Collects the failed episodes of an evaluation, and draws them as one page."""

    def __init__(self) -> None:
        self.failures: list[Watched] = []
        self.episodes = 0

    def __call__(self, watched: Watched) -> None:
        """Take note of one episode."""
        self.episodes += 1
        if watched.record.outcome != "reached":
            self.failures.append(watched)

    def page(self, numbers: Mapping[str, Any]) -> str:
        """The whole page as HTML.

        Args:
            numbers: What the evaluation measured, as its report prints it.
        """
        style = resources.files("fusionnet.apps").joinpath("page.css").read_text("utf-8")
        counts = Counter(watched.record.outcome for watched in self.failures)
        listed = "".join(
            f"<li>{escape(kind)} <b>{count}</b>: {escape(_EXPLAINED.get(kind, ''))}</li>"
            for kind, count in counts.most_common()
        )
        more = len(self.failures) - MOST
        left = f"<p>{more} more failures are not shown.</p>" if more > 0 else ""
        cards = "".join(_card(watched) for watched in self.failures[:MOST])
        low, high = numbers["executed_success_95"]
        said = (
            f"{len(self.failures)} of {self.episodes} episodes failed; executed success "
            f"{numbers['executed_success']:.1%}, 95 % interval {low:.1%} to {high:.1%}."
        )
        facts = "".join(
            f"<li>{escape(name)} <b>{escape(str(numbers[name]))}</b></li>"
            for name in ("corpus", "split", "policy", "checkpoint", "strength", "seed")
            if name in numbers
        )
        return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Failures · FusionNet</title>
<style>
{style}{_STYLE}</style>
</head>
<body>
<main>
<header>
<div class="name">FusionNet</div>
<h1>{"What failed" if self.failures else "Nothing failed"}</h1>
<div class="verdict">{escape(said)}</div>
<ul class="facts">{facts}</ul>
<ul class="facts">{listed}</ul>
</header>
<div class="cards">{cards}</div>{left}
</main>
</body>
</html>
"""


def _card(watched: Watched) -> str:
    """One failed episode."""
    record, answer, command = watched.record, watched.answer, watched.command
    boxes = [] if answer is None else [Box(b.class_name, b.score, b.box) for b in answer.boxes]
    facts = [
        ("blamed", record.outcome),
        ("what happened", record.reason),
        ("asked for", f"{_cell(watched.wanted.source)} to {_cell(watched.wanted.target)}"),
    ]
    if answer is not None:
        facts += [
            ("pointed at", f"{_cell(answer.source_cell)} to {_cell(answer.target_cell)}"),
            ("understood", answer.understood),
            (
                "joint error",
                f"grasp {record.grasp_degrees:.2f}°, place {record.place_degrees:.2f}°",
            ),
        ]
    if isinstance(answer, Answer):
        sure = f"{answer.confidence:.0%}; the planner's vote {answer.agreement:.0%}"
        facts.append(("confidence", sure))
    listed = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in facts)
    layouts = [(command.scene.before, watched.wanted, "as it was; the arrow was asked for")]
    if isinstance(answer, Answer):
        layouts.append((answer.layout, answer.move, "as it was read; the arrow is the planner's"))
    levels = 1 + max(highest_level(layout, move) for layout, move, _ in layouts)
    drawn = "".join(
        f"<figure>{board_svg(layout, move=move, levels=levels, title=caption)}"
        f"<figcaption>{caption}</figcaption></figure>"
        for layout, move, caption in layouts
    )
    return f"""<section class="card">
<h2>{escape(command.sentence)}</h2>
<figure><img src="{webp(draw_boxes(watched.image, boxes))}" alt="What the left eye saw">
<figcaption>what the left eye saw, with the blocks that were found</figcaption></figure>
{drawn}<dl>{listed}</dl>
</section>
"""


def _cell(cell: Cell | None) -> str:
    return "off the board" if cell is None else f"({cell.x}, {cell.y}, {cell.z})"
