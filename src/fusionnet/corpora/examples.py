"""A handful of scenes and sentences of our own, so that everything works without a corpus.

They lie in the package as `examples.json`: scenes (layouts before and after) and
commands (sentence and tree, with the words each leaf was read from).
"""

import json
from importlib import resources
from pathlib import Path
from typing import Any

from fusionnet.blocks import Layout, Scene, layout_from_json
from fusionnet.corpora._command import Command, Corpus
from fusionnet.errors import DataError, InputError, TreeError
from fusionnet.rcl import parse


def read(data: Path | None = None, *, skip_bad: bool = False) -> Corpus:
    """Read the examples; `data` and `skip_bad` change nothing: they are part of the package."""
    text = resources.files("fusionnet.corpora").joinpath("examples.json").read_text("utf-8")
    return corpus_from_json(json.loads(text), "examples")


CORPUS = read
TERMS = "our own example scenes, a part of the package `fusionnet` (Apache-2.0)"


def corpus_from_json(value: Any, name: str) -> Corpus:
    """A corpus from the decoded JSON of a file like `examples.json`.

    Raises:
        DataError: If it is not of that form; the message names the record.
    """
    layouts: dict[int, Layout] = {}
    scenes: dict[int, Scene] = {}
    commands = []
    where = "the file"
    try:
        for record in value["scenes"]:
            number = int(record["id"])
            where = f"scene {number}"
            before, after = (
                layout_from_json(record[when] | {"id": 2 * number - 1 + position})
                for position, when in enumerate(("before", "after"))
            )
            layouts |= {2 * number - 1: before, 2 * number: after}
            scenes[number] = Scene(before, after, number, record.get("group"))
        for record in value["commands"]:
            number = int(record["id"])
            where = f"command {number}"
            scene = scenes[record["scene"]]
            commands.append(
                Command(number, str(record["sentence"]), parse(record["tree"]), scene, name)
            )
    except (InputError, TreeError) as error:
        raise DataError(f"{name}, {where}: {error}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"{name}, {where}: not of the form of a corpus file ({type(error).__name__}: {error})."
        ) from None
    return Corpus(name, tuple(commands), scenes, layouts)
