"""The parts of a run's page that show why: reading, board, attention, answer, time."""

import re
from collections.abc import Iterable
from html import escape

from fusionnet import rcl, robots
from fusionnet.apps import tree_drawing
from fusionnet.apps.board_drawing import board_svg, heat_svg, highest_level
from fusionnet.apps.drawing import around, spotlight, webp
from fusionnet.apps.run_record import RunRecord
from fusionnet.blocks import Layout, Move
from fusionnet.policy import Answer


def understood(record: RunRecord, tree_svg: str | None) -> str:
    """What was understood: in English, as a tree over its words, and as text."""
    answer = record.answer
    said = f'<p class="said">{escape(answer.understood)}</p>'
    if answer.tree is None or tree_svg is None:
        return f"<section>\n<h2>What it understood</h2>\n{said}\n</section>\n"
    considered = answer.readings if isinstance(answer, Answer) else ()
    readings = "".join(
        f"<tr><td>{escape(rcl.describe(reading.tree))}</td>"
        f'<td class="number">{reading.probability:.1%}</td>'
        f'<td class="wide">{_bar(reading.probability)}</td></tr>'
        for reading in considered
    )
    others = (
        f"<details><summary>All readings that were considered, with their probabilities</summary>"
        f'<div class="scroll"><table>{readings}</table></div></details>'
        if len(considered) > 1
        else ""
    )
    return f"""<section>
<h2>What it understood</h2>
{said}
<div class="scroll">{_themed(tree_svg)}</div>
<details open><summary>As Robot Command Language</summary>
<pre>{escape(rcl.format(answer.tree))}</pre></details>
{others}</section>
"""


def _themed(tree_svg: str) -> str:
    """The tree's picture without its own background, in the colours of the page."""
    svg = tree_svg[tree_svg.index("<svg") :]
    points = float(re.search(r'width="([\d.]+)pt"', svg)[1])  # type: ignore[index]
    size = f"width:{1.5 * points:.0f}px;min-width:{min(0.95 * points, 1.5 * points):.0f}px"
    svg = re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', f'style="{size}"', svg, count=1)
    for color, name in (
        (tree_drawing.INK, "--ink"),
        (tree_drawing.SOFT, "--soft"),
        (tree_drawing.LINE, "--soft"),
        (tree_drawing.PAPER, "--card"),
    ):
        svg = svg.replace(color, f"var({name})")
    return svg.replace("'DejaVu Sans'", "inherit")


def boards(record: RunRecord) -> str:
    """The layout as it was read, as it was, and as it became."""
    answer = record.answer
    figures: list[tuple[Layout, Move | None, str]] = []
    said = ""
    if isinstance(answer, Answer):
        figures.append((answer.layout, answer.move, "as the network read the picture"))
        said = f"""<p>The arrow is the move that the planner makes of the command in what was read;
{answer.agreement:.0%} of the layouts sampled from the picture agree on it.</p>
"""
    if not record.layout_is_read:
        figures.append((record.layout, None, "as it was"))
    figures.append((record.episode.layout_after, None, "after the episode"))
    levels = 1 + max(highest_level(layout, move) for layout, move, _ in figures)
    drawn = "".join(
        f"<figure>{board_svg(layout, move=move, levels=levels, title=caption)}"
        f"<figcaption>{caption}</figcaption></figure>"
        for layout, move, caption in figures
    )
    return f"""<section>
<h2>The board</h2>
{said}<div class="boards">{drawn}</div>
</section>
"""


