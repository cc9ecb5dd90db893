"""The symbolic reading of a doubtful picture: the planner votes over layouts drawn from it.

One wrongly seen block makes the planner fail or go astray on the likeliest layout.
Drawing many layouts from what was seen, executing every reading of the sentence in
each and adding up the weights of the moves uses what is certain and averages over
what is not.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fusionnet.blocks.grid import EMPTY, Color, Layout, Move
from fusionnet.blocks.planner import plan
from fusionnet.blocks.plausibility import COLORS, DrawnLayouts, PlausibleLayouts
from fusionnet.errors import InputError, PlanningError
from fusionnet.rcl import Color as ColorWord
from fusionnet.rcl import Entity, Event, SpatialRelation, Tree
from fusionnet.rcl import Sequence as EventSequence

LEAST_SHARE = 1e-3
"""Readings this many times less probable than the best are not executed."""

LEAST_TURNOUT = 0.1
"""A reading that can be executed in a smaller share of the drawn layouts has no vote: on 206
validation scenes the commands about blocks that are not there never reached it, and those about
blocks that are there nearly always did, by far (0.62 and more)."""

LEAST_WEIGHT = 0.01
"""All votes together must weigh this much, or far-fetched readings would decide."""

_TWINS = {
    Color.BLUE: Color.CYAN,
    Color.CYAN: Color.BLUE,
    Color.GRAY: Color.WHITE,
    Color.WHITE: Color.GRAY,
}


@dataclass(frozen=True)
class Vote:
    """What the planner's votes say.

    Attributes:
        votes: Weight of each move, the heaviest first; all weights add up to at most 1.
        move: The elected move; None if readings could be executed in hardly any layout.
        tree: The reading behind it, or the likeliest reading.
        softened: Whether cyan had to pass for blue, or white for gray, or the reverse.
        refusal: Why nothing could be executed; empty if something was.
    """

    votes: Mapping[Move, float]
    move: Move | None
    tree: Tree
    softened: bool = False
    refusal: str = ""

    @property
    def share(self) -> float:
        """Share of the elected move among all votes that were given, 0 to 1."""
        total = sum(self.votes.values())
        return self.votes[self.move] / total if self.move is not None else 0.0

    @property
    def turnout(self) -> float:
        """Weight of the readings and layouts that could be executed at all, 0 to 1."""
        return sum(self.votes.values())


def likely_layout(occupancy: Float[np.ndarray, "8 8 8 17"], holding: float) -> Layout:
    """The most likely physically possible layout behind a reader's probabilities.

    Raises:
        InputError: If an array has the wrong shape or a value is not a probability.
    """
    return PlausibleLayouts(occupancy, holding).likeliest()


def vote(
    occupancy: Float[np.ndarray, "8 8 8 17"],
    holding: float,
    readings: Sequence[tuple[Tree, float]],
    rng: np.random.Generator,
    samples: int = 64,
) -> Vote:
    """Let the planner vote on a sentence's readings over layouts drawn from a picture's reading.

    Args:
        occupancy: Probabilities of the 16 classes of `CLASS_NAMES` and of emptiness.
        holding: Probability that the gripper holds a block.
        readings: Trees and their probabilities, the likeliest first.
        rng: Source of the layouts.
        samples: How many layouts are drawn; the likeliest one votes as well.

    Raises:
        InputError: If there is no reading, or the probabilities are none.
    """
    if not readings:
        raise InputError("There is no reading of the sentence to vote on.")
    least = LEAST_SHARE * max(probability for _, probability in readings)
    electorate = [(tree, float(p)) for tree, p in readings if p >= least]
    total = sum(p for _, p in electorate)
    plausible = PlausibleLayouts(occupancy, holding)
    drawn = plausible.draw(rng, samples)
    for softened in (False, True):
        votes: dict[Move, float] = {}
        behind: dict[Move, dict[int, float]] = {}
        for number, (tree, probability) in enumerate(electorate):
            shares = _executed(drawn, tree, softened)
            if sum(shares.values()) < LEAST_TURNOUT:
                continue
            for move, share in shares.items():
                weight = share * probability / total
                votes[move] = votes.get(move, 0.0) + weight
                behind.setdefault(move, {})[number] = weight
        if sum(votes.values()) >= LEAST_WEIGHT:
            order = sorted(votes, key=lambda move: -votes[move])
            of_move = behind[order[0]]
            tree, _ = electorate[max(of_move, key=lambda number: of_move[number])]
            return Vote({move: votes[move] for move in order}, order[0], tree, softened)
    return Vote({}, None, electorate[0][0], refusal=_refusal(electorate[0][0], plausible))


def _executed(drawn: DrawnLayouts, tree: Tree, softened: bool) -> dict[Move, float]:
    """The moves that a tree comes to, and the share of the drawn layouts that each comes from."""
    shares: dict[Move, float] = {}
    for layout, share in _distinct(drawn, tree, softened):
        try:
            move = plan(tree, layout, soften=softened)
        except PlanningError:
            continue
        shares[move] = shares.get(move, 0.0) + share
    return shares


def _refusal(tree: Tree, plausible: PlausibleLayouts) -> str:
    """Why the likeliest reading cannot be executed in the likeliest layout."""
    try:
        plan(tree, plausible.likeliest())
    except PlanningError as error:
        return str(error)
    return "What was seen is too uncertain to act on."


def _distinct(drawn: DrawnLayouts, tree: Tree, softened: bool) -> list[tuple[Layout, float]]:
    """The drawn layouts that differ in what the tree speaks of, and their shares.

    Colours that the tree does not name are all alike to the planner.
    """
    named = {Color(color) for color in _colors(tree)}
    if softened:
        named |= {_TWINS[color] for color in named if color in _TWINS}
    classes = drawn.classes
    if named and len(named) < COLORS - 1:
        classes = _alike(named)[classes]
    alike = DrawnLayouts(classes, drawn.held)
    rows = zip(classes.astype(np.uint8), drawn.held, strict=True)
    keys = [(row.tobytes(), int(held)) for row, held in rows]
    first = {key: place for place, key in reversed(list(enumerate(keys)))}
    shares = Counter(keys)
    return [(alike.layout(first[key]), n / len(keys)) for key, n in shares.items()]


def _alike(named: set[Color]) -> Int[np.ndarray, "17"]:
    """For each class the one that stands for it: all unnamed colours become one."""
    other = next(place for place, color in enumerate(Color) if color not in named)
    stands = [place if color in named else other for place, color in enumerate(Color)]
    return np.array([*stands, *(COLORS + place for place in stands), EMPTY])


def _colors(node: Tree | Entity | SpatialRelation | None) -> set[ColorWord]:
    """The colours that a tree names."""
    if isinstance(node, EventSequence):
        return set().union(*(_colors(event) for event in node.events))
    if isinstance(node, Event):
        return _colors(node.entity) | _colors(node.destination)
    if isinstance(node, SpatialRelation):
        return _colors(node.entity)
    if isinstance(node, Entity):
        own = {leaf.value for leaf in node.colors}
        return own.union(*(_colors(relation) for relation in node.relations))
    return set()
