"""Which of several readings a layout agrees with: the first that can be executed in it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

from fusionnet.blocks import Layout, Move, plan
from fusionnet.blocks.grounding import SOFTENED
from fusionnet.errors import PlanningError, TreeError
from fusionnet.models.reading import Reading
from fusionnet.models.tree_symbols import symbols_of, tree_of
from fusionnet.rcl import Tree

LEAST_SHARE = 0.01
"""Below this share of the best reading's probability, another is no reading of the sentence:
training leaves every wrong symbol about a thousandth."""

_PAIRS = [(color, other) for color, other in SOFTENED.items() if color is not other]
CONFUSED = {f"color:{a}": f"color:{b}" for pair in _PAIRS for a, b in (pair, pair[::-1])}
"""Colours that people take for each other, as symbols."""

MOST_CONFUSED = 6
"""Colours of a tree that may be taken for another; a tree with more keeps what was said."""


@dataclass(frozen=True)
class GroundedReading:
    """A reading that can be executed.

    Attributes:
        reading: Tree and probability. Where colours were softened, the tree names them as the
            scene has them, not as they were said.
        move: What the arm has to do.
        place: How many more probable readings could not be executed.
        softened: Whether cyan had to pass for blue, or white for gray, or the reverse.
    """

    reading: Reading
    move: Move
    place: int
    softened: bool

    @property
    def remark(self) -> str:
        """What a person should know about the choice, in one sentence; often nothing."""
        remarks = []
        if self.place:
            remarks.append("took a less probable reading, because the scene does not fit the first")
        if self.softened:
            remarks.append("let cyan pass for blue and white for gray, or the reverse")
        return (" and ".join(remarks).capitalize() + ".") if remarks else ""


def grounded(
    readings: Sequence[Reading], layout: Layout, *, least_share: float = LEAST_SHARE
) -> GroundedReading:
    """The first reading that the planner executes; if none, the first with colours softened.

    Args:
        readings: The most probable first.
        layout: The blocks before the command.
        least_share: Readings below this share of the best one's probability do not count.

    Raises:
        PlanningError: If no reading can be executed; says why the best one cannot.
    """
    likely = [r for r in readings if r.probability >= least_share * readings[0].probability]
    reason: PlanningError | None = None
    for softened in (False, True):
        for place, reading in enumerate(likely):
            try:
                move = plan(reading.tree, layout, soften=softened)
            except PlanningError as error:
                reason = reason or error
            else:
                if softened:
                    reading = replace(reading, tree=_as_seen(reading.tree, layout, move))
                return GroundedReading(reading, move, place, softened)
    raise reason or PlanningError("There is no reading to execute.")


def _as_seen(tree: Tree, layout: Layout, move: Move) -> Tree:
    """The tree with as few colours exchanged as make it ask for the move in this layout."""
    try:
        run = symbols_of(tree)
        places = [at for at, symbol in enumerate(run) if symbol.name in CONFUSED]
        if len(places) > MOST_CONFUSED:
            return tree
        counts = range(1, len(places) + 1)
        for chosen in chain.from_iterable(combinations(places, count) for count in counts):
            named = [
                symbol._replace(name=CONFUSED[symbol.name]) if at in chosen else symbol
                for at, symbol in enumerate(run)
            ]
            seen = tree_of(named)
            try:
                if plan(seen, layout) == move:
                    return seen
            except PlanningError:
                continue
    except TreeError:  # a tree as no corpus has one
        pass
    return tree
