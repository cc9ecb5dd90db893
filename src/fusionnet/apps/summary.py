"""What a run saw, understood and did, in the terminal."""

from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from fusionnet import rcl, robots
from fusionnet.apps.drawing import PAINT, hexadecimal
from fusionnet.apps.run_record import RunRecord
from fusionnet.policy import Answer

_GUTTER = 11
"""Columns for the headings at the left."""


def print_summary(record: RunRecord, out: Path | None, console: Console | None = None) -> None:
    """Print the summary of a run.

    Args:
        record: What happened.
        out: The folder that was written, if one was.
        console: Where to; standard output by default.
    """
    console = console or Console(highlight=False)
    table = Table.grid(padding=(0, 1))
    table.add_column(style="bold cyan", width=_GUTTER)
    table.add_column()
    answer = record.answer
    table.add_row("said", Text(record.sentence, style="bold"))
    table.add_row(
        "scene",
        f"{escape(record.origin)}; {record.robot}, policy {record.policy} of "
        f"{escape(record.checkpoint)}",
    )
    table.add_row("saw", _saw(record))
    table.add_row("understood", Text(answer.understood))
    if answer.tree is not None:
        table.add_row("", Text(rcl.format(answer.tree, tokens=False), style="dim"))
    if isinstance(answer, Answer):
        source, target = tuple(answer.move.source), tuple(answer.move.target)
        table.add_row("planned", f"cell {source} to {target}, sure to {answer.confidence:.0%}")
    robot = robots.load(record.robot)
    names = robot.joint_names
    table.add_row("answered", Text("".join(f"{_short(name):>9}" for name in names), style="dim"))
    for name, pose in (("grasp", answer.grasp), ("place", answer.place)):
        values = zip(names, pose.joint_angles, strict=True)
        angles = "".join(f" {robot.with_unit(name, float(a)):>8}" for name, a in values)
        state = "closed" if pose.gripper >= 0.5 else "open"
        table.add_row(f"  {name}", f"{angles} {state}")
    total = sum(answer.milliseconds.values())
    table.add_row("", f"[dim]in {total:.0f} ms[/dim]")
    table.add_row("did", Text(record.verdict, style=_style(record)))
    if out is not None:
        table.add_row("look", Text(str(out / "index.html"), style="underline"))
    console.print()
    console.print(table, soft_wrap=not console.is_terminal)
    console.print()


def _saw(record: RunRecord) -> Text:
    counts = Counter((box.label, box.color) for box in record.boxes)
    text = Text()
    for (label, color), count in sorted(counts.items()):
        text.append(", " if text else "")
        text.append("■ " if label.endswith("cube") else "▲ ", style=hexadecimal(PAINT[color]))
        text.append(label if count == 1 else f"{count} × {label}")
    text.append("no block" if not counts else "")
    return text


def _style(record: RunRecord) -> str:
    return {True: "bold green", False: "bold red", None: "bold"}[record.episode.success]


def _short(joint: str) -> str:
    """A joint's name without the side of its arm, in eight letters at most."""
    return joint.removeprefix("l_").removeprefix("r_").replace("shoulder", "shldr")[:8]
