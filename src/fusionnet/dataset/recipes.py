"""The causes of each sample: which command, in which layout, through which camera.

Sample `i` of a split depends on the plan, the corpus and `i` alone. Recorded layouts are
shown by turns, each in every view before any view comes again (thesis 3.2.4), and with
each of its sentences by turns; in training a turn that goes to an eye, or to a varied layout,
is left out. Varied layouts come from the training groups only, and none that equals a layout
of a held-out group is let through.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

from fusionnet.blocks import Block, Layout, Scene, apply
from fusionnet.corpora import Command, Corpus, part_of
from fusionnet.corpora.synthetic import spoken
from fusionnet.dataset.layouts import varied_layout
from fusionnet.dataset.plan import SPLITS, BuildPlan
from fusionnet.errors import InputError
from fusionnet.randomness import derived_seed, generator

EYE, VIEW = "eye", "view"
"""The two kinds of cameras."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """The causes of one sample.

    Attributes:
        id: Split and number.
        command: Sentence, tree and scene.
        origin: `recorded` in the corpus, or `varied`.
        kind: Kind of camera: `eye` or `view`.
        camera: Name of the robot's camera, or of the view.
        noised: Whether a view's picture is varied (thesis 3.2.5, level 1).
        seed: Of everything random in the sample.
        displaced: Whether blocks before the robot's eyes stand beside the middle of their cells.
    """

    id: str
    command: Command
    origin: str
    kind: str
    camera: str
    noised: bool
    seed: int
    displaced: bool = False


class Recipes:
    """Recipes of all samples of a plan.

    Args:
        plan: What to build.
        corpus: Where scenes and sentences come from.

    Raises:
        InputError: If the corpus has no commands for a split.
    """

    def __init__(self, plan: BuildPlan, corpus: Corpus) -> None:
        self.plan = plan
        wanted = {SPLITS[split][0] for split, count in plan.counts if count}
        self._layouts: dict[str, list[list[Command]]] = {}
        for part in sorted(wanted):
            self._layouts[part] = _by_layout(corpus.split(part))
            if not self._layouts[part]:
                raise InputError(
                    f"The corpus {corpus.name!r} has no commands in {part!r}; use a larger one."
                )
        self.real = training_layouts(corpus)
        self.held_out = held_out_layouts(corpus)

    def recipe(self, split: str, index: int) -> Recipe:
        """The causes of sample `index` of a split."""
        plan = self.plan
        part, cameras = SPLITS[split]
        seed = derived_seed(plan.seed, "dataset", split, index)
        rng = generator(seed, "recipe")
        training = split == "train"
        through_eye, varied, noised = rng.random(3) < (
            plan.eyes_share,
            plan.varied,
            plan.noised,
        )
        views = () if cameras == "eyes" else plan.views[cameras == "val"]
        if not views or (training and through_eye):
            views = ()
        displaced = generator(seed, "displaced").random() < plan.displaced
        layouts = self._layouts[part]
        order = generator(plan.seed, "dataset layouts", split).permutation(len(layouts))
        place = int(order[index % len(layouts)])
        turn = index // len(layouts)
        names = views or plan.eyes
        if training and varied:
            command, origin = self._varied(seed), "varied"
        else:
            said = layouts[place]
            command, origin = said[(turn // len(names) + place) % len(said)], "recorded"
        return Recipe(
            id=f"{split}-{index:08d}",
            command=command,
            origin=origin,
            kind=VIEW if views else EYE,
            camera=names[(turn + place) % len(names)],
            noised=bool(training and noised),
            displaced=bool(training and not views and displaced),
            seed=seed,
        )

    def _varied(self, seed: int) -> Command:
        """A sentence of our own for a layout that no held-out group has."""
        rng = generator(seed, "layout")
        chance = Random(generator(seed, "sentence").integers(1 << 62).item())
        while True:
            before = varied_layout(rng, self.real, invented=self.plan.invented)
            if frozenset(before.blocks) in self.held_out:
                continue
            found = spoken(before, chance)
            if found is not None:
                sentence, tree, move = found
                scene = Scene(before, apply(move, before))
                return Command(0, sentence, tree, scene, "synthetic")


def training_layouts(corpus: Corpus) -> list[Layout]:
    """The layouts of the training groups, each once, in the order of their numbers."""
    scenes = [command.scene for command in corpus.split("train")]
    unique = {id(layout): layout for s in scenes for layout in (s.before, s.after)}
    return sorted(unique.values(), key=lambda layout: layout.id or 0)


def held_out_layouts(corpus: Corpus) -> frozenset[frozenset[Block]]:
    """The blocks of every layout of the groups that are not trained on."""
    scenes = [s for s in corpus.scenes.values() if part_of(s.group) != "train"]
    return frozenset(frozenset(layout.blocks) for s in scenes for layout in (s.before, s.after))


def _by_layout(commands: Sequence[Command]) -> list[list[Command]]:
    """Commands by the layout before, both in the order of the corpus."""
    grouped: dict[Layout, list[Command]] = {}
    for command in commands:
        grouped.setdefault(command.scene.before, []).append(command)
    return list(grouped.values())
