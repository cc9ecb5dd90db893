"""The commands that the options of `fusionnet corpus ...` name."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from fusionnet.apps.progress import bars
from fusionnet.corpora import Corpus, discard, load_corpus, synthetic
from fusionnet.errors import InputError

LARGEST_SIZE = 10_000_000
"""Synthetic commands that one call may ask for."""


@dataclass(frozen=True, kw_only=True)
class CorpusSource:
    """Which commands."""

    corpus: str = "examples"
    """"examples" (in this package), "synthetic" (made anew), "treebank" or "etr" (with --data)."""

    data: Path | None = None
    """Folder (or, for "etr", zip) of the corpus's files."""

    part: Literal["train", "val", "test", "all"] = "all"
    """By groups of scenes; "all" are all of them."""

    skip_bad: bool = False
    """Leave unreadable records out, with a line each, instead of refusing the whole."""

    discard: bool = False
    """Leave out what the thesis would not train on (4.2.2), and count it by the reason."""

    size: int | None = None
    """How many commands of the synthetic corpus to make."""

    seed: int | None = None
    """Seed of the synthetic corpus; 0 is the one that is tested on."""


def read_corpus(source: CorpusSource) -> Corpus:
    """The corpus that the options name, without what they leave out.

    Raises:
        InputError: If size or seed is given for a corpus that has none, or out of range.
        UnknownNameError: If there is no such corpus.
        DataError: If its files are missing or damaged.
    """
    made = {"--size": source.size, "--seed": source.seed}
    given = [option for option, value in made.items() if value is not None]
    if given and source.corpus != "synthetic":
        raise InputError(
            f"{' and '.join(given)} is for the corpus 'synthetic', not for {source.corpus!r}."
        )
    size = synthetic.CORPUS_SIZE if source.size is None else source.size
    if not 1 <= size <= LARGEST_SIZE:
        raise InputError(f"--size is 1 to {LARGEST_SIZE}, not {size}.")
    if source.corpus == "synthetic":
        with bars() as bar:
            corpus = synthetic.read(seed=source.seed or 0, size=size, progress=bar("commands"))
    else:
        corpus = load_corpus(source.corpus, source.data, skip_bad=source.skip_bad)
    corpus = discard(corpus) if source.discard else corpus
    if source.part == "all":
        return corpus
    return replace(corpus, commands=tuple(corpus.split(source.part)))
