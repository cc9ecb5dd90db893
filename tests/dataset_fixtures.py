"""A small data set, built once, for the tests of data sets."""

import hashlib
from pathlib import Path

from board_views import board_views
from fusionnet.dataset.build import plan_for
from fusionnet.dataset.plan import BuildPlan
from fusionnet.dataset.sources import Sources
from fusionnet.views import save_views
from tiny_treebank import write_tiny_treebank

SIZE = (320, 180)


def small_sources(folder: Path) -> Sources:
    """A tiny corpus and three views."""
    save_views(folder / "views", board_views())
    return Sources(data=write_tiny_treebank(folder / "corpus"), views=str(folder / "views"))


def small_plan(sources: Sources, **options: object) -> BuildPlan:
    """Twelve samples for training in three shards, one in each other split."""
    chosen = {"size": SIZE, "shard": 5, "varied": 0.5, "eyes_share": 0.4} | options
    return plan_for("12", "treebank", sources, **chosen)


def digests(folder: Path) -> dict[str, str]:
    """Name and checksum of every file of a data set."""
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }
