"""A page that shows one run: what the robot saw, understood and did.

Everything is inside the one file, so that it can be sent and kept: no scripts, no
external resources; it follows the reader's light or dark setting.
"""

import base64
import io
import json
import re
from collections import Counter
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from PIL import Image

from fusionnet import rcl, robots
from fusionnet.apps import tree_drawing
from fusionnet.apps.board_drawing import board_svg, heat_svg, highest_level
from fusionnet.apps.drawing import PAINT, Box, around, hexadecimal
from fusionnet.apps.run_record import RunRecord
from fusionnet.blocks import Cell, Layout, Move


def page(
    record: RunRecord, *, seen: np.ndarray, tree_svg: str, video: bytes, document: dict[str, Any]
) -> str:
    """The whole page as HTML.

    Args:
        record: What happened.
        seen: The picture with its boxes drawn, RGB.
        tree_svg: The tree's picture, as `draw_tree` wrote it.
        video: The episode, as mp4.
        document: What result.json holds.
    """
    style = resources.files("fusionnet.apps").joinpath("page.css").read_text("utf-8")
    sections = [
        _saw(record, seen),
        _did(record, video),
        _understood(record, tree_svg),
        _boards(record),
        _attended(record),
        _answered(record),
        _reckoned(record),
        _provenance(document),
    ]
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(record.sentence)} · FusionNet</title>
<style>
{style}</style>
</head>
<body>
<main>
{_header(record)}
<div class="grid">
{"".join(sections)}
</div>
<footer>Written by fusionnet {escape(document["versions"]["fusionnet"])}. Cells are (x, y, z):
x 0 is nearest the robot, y 0 right-most in its view, z 0 on the table.</footer>
</main>
</body>
</html>
"""


def _header(record: RunRecord) -> str:
    kind = {True: "good", False: "bad", None: ""}[record.episode.success]
    total = sum(record.answer.milliseconds.values())
    facts = [
        ("policy", record.policy),
        ("robot", record.robot),
        ("scene", record.origin),
        ("answered in", _duration(total)),
    ]
    listed = "".join(f"<li>{escape(name)} <b>{escape(value)}</b></li>" for name, value in facts)
    return f"""<header>
<div class="name">FusionNet</div>
<h1>{escape(record.sentence)}</h1>
<div class="verdict {kind}">{escape(record.verdict)}</div>
<ul class="facts">{listed}</ul>
</header>"""


def _saw(record: RunRecord, seen: np.ndarray) -> str:
    height, width = record.picture.shape[:2]
    left, top, right, bottom = around(record.boxes, (width, height))
    part = f"{left} {top} {right - left} {bottom - top}"
    boxes = "".join(_hover(box) for box in reversed(record.boxes))
    counts = Counter((box.class_name, box.label, box.color) for box in record.boxes)
    chips = "".join(
        f'<li><i class="{name.partition("_")[0]}" style="background:{hexadecimal(PAINT[color])}">'
        f"</i>{escape(label)}{f' × {count}' if count > 1 else ''}</li>"
        for (name, label, color), count in sorted(counts.items())
    )
    number = len(record.boxes)
    return f"""<section class="half">
<h2>What it saw</h2>
<p>{number} block{"" if number == 1 else "s"} in the picture, enlarged here; point at one for
its score.</p>
<div class="picture"><img src="{_webp(seen)}" alt="The blocks, each with a box and its name">
<svg viewBox="{part}" preserveAspectRatio="none">{boxes}</svg></div>
<ul class="chips">{chips}</ul>
</section>
"""


def _hover(box: Box) -> str:
    left, top, right, bottom = box.corners
    return (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" '
        f'height="{bottom - top:.1f}"><title>{escape(box.label)}, {box.score:.0%}</title></rect>'
    )


def _did(record: RunRecord, video: bytes) -> str:
    data = base64.b64encode(video).decode("ascii")
    episode = record.episode
    measured = [f"{episode.seconds:.1f} s of simulated time"]
    if episode.grasp_distance is not None:
        measured.append(f"grasp {episode.grasp_distance:.1f} mm off")
    if episode.grasped is not None:
        measured.append(f"neighbours moved {episode.displacement:.2f} mm at most")
    facts = "".join(f"<li>{escape(fact)}</li>" for fact in measured)
    return f"""<section class="half">
<h2>What it did</h2>
<p>{escape(_capital(record.episode.reason))}</p>
<div class="picture"><video controls autoplay muted loop playsinline
src="data:video/mp4;base64,{data}">Your browser shows no video; see episode.mp4.</video></div>
<ul class="chips">{facts}</ul>
</section>
"""


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _understood(record: RunRecord, tree_svg: str) -> str:
    tree = record.answer.tree
    readings = "".join(
        f"<tr><td>{escape(rcl.describe(reading.tree))}</td>"
        f'<td class="number">{reading.probability:.1%}</td>'
        f'<td class="wide">{_bar(reading.probability)}</td></tr>'
        for reading in record.answer.readings
    )
    others = (
        f"<details><summary>All readings that were considered, with their probabilities</summary>"
        f'<div class="scroll"><table>{readings}</table></div></details>'
        if len(record.answer.readings) > 1
        else ""
    )
    return f"""<section>
<h2>What it understood</h2>
<p class="said">{escape(rcl.describe(tree))}</p>
<div class="scroll">{_themed(tree_svg)}</div>
<details open><summary>As Robot Command Language</summary>
<pre>{escape(rcl.format(tree))}</pre></details>
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


def _boards(record: RunRecord) -> str:
    answer = record.answer
    figures: list[tuple[Layout, Move | None, str]] = [
        (answer.layout, answer.move, "as the network read the picture")
    ]
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
<p>The arrow is the move that the planner makes of the command in what was read;
{answer.agreement:.0%} of the layouts sampled from the picture agree on it.</p>
<div class="boards">{drawn}</div>
</section>
"""


def _attended(record: RunRecord) -> str:
    """Where each part of the command looked on the board, and where the arm will go."""
    answer = record.answer
    maps = [*answer.attention, ("grasp", answer.source), ("place", answer.target)]
    drawn = "".join(
        f"<figure>{heat_svg(cells, title=label)}<figcaption>{escape(label)}<br>{_most(cells)}"
        "</figcaption></figure>"
        for label, cells in maps
    )
    return f"""<section>
<h2>Where it looked</h2>
<p>How likely each square is what the words mean, from every part of the command to the grasp and
the place; the most likely cell stands below.</p>
<div class="boards small">{drawn}</div>
</section>
"""


def _most(cells: np.ndarray) -> str:
    best = int(np.argmax(cells))
    return f"{tuple(Cell.from_index(best))}, {float(cells[best]):.0%}"


def _answered(record: RunRecord) -> str:
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
            f'<tr><td>{escape(name)}</td><td class="number">{np.degrees(grasp):.1f}°</td>'
            f'<td class="number">{np.degrees(place):.1f}°</td>'
            f'<td class="wide"><div class="track">{marks}</div></td>'
            f'<td class="number">{np.degrees(low):.0f}° … {np.degrees(high):.0f}°</td></tr>'
        )
    states = ["closed" if pose.gripper >= 0.5 else "open" for pose in (answer.grasp, answer.place)]
    rows.append(
        f'<tr><td>gripper</td><td class="number">{states[0]}</td>'
        f'<td class="number">{states[1]}</td><td></td><td></td></tr>'
    )
    return f"""<section class="half">
<h2>What it answered</h2>
<p>The arm's joint angles for the grasp and for the place, within their limits.</p>
<table><tr><th>joint</th><th class="number"><span class="key"></span>grasp</th>
<th class="number"><span class="key place"></span>place</th><th></th>
<th class="number">limits</th></tr>{"".join(rows)}</table>
</section>
"""


def _reckoned(record: RunRecord) -> str:
    milliseconds = record.answer.milliseconds
    total = sum(milliseconds.values())
    rows = "".join(
        f'<tr><td>{escape(stage.replace("_", " "))}</td><td class="number">{_duration(value)}</td>'
        f'<td class="wide">{_bar(value / total if total else 0)}</td></tr>'
        for stage, value in milliseconds.items()
    )
    return f"""<section class="half">
<h2>How long, how sure</h2>
<p>{_duration(total)} to answer; confidence in the move {record.answer.confidence:.0%}.</p>
<table>{rows}</table>
</section>
"""


def _provenance(document: dict[str, Any]) -> str:
    text = json.dumps({k: v for k, v in document.items() if k != "answer"}, indent=1)
    return f"""<section>
<h2>Everything, as numbers</h2>
<p>result.json beside this page holds this and the whole answer.</p>
<details><summary>Show</summary><pre>{escape(text)}</pre></details>
</section>
"""


def _bar(share: float) -> str:
    return f'<div class="bar"><i style="width:{100 * min(max(share, 0), 1):.1f}%"></i></div>'


def _duration(milliseconds: float) -> str:
    return f"{milliseconds:.0f} ms" if milliseconds < 2000 else f"{milliseconds / 1000:.1f} s"


def _percent(value: float, low: float, high: float) -> float:
    return 100 * min(max((value - low) / (high - low), 0), 1)


def _webp(image: np.ndarray) -> str:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "webp", quality=88)
    return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
