"""Commands without end, of our own making: layouts, trees and sentences by chance.

Each command depends on the seed and on its number alone. A layout is drawn, then
a tree that speaks of it, until the planner can execute one; then the tree is put
into words. Scene n belongs to group (n - 1) mod 125 + 1, so that the parts of the
corpus are of the usual sizes.
"""

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from random import Random

from fusionnet.blocks import Layout, Move, Scene, apply, plan, random_layout
from fusionnet.corpora._command import GROUPS, Command, Corpus
from fusionnet.corpora._meanings import Meanings
from fusionnet.corpora._wording import word
from fusionnet.errors import PlanningError
from fusionnet.randomness import generator
from fusionnet.rcl import Tree

TRIES = 8
"""Trees drawn for a layout before another layout is drawn."""

CORPUS_SIZE = 2_000
"""Commands in what `load_corpus("synthetic")` gives; for more, see `commands`."""


def read(
    data: Path | None = None,
    *,
    skip_bad: bool = False,
    seed: int = 0,
    size: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Corpus:
    """The first `size` commands of a seed; `data` and `skip_bad` change nothing.

    `progress` is called now and then with the commands made and those wanted.
    """
    size = CORPUS_SIZE if size is None else size
    made = _first(seed, size, progress)
    scenes = {c.scene.id: c.scene for c in made if c.scene.id is not None}
    both = [layout for scene in scenes.values() for layout in (scene.before, scene.after)]
    layouts = {layout.id: layout for layout in both if layout.id is not None}
    return Corpus("synthetic", made, scenes, layouts)


CORPUS = read
TERMS = "our own synthetic commands, which the package `fusionnet` (Apache-2.0) makes by chance"

_kept: dict[int, list[Command]] = {}
"""The commands of the seed that was last asked for: several parts of one run ask for the same."""


def _first(
    seed: int, size: int, progress: Callable[[int, int], None] | None
) -> tuple[Command, ...]:
    """Commands 1 to `size` of a seed."""
    if seed not in _kept:
        _kept.clear()
    made = _kept.setdefault(seed, [])
    for number in range(len(made) + 1, size + 1):
        made.append(command(seed, number))
        if progress is not None and number % 100 == 0:
            progress(number, size)
    return tuple(made[:size])


def commands(seed: int = 0, start: int = 1) -> Iterator[Command]:
    """Commands without end, from number `start` on."""
    return (command(seed, number) for number in count(start))


def command(seed: int, number: int) -> Command:
    """Command `number` (from 1) of a seed, the same whenever and wherever it is made."""
    rng = generator(seed, "corpora", "synthetic", number)
    chance = Random(int(rng.integers(1 << 62)))
    while True:
        layout = random_layout(rng)
        found = spoken(layout, chance)
        if found is None:
            continue
        sentence, tree, move = found
        before = Layout(layout.blocks, layout.gripper, 2 * number - 1)
        after = apply(move, layout)
        after = Layout(after.blocks, after.gripper, 2 * number)
        scene = Scene(before, after, number, (number - 1) % GROUPS + 1)
        return Command(number, sentence, tree, scene, "synthetic")


def spoken(layout: Layout, chance: Random) -> tuple[str, Tree, Move] | None:
    """A sentence for a given layout, its tree and its move; None if none was found in some tries.

    Args:
        layout: What the sentence speaks of.
        chance: Where chance comes from.
    """
    meanings = Meanings(layout, chance)
    for _ in range(TRIES):
        tree = meanings.tree()
        move = None if tree is None else _move(tree, layout)
        if tree is None or move is None:
            continue
        sentence, tree = word(tree, chance)
        return sentence, tree, move
    return None


def _move(tree: Tree, layout: Layout) -> Move | None:
    try:
        return plan(tree, layout)
    except PlanningError:
        return None
