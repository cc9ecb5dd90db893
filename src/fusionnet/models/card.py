"""The model card of a checkpoint or a policy: data, training, numbers, licence, use and limits.

It is made of the checkpoint's own configuration, so it never says more than the file knows.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from fusionnet.corpora import TERMS
from fusionnet.errors import UnknownNameError

CARD_FILE = "README.md"

Document = Mapping[str, Any]
"""What a checkpoint's `config.json` holds."""

_KINDS = {
    "retinanet": "a detector: from a picture to boxes and, in the compact form, the layout",
    "translator": "a translator: from an English command to its Robot Command Language tree",
    "transformer": "the thesis's Transformer: from an English command to its tree's text",
    "fusionnet": "FusionNet: from what was seen and a command's tree to fourteen joint values",
    "thesis-fusionnet": "the thesis's FusionNet: from a picture and a sentence to fourteen "
    "joint values",
}

_SEES = ("retinanet", "thesis-fusionnet")
_READS = ("translator", "transformer", "thesis-fusionnet")
"""Kinds that learn from pictures, and kinds that know words."""

_MEASURED = {
    "exact": ("commands whose tree is read exactly", ""),
    "sentence_accuracy": ("commands whose tree is written exactly", ""),
    "layout_right": ("pictures whose layout is read exactly", "val"),
    "map_50": (
        "mean average precision of boxes, at an overlap of 0.5, in views not learnt from",
        "val",
    ),
    "test exact": ("commands of which both cells are right, layouts without doubt", "test"),
    "test soft": ("commands of which both cells are right, layouts read with doubt", "test"),
}
"""Shares of what was measured, by the names under which trainers keep them: what they are shares
of, and of which groups; where that is empty, of those that the training says it checks."""

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


def model_card(document: Document) -> str:
    """The card of one checkpoint, from the document in its `config.json`."""
    kind = str(document.get("kind"))
    metadata = document.get("metadata", {})
    parts = [
        _header(kind, {kind: document}),
        f"# {kind}\n\nThis is {_what(document)}. It belongs to the package `fusionnet`; the "
        "weights are safetensors, the configuration JSON, nothing is executed when it is loaded.\n",
        _data([document]),
        _section("Training", metadata.get("training", {})),
        _section("Numbers", metadata.get("metrics", {})),
        _licence([document]),
        _USE.format(robot=_robot(document), load=_loading(kind)),
    ]
    return "\n".join(part for part in parts if part)


def policy_card(name: str, documents: Mapping[str, Document]) -> str:
    """The card of a whole policy, whose parts have cards of their own.

    Args:
        name: Of the policy.
        documents: By the name of the part: `detector`, `translator`, `fusion` and, where there are
            any, `detector-right` of the right eye and `detector-views` of other pictures.
    """
    told = list(documents.values())
    listed = "\n".join(
        f"- [{part}]({part}/{CARD_FILE}): {_what(document)}" for part, document in documents.items()
    )
    load = _code("from fusionnet import load_policy", "", f'policy = load_policy("{name}")')
    parts = [
        _header(name, documents, "policy"),
        f"# {name}\n\nA policy: a detector reads the robot's left eye (`detector-right` the right "
        "one, `detector-views` finds blocks in other pictures), a translator the sentence, "
        "FusionNet joins both to the angles of grasp and place. It belongs to the package "
        "`fusionnet`; the weights are safetensors, the configuration JSON, nothing is executed "
        "when they are loaded. How each part was trained and what it reaches is told by its own "
        f"card:\n\n{listed}\n",
        _data(told),
        _licence(told),
        _USE.format(robot=_robot(documents["fusion"]), load=load),
    ]
    return "\n".join(part for part in parts if part)


def _what(document: Document) -> str:
    kind = str(document.get("kind"))
    return _KINDS.get(kind, f"a checkpoint of the kind {kind}")


def _robot(document: Document) -> str:
    return str(document.get("config", {}).get("robot", "the robot that it was trained for"))


def _training(document: Document) -> Mapping[str, Any]:
    training = document.get("metadata", {}).get("training", {})
    return training if isinstance(training, Mapping) else {}


def _corpora(document: Document) -> list[str]:
    """Names of the corpora that a checkpoint learned from."""
    training = _training(document)
    named = training.get("corpus", [])
    found = [named] if isinstance(named, str) else list(named)
    return [*found, "synthetic"] if training.get("invented") else found


