"""Train a whole policy, from nothing but a corpus: `fusionnet train policy`.

The recipe of the policy that we ship, part after part: pictures are built, the detector of the
left eye learns from them, then that of the right one and that of pictures from anywhere, the
translator from sentences, and FusionNet from what the detector says of pictures. Each part is
kept where it was finished, so that a run that was stopped goes on.
"""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fusionnet.corpora import load_corpus
from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.sources import Sources
from fusionnet.errors import CheckpointError, InputError
from fusionnet.files import check_folder, check_new_folder, folder_whole, write_whole
from fusionnet.models.checkpoint import CONFIG_FILE, read_document
from fusionnet.models.policy_folder import write_policy_card
from fusionnet.randomness import derived_seed
from fusionnet.training import detector, fusion, translator
from fusionnet.training.detector import DetectorConfig
from fusionnet.training.fusion import FusionConfig
from fusionnet.training.loop import LoopConfig, Progress
from fusionnet.training.state import check_settings, settings_of
from fusionnet.training.translator import TranslatorConfig
from fusionnet.views import Backdrops, save_views
from fusionnet.views.drawn import drawn_views

SETTINGS_FILE = "policy.json"


def _detector_loop(steps: int) -> LoopConfig:
    return replace(DetectorConfig(datasets=(Path("eye"),)).loop, steps=steps)


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """How to train a whole policy; the defaults take one core about five hours.

    Attributes:
        out: A new folder for the policy.
        work: Folder of pictures, logs, resumable states and finished parts.
        corpus: Corpus of sentences, trees and layouts.
        data: Folder of the corpus.
        eye: Pictures of varied and invented layouts through the left eye.
        right: The same through the right eye; 0 for a policy of one eye.
        drawn: Pictures of blocks drawn over drawn views, for the detector of boxes alone.
        views: How many views are drawn.
        rooms: Pictures of blocks drawn over the shipped rooms, for that detector; with neither,
            the policy has none.
        photographs: Folder of photographs without blocks, that detector's backdrops; best of the
            place where it shall look.
        read: Pictures from which FusionNet learns how the detector errs.
        batch: Pictures a step of a detector.
        detector: Loop of the left eye's detector, which begins with nothing.
        detector_right: Loop of the right eye's, which begins with the left one's weights.
        detector_views: Loop of that of boxes alone, which begins with them, too.
        translator: Loop of the translator.
        fusion: Loop of FusionNet.
        seed: Source of all randomness.
        workers: Processes that build pictures.
    """

    out: Path = Path("runs/policy/checkpoint")
    work: Path = Path("runs/policy")
    corpus: str = "treebank"
    data: Path | None = None
    eye: int = 9000
    right: int = 5000
    drawn: int = 2500
    views: int = 900
    rooms: int = 1500
    photographs: Path | None = None
    read: int = 3000
    batch: int = 8
    detector: LoopConfig = field(default_factory=lambda: _detector_loop(7500))
    detector_right: LoopConfig = field(default_factory=lambda: _detector_loop(900))
    detector_views: LoopConfig = field(default_factory=lambda: _detector_loop(3000))
    translator: LoopConfig = field(default_factory=lambda: TranslatorConfig().loop)
    fusion: LoopConfig = field(default_factory=lambda: FusionConfig().loop)
    seed: int = 0
    workers: int = 1

    def __post_init__(self) -> None:
        """Refuse what cannot train."""
        if min(self.eye, self.read, self.batch, self.workers) < 1 or self.views < 2:
            raise InputError(
                "eye, read, batch and workers are at least 1, views at least 2; received "
                f"{self.eye}, {self.read}, {self.batch}, {self.workers} and {self.views}."
            )
        if min(self.right, self.drawn, self.rooms) < 0:
            raise InputError(
                "right, drawn and rooms are numbers of pictures, 0 for none; received "
                f"{self.right}, {self.drawn} and {self.rooms}."
            )
        loops = (
            self.detector,
            self.detector_right,
            self.detector_views,
            self.translator,
            self.fusion,
        )
        if any(loop.devices > 1 for loop in loops):
            raise InputError(
                "A whole policy is trained on one device; `fusionnet train detector`, `translator` "
                "and `fusion` train the parts on several."
            )


Bars = Callable[[str], Callable[..., None]]
"""Given the name of a stage, the function that is told how far it is."""


def train(config: PolicyConfig, bars: Bars) -> dict[str, Any]:
    """Train every part that is not finished yet, write the policy, return each part's metrics.

    Raises:
        InputError: If the corpus has no training groups.
        DataError: If the corpus is missing or damaged.
        CheckpointError: If `work` holds a run of other settings, or a part of other steps.
        OutputError: If something cannot be written, or `out` holds files already.
    """
    check_new_folder(config.out)
    check_folder(config.work)
    if not load_corpus(config.corpus, config.data).split("train"):
        raise InputError(f"The corpus {config.corpus!r} has no training groups to learn from.")
    _same_settings(config)
    parts = {"detector": _detector, "translator": _translator, "fusion": _fusion}
    if config.right:
        parts["detector-right"] = _detector_right
    if config.drawn or config.rooms:
        parts["detector-views"] = _detector_views
    missing = [name for name in parts if not _finished(config, name)]
    for name in missing:
        parts[name](config, bars)
    with folder_whole(config.out) as aside:
        for name in parts:
            shutil.copytree(_part(config, name), aside / name)
        write_policy_card(aside, config.out.name)
    return {name: read_document(_part(config, name))["metadata"]["metrics"] for name in parts}


