"""Commands with their trees and scenes, from whatever source, as one kind of record.

One file a corpus, which offers `CORPUS`: a function from the folder of the data
(or None) to a `Corpus`, and `TERMS`: what the corpus is and how it is licensed, as a
clause for model cards. Files that begin with an underscore are no corpora.
"""

import os
from pathlib import Path

from fusionnet.catalogue import Catalogue
from fusionnet.corpora._command import Command, Corpus, Part, part_of
from fusionnet.corpora._discard import discard, executable
from fusionnet.corpora._export import command_as_json, json_lines, treebank_files

CATALOGUE = Catalogue("fusionnet.corpora", kind="corpus", attribute="CORPUS")

TERMS = Catalogue("fusionnet.corpora", kind="corpus", attribute="TERMS")


def named_data() -> Path | None:
    """The folder of corpora that the variable FUSIONNET_DATA names; None without it."""
    named = os.environ.get("FUSIONNET_DATA")
    return Path(named) if named else None


def load_corpus(name: str, data: Path | str | None = None, *, skip_bad: bool = False) -> Corpus:
    """Read the corpus called `name`.

    Args:
        name: A name in the catalogue: "examples", "synthetic", "treebank" or "etr".
        data: Folder of its files, for a corpus that is not part of this package; the one that
            FUSIONNET_DATA names by default.
        skip_bad: Leave unreadable records out instead of refusing the whole.

    Raises:
        UnknownNameError: If there is no such corpus.
        DataError: If its files are missing or damaged.
    """
    read = CATALOGUE.load(name)
    folder = named_data() if data is None else Path(data)
    corpus: Corpus = read(folder, skip_bad=skip_bad)
    return corpus


__all__ = [
    "CATALOGUE",
    "TERMS",
    "Command",
    "Corpus",
    "Part",
    "command_as_json",
    "discard",
    "executable",
    "json_lines",
    "load_corpus",
    "named_data",
    "part_of",
    "treebank_files",
]
