"""Where the data of a build comes from, opened once a process."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from fusionnet import robots
from fusionnet.blocks import layout_to_json
from fusionnet.catalogue import did_you_mean
from fusionnet.corpora import Corpus, load_corpus, named_data
from fusionnet.dataset.plan import BuildPlan
from fusionnet.dataset.recipes import EYE, Recipe, Recipes
from fusionnet.dataset.shots import Eyes, Photographs, Shot
from fusionnet.errors import DataError, UnknownNameError
from fusionnet.rcl import format as format_tree
from fusionnet.simulation.renderer import EXTERNAL
from fusionnet.views import EnvironmentalView, load_views


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Where the data of a build lies; its digests are part of the plan.

    Attributes:
        data: Folder of the corpus's files; None for the one that FUSIONNET_DATA names, or for a
            corpus that is part of this package.
        views: Folder of the environmental views, or the name of shipped ones; None for none.
    """

    data: Path | None = None
    views: str | None = None

    def environmental_views(self) -> tuple[EnvironmentalView, ...]:
        """The views; none if none are named.

        Raises:
            InputError: If there is no such folder or name.
            DataError: If they are damaged.
        """
        return () if self.views is None else load_views(self.views)

    def absolute(self) -> "Sources":
        """The same places for a process with another working folder and other variables."""
        data = self.data or named_data()
        views = self.views
        if views is not None and Path(views).exists():  # otherwise it is a shipped name
            views = str(Path(views).resolve())
        return Sources(data=data and data.resolve(), views=views)


def corpus_digest(corpus: Corpus) -> str:
    """A checksum over all that a data set takes from a corpus."""
    digest = hashlib.blake2b(digest_size=16)
    for command in corpus.commands:
        scene = command.scene
        layouts = (layout_to_json(scene.before), layout_to_json(scene.after))
        said = (command.id, command.sentence, format_tree(command.tree), scene.group, *layouts)
        digest.update(repr(said).encode())
    return digest.hexdigest()


def views_digest(views: Sequence[EnvironmentalView]) -> str:
    """A checksum over pictures, poses, lamps and parts; empty for no views."""
    digest = hashlib.blake2b(digest_size=16)
    for view in views:
        about = (view.name, view.environment, view.part, view.image.shape)
        digest.update(repr(about).encode())
        for array in (view.image, view.matrix, view.camera_from_board, view.light_directions):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest() if views else ""


def planned_recipes(plan: BuildPlan, sources: Sources) -> Recipes:
    """The recipes of a plan, of the corpus that it was made for.

    Raises:
        DataError: If the corpus is damaged, missing, or another one.
        InputError: If it has no commands for a split.
    """
    corpus = load_corpus(plan.corpus, sources.data)
    _check_digest(corpus_digest(corpus), plan.corpus_digest, f"commands of {plan.corpus!r}")
    return Recipes(plan, corpus)


def _planned_views(plan: BuildPlan, sources: Sources) -> tuple[EnvironmentalView, ...]:
    views = sources.environmental_views()
    _check_digest(views_digest(views), plan.views_digest, f"views ({sources.views})")
    return views


def _check_digest(found: str, planned: str, what: str) -> None:
    if found != planned:
        raise DataError(
            f"The data set was planned with other {what}: the checksum here is "
            f"{found or 'none'}, not {planned or 'none'}. Every process needs the files that it "
            "was planned with; if they were changed, build into a new folder."
        )


def check_plan(plan: BuildPlan, sources: Sources) -> None:
    """Accept a plan that can be followed, before anything is written.

    Raises:
        UnknownNameError: If there is no such robot, or it has no such eye.
        DataError: If the corpus is damaged, missing, or another one.
        InputError: If it has no commands for a split.
    """
    cameras = [camera.name for camera in robots.load(plan.robot).spec().cameras] + [EXTERNAL]
    for eye in plan.eyes:
        if eye not in cameras:
            raise UnknownNameError(
                f"The robot {plan.robot!r} has no camera called {eye!r}; available: "
                f"{', '.join(cameras)}.{did_you_mean(eye, cameras)}"
            )
    planned_recipes(plan, sources)


class Studio:
    """Takes the pictures of a plan's recipes.

    Args:
        plan: What to build.
        sources: Where its data lies.

    Raises:
        DataError: If the corpus or the views are damaged, missing, or not those of the plan.
        RenderingError: If pictures cannot be rendered here.
    """

    def __init__(self, plan: BuildPlan, sources: Sources) -> None:
        self.recipes = planned_recipes(plan, sources)
        views = _planned_views(plan, sources)
        self._eyes = Eyes(plan.robot, plan.size)
        self._photographs = (
            Photographs(views, plan.robot, plan.size, plan.strength, plan.sensor) if views else None
        )

    def shot(self, recipe: Recipe) -> Shot:
        """The picture that a recipe asks for."""
        layout, camera = recipe.command.scene.before, recipe.camera
        if recipe.kind == EYE:
            return self._eyes.shot(layout, camera, recipe.seed, recipe.displaced)
        assert self._photographs is not None
        return self._photographs.shot(layout, camera, recipe.seed, recipe.noised)


@lru_cache(maxsize=1)
def studio(plan: BuildPlan, sources: Sources) -> Studio:
    """The studio of this process: corpus, model and OpenGL context are costly to open."""
    return Studio(plan, sources)
