"""What the experiments of chapter 6 learn from: pictures, made when first needed."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from fusionnet.corpora import synthetic, treebank_files
from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.plan import SPLITS
from fusionnet.dataset.sources import Sources
from fusionnet.experiments._experiment import Trial
from fusionnet.experiments._locks import alone
from fusionnet.experiments._sources import corpus_for
from fusionnet.files import write_whole

COMMANDS = 40
"""Commands of our own at the smoke scale."""

CHECKED = "sim_val"
"""Split that is measured: layouts of validation groups through the robot's eye, in other looks."""


def pictures_for(
    trial: Trial,
    train: int,
    checked: int,
    size: tuple[int, int],
    *,
    views: str | None = None,
) -> Path:
    """A data set through the robot's left eye, or in environmental views.

    Args:
        trial: Whose scale and data it is for.
        train: Pictures to learn from.
        checked: Pictures of the split `CHECKED`.
        size: Width and height of stored pictures, in pixels.
        views: Name of the views that training sees instead of the robot's eye.

    Raises:
        DataError: If the treebank is needed and was not given, or is damaged.
        InputError: If there are no such views.
    """
    if trial.scale != "smoke" and trial.data is None:
        corpus_for(trial)  # says how to give it
    own = trial.scale == "smoke"
    return _made(trial.work, None if own else trial.data, (train, checked), size, views)


@lru_cache(maxsize=4)  # once a process: the corpus is read to see that nothing is missing
def _made(
    work: Path,
    data: Path | None,
    counts: tuple[int, int],
    size: tuple[int, int],
    views: str | None,
) -> Path:
    folder = work / f"pictures-{views or 'eye'}-{counts[0]}-{size[0]}x{size[1]}"
    with alone(work, folder.relative_to(work)):
        sources = Sources(data=data or _own_commands(work / "commands"), views=views)
        options = {"size": size, "varied": 0.3, "eyes_share": 0.0}
        plan = plan_for(str(counts[0]), "treebank", sources, **options)
        splits = {"train": counts[0], CHECKED: counts[1]}
        splits |= {"val": counts[1]} if views else {}
        order = {split: splits[split] for split in SPLITS if split in splits}
        build(folder, replace(plan, counts=tuple(order.items())), sources)
    return folder


def _own_commands(folder: Path) -> Path:
    """A few commands of our own in the treebank's form, for runs without its data."""
    for name, text in treebank_files(synthetic.read(size=COMMANDS)).items():
        write_whole(folder / name, text)
    return folder
