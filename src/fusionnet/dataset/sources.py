"""Where the data of a build comes from, opened once a process."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from fusionnet.blocks import layout_to_json
from fusionnet.corpora import Corpus, load_corpus
from fusionnet.dataset.plan import BuildPlan
from fusionnet.dataset.recipes import EYE, Recipe, Recipes
from fusionnet.dataset.shots import Eyes, Photographs, Shot
from fusionnet.rcl import format as format_tree
from fusionnet.views import EnvironmentalView, load_views


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Where the data of a build lies; its digests are part of the plan.

    Attributes:
        data: Folder of the corpus's files; None for a corpus that needs none.
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


class Studio:
    """Takes the pictures of a plan's recipes.

    Args:
        plan: What to build.
        sources: Where its data lies.

    Raises:
        DataError: If the corpus is damaged or missing.
        RenderingError: If pictures cannot be rendered here.
    """

    def __init__(self, plan: BuildPlan, sources: Sources) -> None:
        self.recipes = Recipes(plan, load_corpus(plan.corpus, sources.data))
        self._eyes = Eyes(plan.robot, plan.size)
        views = sources.environmental_views()
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