def _part(config: PolicyConfig, name: str) -> Path:
    return config.work / name / "checkpoint"


def _finished(config: PolicyConfig, name: str) -> bool:
    """Whether a part is finished; one that was finished with other steps is refused."""
    folder = _part(config, name)
    if not (folder / CONFIG_FILE).is_file():
        return False
    made = read_document(folder)["metadata"]["training"]["loop"]["steps"]
    asked = getattr(config, name.replace("-", "_")).steps
    if made != asked:
        raise CheckpointError(
            f"The part {name} in {folder} was finished with {made} steps, not {asked}. Give "
            f"--{name}.steps {made}, or remove {config.work / name} and the parts that learnt from "
            "it."
        )
    return True


def _same_settings(config: PolicyConfig) -> None:
    """Keep the settings of a new run; refuse to go on with another's."""
    file, told = config.work / SETTINGS_FILE, settings_of(config)
    if file.is_file():
        try:
            stored = json.loads(file.read_text())
        except ValueError as error:
            raise CheckpointError(f"{file} is damaged: {error}. Remove {config.work}.") from error
        check_settings(config.work, told, stored)
    else:
        write_whole(file, json.dumps(told, indent=1))


SEEN = {"varied": 0.94, "invented": 0.5, "displaced": 0.3}
"""How pictures through an eye are built."""

OVER = {"varied": 0.95, "invented": 0.55, "noised": 0.7, "eyes_share": 0.0}
"""How pictures over views are built."""


def _detector(config: PolicyConfig, bars: Bars) -> None:
    sets = (_built(config, "eye", config.eye, SEEN, bars),)
    made = DetectorConfig(datasets=sets, empty=0, loop=config.detector)
    _train_detector(config, "detector", made, bars("left eye's detector"))


def _detector_right(config: PolicyConfig, bars: Bars) -> None:
    sets = (_built(config, "right", config.right, SEEN | {"eyes": ("right_eye",)}, bars),)
    start, loop = _part(config, "detector"), config.detector_right
    made = DetectorConfig(datasets=sets, start=start, eye="right_eye", empty=0, loop=loop)
    _train_detector(config, "detector-right", made, bars("right eye's detector"))


def _detector_views(config: PolicyConfig, bars: Bars) -> None:
    sets = []
    if config.drawn:
        views = config.work / "drawn-views"
        if not views.is_dir():
            folder = config.photographs
            drawn = drawn_views(
                config.views,
                derived_seed(config.seed, "policy", "views"),
                validation=max(1, config.views // 15),
                backdrops=None if folder is None else Backdrops.of_folder(folder),
                progress=bars("drawn views"),
            )
            save_views(views, drawn)
        sets.append(_built(config, "drawn", config.drawn, OVER, bars, str(views)))
    if config.rooms:
        sets.append(_built(config, "rooms", config.rooms, OVER, bars, "rooms"))
    start, loop = _part(config, "detector"), config.detector_views
    made = DetectorConfig(
        datasets=tuple(sets),
        start=start,
        layouts=False,
        empty=3,
        photographs=config.photographs,
        loop=loop,
    )
    _train_detector(config, "detector-views", made, bars("detector of other views"))


def _train_detector(
    config: PolicyConfig, name: str, made: DetectorConfig, progress: Progress
) -> None:
    """Train one of the detectors, where the policy keeps it."""
    out, work = _part(config, name), config.work / name
    made = replace(made, out=out, work=work, batch=config.batch, seed=config.seed)
    detector.train(made, progress=progress)


def _translator(config: PolicyConfig, bars: Bars) -> None:
    translator.train(
        TranslatorConfig(
            out=_part(config, "translator"),
            work=config.work / "translator",
            corpus=config.corpus,
            data=config.data,
            loop=config.translator,
            seed=config.seed,
        ),
        progress=bars("translator"),
    )


def _fusion(config: PolicyConfig, bars: Bars) -> None:
    fusion.train(
        FusionConfig(
            out=_part(config, "fusion"),
            work=config.work / "fusion",
            corpus=config.corpus,
            data=config.data,
            reader=_part(config, "detector"),
            pictures=config.read,
            loop=config.fusion,
            seed=config.seed,
        ),
        progress=bars("fusion"),
        rendering=bars("pictures for the fusion"),
    )


def _built(
    config: PolicyConfig,
    name: str,
    count: int,
    options: Mapping[str, Any],
    bars: Bars,
    views: str | None = None,
) -> Path:
    """A data set of the policy's own, built or gone on with."""
    sources = Sources(data=config.data, views=views)
    seed = derived_seed(config.seed, "policy", name)
    plan = plan_for(str(count), config.corpus, sources, seed=seed, **options)
    folder = config.work / f"pictures-{name}"
    build(folder, plan, sources, workers=config.workers, progress=bars(f"pictures: {name}"))
    return folder