def attended(record: RunRecord) -> str:
    """For each part of the command: its words, and what they were taken to be in the picture."""
    answer = record.answer
    if not isinstance(answer, Answer) or not answer.attention:
        return ""
    part = around(record.boxes, record.picture.shape[1::-1])
    cards = "".join(
        f"""<figure><div class="picture"><img
src="{webp(spotlight(record.picture, answer.pixels(attention), part))}"
alt="The picture, with {escape(attention.label)} lit"></div>
<figcaption><b>{escape(_TITLES.get(attention.label, attention.label))}</b>
<span class="words">{_marked(attention.words)}</span>
<span class="cell">{heat_svg(attention.cells, title="Its squares of the board")}
cell {tuple(attention.cell)}, {float(attention.cells.max()):.0%}</span></figcaption></figure>
"""
        for attention in answer.attention
    )
    return f"""<section>
<h2>What it looked at</h2>
<p>Each part of the command that stands for something on the table: the words that it was read
from are marked, and what the network took it to be is lit in the picture and on the board.</p>
<div class="boards attended">{cards}</div>
</section>
"""


_TITLES = {"grasp": "where the hand grasps", "place": "where the block goes"}


def _marked(words: Iterable[tuple[str, float]]) -> str:
    """Words, each marked as strongly as it was looked at beside the one that was most."""
    words = list(words)
    most = max((share for _, share in words), default=0.0)
    return " ".join(
        f'<mark style="--share:{share / most:.0%}" title="{share:.0%}">{escape(word)}</mark>'
        if most > 0 and share >= 0.05 * most
        else escape(word)
        for word, share in words
    )


def answered(record: RunRecord) -> str:
    """The fourteen values, each joint within its limits."""
    robot = robots.load(record.robot)
    answer = record.answer
    rows = []
    for i, name in enumerate(robot.joint_names):
        low, high = (float(v) for v in robot.joint_limits[i])
        grasp, place = float(answer.grasp.joint_angles[i]), float(answer.place.joint_angles[i])
        marks = "".join(
            f'<i class="{kind}" style="left:{_percent(value, low, high):.1f}%"></i>'
            for kind, value in (("grasp", grasp), ("place", place))
        )
        rows.append(
            f'<tr><td>{escape(name)}</td><td class="number">{robot.with_unit(name, grasp)}</td>'
            f'<td class="number">{robot.with_unit(name, place)}</td>'
            f'<td class="wide"><div class="track">{marks}</div></td>'
            f'<td class="number">{robot.with_unit(name, low, 0)} … '
            f"{robot.with_unit(name, high, 0)}</td></tr>"
        )
    states = ["closed" if pose.gripper >= 0.5 else "open" for pose in (answer.grasp, answer.place)]
    rows.append(
        f'<tr><td>gripper</td><td class="number">{states[0]}</td>'
        f'<td class="number">{states[1]}</td><td></td><td></td></tr>'
    )
    return f"""<section class="half">
<h2>What it answered</h2>
<p>The values of the arm's joints for the grasp and for the place, within their limits.</p>
<table><tr><th>joint</th><th class="number"><span class="key"></span>grasp</th>
<th class="number"><span class="key place"></span>place</th><th></th>
<th class="number">limits</th></tr>{"".join(rows)}</table>
</section>
"""


def reckoned(record: RunRecord) -> str:
    """Time by stage, and confidence."""
    answer = record.answer
    milliseconds = answer.milliseconds
    sure = f"; confidence in the move {answer.confidence:.0%}" if isinstance(answer, Answer) else ""
    total = sum(milliseconds.values())
    rows = "".join(
        f'<tr><td>{escape(stage.replace("_", " "))}</td><td class="number">{duration(value)}</td>'
        f'<td class="wide">{_bar(value / total if total else 0)}</td></tr>'
        for stage, value in milliseconds.items()
    )
    return f"""<section class="half">
<h2>How long, how sure</h2>
<p>{duration(total)} to answer{sure}.</p>
<table>{rows}</table>
</section>
"""


def _bar(share: float) -> str:
    return f'<div class="bar"><i style="width:{100 * min(max(share, 0), 1):.1f}%"></i></div>'


def duration(milliseconds: float) -> str:
    """For people: "84 ms", or "2.3 s"."""
    return f"{milliseconds:.0f} ms" if milliseconds < 2000 else f"{milliseconds / 1000:.1f} s"


def _percent(value: float, low: float, high: float) -> float:
    return 100 * min(max((value - low) / (high - low), 0), 1)