def _data(documents: Iterable[Document]) -> str:
    """What the checkpoints learned from, under which terms, and what of it is inside them."""
    documents = list(documents)
    lines = ["## Data", ""]
    names = dict.fromkeys(name for document in documents for name in _corpora(document))
    lines += [f"- `{name}`: {_terms(name)}" for name in names]
    if not names:
        lines.append("- Which commands and layouts it learned from, the checkpoint does not say.")
    kinds = {str(document.get("kind")) for document in documents}
    if kinds & set(_SEES) or any(_training(document).get("pictures") for document in documents):
        lines.append(
            "- Pictures in which all blocks are rendered, none is photographed "
            "(`fusionnet dataset build`)."
        )
    words = "the words that are known and what they say, but " if kinds & set(_READS) else ""
    lines.append(f"\nOf these data it holds {words}no sentence, tree, layout or picture.")
    return "\n".join(lines) + "\n"


def _terms(name: str) -> str:
    try:
        return f"{TERMS.load(name)}."
    except UnknownNameError:
        return "a corpus of which this release knows nothing more."


def _licence(documents: Iterable[Document]) -> str:
    licence = _stated(documents)
    if licence is None:
        said = (
            "No licence is stated for these weights; who trained them decides. The package "
            "`fusionnet` is Apache-2.0."
        )
    else:
        said = f"These weights are a part of the package `fusionnet`, and {licence} as it is."
    return f"""## Licence

{said} What the terms of
the data mean for weights that learned from them, we cannot tell.
"""


def _stated(documents: Iterable[Document]) -> str | None:
    """The licence that all parts state."""
    found = {document.get("metadata", {}).get("license") for document in documents}
    [licence] = found if len(found) == 1 else [None]
    return None if licence is None else str(licence)


def _header(name: str, documents: Mapping[str, Document], *tags: str) -> str:
    """What the hub reads: licence, tags and numbers."""
    licence = _stated(documents.values())
    kinds = dict.fromkeys(str(document.get("kind")) for document in documents.values())
    lines = ["---"]
    if licence is not None:
        lines.append(f"license: {licence.lower()}")
    lines += ["library_name: fusionnet", "pipeline_tag: robotics", "language: en", "tags:"]
    lines += [f"- {tag}" for tag in ("robotics", "pick-and-place", "multimodal", *tags, *kinds)]
    results = [line for document in documents.values() for line in _results(document)]
    if results:
        lines += ["model-index:", f"- name: {name}", "  results:", *results]
    return "\n".join([*lines, "---", ""])


def _results(document: Document) -> list[str]:
    """A checkpoint's numbers as the hub's index of models has them, one result a line of YAML."""
    metrics = document.get("metadata", {}).get("metrics", {})
    training = _training(document)
    named = training.get("corpus", "unknown")
    corpus = named if isinstance(named, str) else " and ".join(named)
    lines = []
    for key, (name, groups) in _MEASURED.items():
        value = metrics.get(key) if isinstance(metrics, Mapping) else None
        if not isinstance(value, int | float):
            continue
        result = {
            "task": {"type": "robotics", "name": _what(document).partition(":")[0]},
            "dataset": {
                "type": corpus,
                "name": corpus,
                "split": groups or " and ".join(training.get("check", [])),
            },
            "metrics": [{"type": "accuracy", "name": name, "value": round(float(value), 4)}],
        }
        lines.append(f"  - {json.dumps(result)}")
    return lines


def _loading(kind: str) -> str:
    names = {
        "fusionnet": ("fusionnet.models.fusionnet", "FusionNet"),
        "thesis-fusionnet": ("fusionnet.models.thesis_fusionnet", "ThesisFusionNet"),
    }
    if kind not in names:
        return ""
    module, name = names[kind]
    return _code(f"from {module} import {name}", "", f'model = {name}.from_pretrained("FOLDER")')


def _code(*lines: str) -> str:
    return "\n".join(["", "```python", *lines, "```", ""])


def _section(title: str, values: Any) -> str:
    """A table of names and values; what is nested is joined by points."""
    rows = list(_flat(values)) if isinstance(values, Mapping) else []
    if not rows:
        return ""
    lines = [f"## {title}", "", "| | |", "| --- | --- |"]
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
