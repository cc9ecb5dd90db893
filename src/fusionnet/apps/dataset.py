"""`fusionnet dataset ...`: build a data set, and look into one."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tyro

from fusionnet.apps.progress import bars
from fusionnet.dataset.build import build as build_dataset
from fusionnet.dataset.build import plan_for
from fusionnet.dataset.folder import read_checksums, read_plan
from fusionnet.dataset.sources import Sources

Folder = tyro.conf.Positional[Path]


@dataclass(frozen=True, kw_only=True)
class BuildConfig:
    """What to build, from what, and with how many hands."""

    out: Folder
    """Folder of the data set: a new one, or one to go on with."""
    corpus: str = "treebank"
    """Corpus of scenes and sentences."""
    data: Path | None = None
    """Folder of the corpus's files."""
    scale: str = "small"
    """smoke, small, thesis, or a number of training samples."""
    robot: str = "nico"
    """Robot whose joints are stored and whose eyes look."""
    varied: float = 0.0
    """Share of the training samples whose layout is varied or invented."""
    invented: float = 0.3
    """Share of those whose layout is invented."""
    seed: int = 0
    """Source of all randomness."""
    size: tuple[int, int] = (960, 540)
    """Width and height of pictures, in pixels."""
    quality: int = 90
    """Of the JPEGs, 1 to 100."""
    shard: int = 250
    """Samples a file."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Processes on this machine."""
    cluster: str | None = None
    """Address of a Ray cluster that does the work instead."""


@dataclass(frozen=True, kw_only=True)
class InfoConfig:
    """Which data set."""

    folder: Folder
    """Folder of the data set."""


def build(config: BuildConfig) -> dict[str, Any]:
    """Build a data set of pictures, sentences, trees and joint angles, or go on building one.

    Prints what is there as JSON.
    """
    sources = Sources(data=config.data)
    names = ("robot", "varied", "invented", "seed", "size", "quality", "shard")
    options = {name: getattr(config, name) for name in names}
    plan = plan_for(config.scale, config.corpus, sources, **options)
    with bars() as bar:
        made = build_dataset(
            config.out,
            plan,
            sources,
            workers=config.workers,
            cluster=config.cluster,
            progress=bar("samples"),
        )
    return {"shards_made_now": len(made), **info(InfoConfig(folder=config.out))}


def info(config: InfoConfig) -> dict[str, Any]:
    """Say what a data set holds, as JSON."""
    plan = read_plan(config.folder)
    records = read_checksums(config.folder)
    return {
        "folder": str(config.folder),
        "samples": dict(plan.counts),
        "files": len(records),
        "megabytes": round(sum(record.bytes for record in records.values()) / 1e6, 1),
        "plan": plan.as_json(),
    }
