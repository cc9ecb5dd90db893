"""A page that shows one run: what the robot saw, understood and did.

Everything is inside the one file, so that it can be sent and kept: no scripts, no
external resources; it follows the reader's light or dark setting.
"""

import base64
import json
from collections import Counter
from html import escape
from importlib import resources
from typing import Any

import numpy as np

from fusionnet.apps.drawing import PAINT, Box, around, hexadecimal, webp
from fusionnet.apps.page_evidence import (
    answered,
    attended,
    boards,
    duration,
    reckoned,
    understood,
)
from fusionnet.apps.run_record import RunRecord


def page(
    record: RunRecord,
    *,
    seen: np.ndarray,
    tree_svg: str | None,
    video: bytes,
    document: dict[str, Any],
) -> str:
    """The whole page as HTML.

    Args:
        record: What happened.
        seen: The picture with its boxes drawn, RGB.
        tree_svg: The tree's picture, as `draw_tree` wrote it; None without a tree.
        video: The episode, as mp4.
        document: What result.json holds.
    """
    style = resources.files("fusionnet.apps").joinpath("page.css").read_text("utf-8")
    sections = [
        _saw(record, seen),
        _did(record, video),
        understood(record, tree_svg),
        boards(record),
        attended(record),
        answered(record),
        reckoned(record),
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
        ("checkpoint", record.checkpoint),
        ("robot", record.robot),
        ("scene", record.origin),
        ("answered in", duration(total)),
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
<div class="picture"><img src="{webp(seen)}" alt="The blocks, each with a box and its name">
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


def _provenance(document: dict[str, Any]) -> str:
    text = json.dumps({k: v for k, v in document.items() if k != "answer"}, indent=1)
    return f"""<section>
<h2>Everything, as numbers</h2>
<p>result.json beside this page holds this and the whole answer.</p>
<details><summary>Show</summary><pre>{escape(text)}</pre></details>
</section>
"""
