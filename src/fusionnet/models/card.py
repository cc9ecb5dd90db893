"""The model card of a checkpoint: what it is, its data, training, numbers, limits, intended use.

It is made of the checkpoint's own configuration, so it never says more than the file knows.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fusionnet.errors import CheckpointError
from fusionnet.files import write_whole
from fusionnet.models.checkpoint import CONFIG_FILE, read_document
from fusionnet.models.hub import CARD_FILE

_KINDS = {
    "retinanet": "a detector: from a picture to boxes and, in the compact form, the layout",
    "translator": "a translator: from an English command to its Robot Command Language tree",
    "transformer": "the thesis's Transformer: from an English command to its tree's text",
    "fusionnet": "FusionNet: from what was seen and a command's tree to fourteen joint values",
    "thesis-fusionnet": "the thesis's FusionNet: from a picture and a sentence to fourteen "
    "joint values",
}

_USE = """\
## Intended use

Research and teaching of language-conditioned pick and place: coloured cubes and pyramids on a
board of 8x8 squares, commanded in English, moved by {robot} in simulation.
{load}
## Limits

- It knows sixteen kinds of block (two shapes, eight colours) in cells of one grid; anything else
  on the table is not seen, or is taken for a block.
- Its joint values belong to {robot} and its board; another robot is refused when it is loaded.
- It was measured in simulation. On a real arm use it only where a wrong movement harms nobody,
  with the arm's own limits and an emergency stop.
- Sentences are English. What it does not understand it refuses or, worse, misreads: look at the
  tree that it answers with.
"""


def model_card(document: Mapping[str, Any]) -> str:
    """The card of one checkpoint, from the document in its `config.json`."""
    kind = str(document.get("kind"))
    what = _KINDS.get(kind, f"a checkpoint of the kind {kind}")
    config, metadata = document.get("config", {}), document.get("metadata", {})
    robot = str(config.get("robot", "the robot that it was trained for"))
    parts = [
        _header(kind),
        f"# {kind}\n\nThis is {what}. It belongs to the package `fusionnet`; the weights are "
        "safetensors, the configuration JSON, nothing is executed when it is loaded.\n",
        _section("Data and training", metadata.get("training", {})),
        _section("Numbers", metadata.get("metrics", {})),
        _USE.format(robot=robot, load=_loading(kind)),
    ]
    return "\n".join(part for part in parts if part)


def policy_card(folder: Path) -> str:
    """The card of a whole policy: a folder that holds `detector`, `translator` and `fusion`.

    There may be `detector-right` besides.

    Raises:
        CheckpointError: If one of them is missing or damaged.
    """
    parts_there = ["detector", "translator", "fusion"]
    if (folder / "detector-right").is_dir():
        parts_there.insert(1, "detector-right")
    documents = {part: read_document(folder / part) for part in parts_there}
    robot = str(documents["fusion"].get("config", {}).get("robot", "the robot"))
    parts = [
        _header("policy"),
        f"# {folder.name}\n\nA policy: a detector reads the robot's left eye (`detector-right` the "
        "right one), a translator the sentence, FusionNet joins both to the angles of grasp and "
        "place. The weights are safetensors, the configuration JSON, nothing is executed when they "
        "are loaded.\n",
    ]
    for part, document in documents.items():
        metadata = document.get("metadata", {})
        parts.append(f"## {part}\n\nThis is {_KINDS.get(str(document.get('kind')), part)}.\n")
        parts.append(_section("Data and training", metadata.get("training", {}), level=3))
        parts.append(_section("Numbers", metadata.get("metrics", {}), level=3))
    load = _code("from fusionnet import load_policy", f'policy = load_policy("{folder.name}")')
    parts.append(_USE.format(robot=robot, load=load))
    return "\n".join(part for part in parts if part)


def write_card(folder: Path) -> Path:
    """Write `README.md` beside a checkpoint or a policy's three, and return its path.

    Raises:
        CheckpointError: If there is no checkpoint, or it is damaged.
        OutputError: If it cannot be written.
    """
    if not folder.is_dir():
        raise CheckpointError(f"No checkpoint at {folder}: expected a folder with {CONFIG_FILE}.")
    alone = (folder / CONFIG_FILE).is_file()
    text = model_card(read_document(folder)) if alone else policy_card(folder)
    write_whole(folder / CARD_FILE, text)
    return folder / CARD_FILE


def _header(kind: str) -> str:
    tags = "\n".join(f"- {tag}" for tag in ("robotics", "pick-and-place", "multimodal", kind))
    return (
        f"---\nlibrary_name: fusionnet\npipeline_tag: robotics\nlanguage: en\ntags:\n{tags}\n---\n"
    )


def _loading(kind: str) -> str:
    names = {
        "fusionnet": ("fusionnet.models.fusionnet", "FusionNet"),
        "thesis-fusionnet": ("fusionnet.models.thesis_fusionnet", "ThesisFusionNet"),
    }
    if kind not in names:
        return ""
    module, name = names[kind]
    return _code(f"from {module} import {name}", f'model = {name}.from_pretrained("FOLDER")')


def _code(*lines: str) -> str:
    return "\n".join(["", "```python", *lines, "```", ""])


def _section(title: str, values: Any, level: int = 2) -> str:
    """A table of names and values; what is nested is joined by points."""
    rows = list(_flat(values)) if isinstance(values, Mapping) else []
    if not rows:
        return ""
    lines = [f"{'#' * level} {title}", "", "| | |", "| --- | --- |"]
    lines += [f"| {name} | {value} |" for name, value in rows]
    return "\n".join(lines) + "\n"


def _flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for name, value in values.items():
        said = f"{prefix}{name}".replace("_", " ")
        if isinstance(value, Mapping):
            found += _flat(value, f"{said}: ")
        else:
            found.append((said, _cell(value)))
    return found


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    text = value if isinstance(value, str) else json.dumps(value)
    return text.replace("|", "\\|").replace("\n", " ")
