"""Where the data of a build comes from, opened once a process."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from fusionnet.blocks import layout_to_json
from fusionnet.corpora import Corpus, load_corpus
from fusionnet.dataset.plan import BuildPlan
from fusionnet.dataset.recipes import Recipe, Recipes
from fusionnet.dataset.shots import Eyes, Shot
from fusionnet.rcl import format as format_tree


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Where the data of a build lies; its digests are part of the plan.

    Attributes:
        data: Folder of the corpus's files; None for a corpus that needs none.
        views: Folder of the environmental views; None for none.
    """

    data: Path | None = None
    views: Path | None = None


def corpus_digest(corpus: Corpus) -> str:
    """A checksum over all that a data set takes from a corpus."""
    digest = hashlib.blake2b(digest_size=16)
    for command in corpus.commands:
        scene = command.scene
        layouts = (layout_to_json(scene.before), layout_to_json(scene.after))
        said = (command.id, command.sentence, format_tree(command.tree), scene.group, *layouts)
        digest.update(repr(said).encode())
    return digest.hexdigest()


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

    def shot(self, recipe: Recipe) -> Shot:
        """The picture that a recipe asks for."""
        return self._eyes.shot(recipe.command.scene.before, recipe.camera, recipe.seed)


@lru_cache(maxsize=1)
def studio(plan: BuildPlan, sources: Sources) -> Studio:
    """The studio of this process: corpus, model and OpenGL context are costly to open."""
    return Studio(plan, sources)
