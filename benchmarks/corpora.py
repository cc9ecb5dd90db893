"""How fast corpora are read and made, on one core, against named rivals in the same run.

    python benchmarks/corpora.py --data ../shared/data

Reading is compared with the plainest reading of the same files that gives no more than
strings: `str.split` for the treebank, `ElementTree` for the Extended Train Robots. Ours
also checks every record and builds typed trees and layouts. Making is compared with
drawing the layouts and nothing else. Each part prints one JSON line.
"""

import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import tyro

from fusionnet.blocks import random_layout
from fusionnet.corpora import Corpus, load_corpus, synthetic, treebank_files
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.rcl import format

XML_FILES = ("layouts.xml", "scenes.xml", "commands.xml", "losr.xml", "comments.xml")


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        data: Folder that holds the treebank; without one, synthetic commands are read.
        size: How many commands are made, and read where there is no treebank.
        rounds: How often each is done; the fastest counts.
        seed: Of the synthetic commands.
    """

    data: Path | None = None
    size: int = 2500
    rounds: int = 5
    seed: int = 2


def fastest(rounds: int, *ways: Callable[[], Any]) -> list[float]:
    """Processor seconds of the fastest of some rounds of each way, done in turns."""
    seconds = [float("inf")] * len(ways)
    for _ in range(rounds):
        for place, way in enumerate(ways):
            begin = time.process_time()
            way()
            seconds[place] = min(seconds[place], time.process_time() - begin)
    return seconds


def write_etr(corpus: Corpus, folder: Path) -> None:
    """A corpus in the form of the Extended Train Robots."""
    layouts, scenes, commands, trees = [], [], [], []
    for number, layout in corpus.layouts.items():
        x, y, z = layout.gripper.cell
        lines = [
            f'<{b.shape} color="{b.color}" position="{b.cell.x} {b.cell.y} {b.cell.z}"/>'
            for b in layout.blocks
        ]
        state = str(not layout.gripper.closed).lower()
        gripper = f'<gripper position="{x} {y} {z}" open="{state}"/>'
        layouts.append(f'<layout id="{number}">{gripper}{"".join(lines)}</layout>')
    for number, scene in corpus.scenes.items():
        scenes.append(
            f'<scene id="{number}"><before layoutId="{scene.before.id}"/>'
            f'<after layoutId="{scene.after.id}"/></scene>'
        )
    for c in corpus.commands:
        text = quoteattr(c.sentence)
        commands.append(f'<command id="{c.id}" sceneId="{c.scene.id}" text={text}/>')
        trees.append(f'<command id="{c.id}" losr="{format(c.tree)}"/>')
    for name, lines in zip(XML_FILES, (layouts, scenes, commands, trees, []), strict=True):
        root = name.removesuffix(".xml")
        (folder / name).write_text(f"<{root}>\n" + "\n".join(lines) + f"\n</{root}>\n")


def split_files(folder: Path) -> list[list[str]]:
    """The treebank's files as strings."""
    names = ("commands.txt", "annotation.txt", "configuration.txt")
    return [line.split("\t") for name in names for line in (folder / name).open()]


def parsed_files(folder: Path) -> list[dict[str, str]]:
    """The Extended Train Robots' files as ElementTree's elements, and their attributes."""
    trees = [ElementTree.parse(folder / name) for name in XML_FILES]
    return [dict(element.attrib) for tree in trees for element in tree.iter()]


def reading(config: Config) -> list[dict[str, Any]]:
    """Records a second of both readers."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if config.data is None:
            corpus = synthetic.read(size=config.size, seed=config.seed)
        else:
            corpus = load_corpus("treebank", config.data)
        for file, text in treebank_files(corpus).items():
            (folder / file).write_text(text)
        write_etr(corpus, folder)
        for form, rival, plainly in (
            ("treebank", "str.split", split_files),
            ("etr", "ElementTree", parsed_files),
        ):
            read = load_corpus(form, folder)
            assert len(read.commands) == len(corpus.commands)
            ours, other = fastest(
                config.rounds,
                lambda form=form: load_corpus(form, folder),
                lambda plainly=plainly: plainly(folder),
            )
            records = len(read.commands) + len(read.scenes) + len(read.layouts)
            found.append(
                {
                    "part": f"read {form}",
                    "commands": len(read.commands),
                    "records": records,
                    "commands_per_second": round(len(read.commands) / ours),
                    "records_per_second": round(records / ours),
                    "rival": rival,
                    "times_the_rival_s_seconds": round(ours / other, 2),
                }
            )
    return found


def making(config: Config) -> list[dict[str, Any]]:
    """Checked synthetic commands a second."""

    def layouts() -> None:
        for number in range(1, config.size + 1):
            random_layout(generator(config.seed, "corpora", "synthetic", number))

    ours, other = fastest(
        config.rounds,
        lambda: list(islice(synthetic.commands(config.seed), config.size)),
        layouts,
    )
    return [
        {
            "part": "make synthetic",
            "commands": config.size,
            "commands_per_second": round(config.size / ours),
            "rival": "random_layout alone",
            "times_the_rival_s_seconds": round(ours / other, 2),
        }
    ]


def main(config: Config) -> None:
    around = {"seed": config.seed, **provenance()}
    for part in (reading, making):
        begin = time.perf_counter()
        for found in part(config):
            took = round(time.perf_counter() - begin, 1)
            print(json.dumps({**found, **around, "seconds": took}), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Config))
