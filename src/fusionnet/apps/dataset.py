"""`fusionnet dataset ...`: build a data set, and look into one."""

import io
import os
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import tyro
from PIL import Image

from fusionnet.apps.progress import bars
from fusionnet.dataset.build import build as build_dataset
from fusionnet.dataset.build import plan_for
from fusionnet.dataset.check import MOST_FAULTS
from fusionnet.dataset.check import check as check_dataset
from fusionnet.dataset.contact_sheet import contact_sheet
from fusionnet.dataset.export_coco import export_coco
from fusionnet.dataset.export_lerobot import export_lerobot
from fusionnet.dataset.folder import read_checksums, read_plan
from fusionnet.dataset.plan import BuildPlan
from fusionnet.dataset.reader import StoredSamples
from fusionnet.dataset.sources import Sources
from fusionnet.errors import InputError
from fusionnet.files import check_file, write_whole
from fusionnet.randomness import generator

Folder = tyro.conf.Positional[Path]

_PLANNED = {f.name for f in fields(BuildPlan)} - {"corpus", "views"}


@dataclass(frozen=True, kw_only=True)
class BuildConfig:
    """What to build, from what, and with how many hands."""

    out: Folder
    """Folder of the data set: a new one, or one to go on with."""
    corpus: str = "treebank"
    """Corpus of scenes and sentences."""
    data: Path | None = None
    """Folder of the corpus's files."""
    views: str | None = None
    """Environmental views: their folder, or a shipped name; without, only the robot's eyes see."""
    scale: str = "small"
    """smoke, small, thesis, or a number of training samples."""
    robot: str = "nico"
    """Robot whose joints are stored and whose eyes look."""
    eyes: tuple[str, ...] = ("left_eye",)
    """Cameras of the robot that look, by turns."""
    eyes_share: float = 0.25
    """Share of the training samples through the robot's eyes, if there are views."""
    varied: float = 0.0
    """Share of the training samples whose layout is varied or invented."""
    invented: float = 0.3
    """Share of those whose layout is invented."""
    displaced: float = 0.0
    """Share of the training samples through an eye in which top blocks stand up to 1 cm off."""
    noised: float = 0.75
    """Share of the training samples in views with level-one noise."""
    strength: float = 0.15
    """Of that noise's displacements, 0 to 1; at 1, as in the thesis, blocks leave their cells."""
    sensor: bool = True
    """Whether pictures with that noise are blurred, white balanced and grained like a camera's."""
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


@dataclass(frozen=True, kw_only=True)
class CheckConfig:
    """Which data set, and how closely."""

    folder: Folder
    """Folder of the data set."""
    checksums_only: bool = False
    """Leave the samples' labels out."""


@dataclass(frozen=True, kw_only=True)
class ShowConfig:
    """Which samples of which data set."""

    folder: Folder
    """Folder of the data set."""
    split: str = "train"
    """Which split."""
    samples: int = 12
    """How many, drawn by chance."""
    seed: int = 0
    """Of the draw."""
    out: Path = Path("contact-sheet.png")
    """The picture (PNG) that is written."""


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """Which data set, in which form, where to."""

    form: tyro.conf.Positional[Literal["coco", "lerobot"]]
    """COCO: pictures, boxes and masks. LeRobot: episodes executed in the simulator."""
    folder: Folder
    """Folder of the data set."""
    out: Folder
    """A new folder."""
    splits: tuple[str, ...] = ()
    """Which splits; for COCO all by default, for LeRobot one, train by default."""
    episodes: int | None = None
    """How many samples are executed for LeRobot; 20 by default."""


def build(config: BuildConfig) -> dict[str, Any]:
    """Build a data set of pictures, sentences, trees and joint angles, or go on building one.

    Prints what is there as JSON.
    """
    sources = Sources(data=config.data, views=config.views)
    options = {f.name: getattr(config, f.name) for f in fields(config) if f.name in _PLANNED}
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


def check(config: CheckConfig) -> int:
    """Look through a data set for damage: checksums, schema, and labels that contradict.

    Prints each fault on a line; the exit status is 2 if there are any.
    """
    with bars() as bar:
        faults = check_dataset(
            config.folder, labels=not config.checksums_only, progress=bar("samples")
        )
    for fault in faults:
        print(fault)
    end = " (and perhaps more)" if len(faults) >= MOST_FAULTS else ""
    print(f"{len(faults)} faults{end}" if faults else "no faults")
    return 2 if faults else 0


def show(config: ShowConfig) -> None:
    """Draw some samples with their boxes and sentences on one contact sheet."""
    if config.samples < 1 or config.samples > 400:
        raise InputError(f"A sheet has 1 to 400 samples; received {config.samples}.")
    check_file(config.out)
    samples = StoredSamples(config.folder, config.split)
    rng = generator(config.seed, "contact sheet", config.split)
    drawn = sorted(rng.permutation(len(samples))[: config.samples].tolist())
    sheet = contact_sheet([samples[index] for index in drawn])
    picture = io.BytesIO()
    Image.fromarray(sheet).save(picture, "PNG")
    write_whole(config.out, picture.getvalue())
    print(config.out)


def export(config: ExportConfig) -> dict[str, Any]:
    """Write a data set in another form: COCO, or LeRobot episodes."""
    if config.form == "coco" and config.episodes is not None:
        raise InputError("--episodes is for LeRobot; choose what COCO gets by --splits.")
    with bars() as bar:
        if config.form == "coco":
            splits = config.splits or None
            export_coco(config.folder, config.out, splits, progress=bar("samples"))
            return {"coco": str(config.out)}
        if len(config.splits) > 1:
            raise InputError("LeRobot episodes are exported from one split at a time.")
        split = config.splits[0] if config.splits else "train"
        episodes = 20 if config.episodes is None else config.episodes
        counted = export_lerobot(
            config.folder, config.out, split, episodes, progress=bar("episodes")
        )
        return {"lerobot": str(config.out), **counted}
