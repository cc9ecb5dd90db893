"""Hypothesis strategies for Robot Command Language trees."""

from hypothesis import strategies as st

from fusionnet.rcl import (
    Action,
    Color,
    Entity,
    Event,
    Indicator,
    Leaf,
    Measure,
    Relation,
    Sequence,
    SpatialRelation,
    Type,
)

positions = st.integers(1, 60).flatmap(
    lambda first: st.integers(0, 3).map(lambda more: tuple(range(first, first + more + 1)))
)
tokens = st.just(()) | positions
numbers = st.integers(1, 999)


def leaves(values):
    return st.tuples(values, tokens).map(lambda parts: Leaf(*parts))


squares = leaves(st.just(Type.TILE))


@st.composite
def entities(draw, depth: int = 2):
    return Entity(
        type=draw(leaves(st.sampled_from(Type))),
        colors=tuple(draw(st.lists(leaves(st.sampled_from(Color)), max_size=2))),
        indicators=tuple(draw(st.lists(leaves(st.sampled_from(Indicator)), max_size=2))),
        cardinal=draw(st.none() | leaves(st.integers(1, 9))),
        relations=tuple(draw(st.lists(relations(depth - 1), max_size=1))) if depth else (),
        id=draw(st.none() | leaves(numbers)),
        reference_id=draw(st.none() | leaves(st.integers(1, 3))),
    )


@st.composite
def relations(draw, depth: int = 2):
    tiles = st.builds(lambda count, kind: Entity(kind, cardinal=count), leaves(numbers), squares)
    measure = draw(st.none() | st.builds(Measure, tiles))
    landmark = draw(st.none() | entities(depth))
    return SpatialRelation(draw(leaves(st.sampled_from(Relation))), landmark, measure)


event_trees = st.builds(Event, leaves(st.sampled_from(Action)), entities(), st.none() | relations())
trees = event_trees | st.lists(event_trees, min_size=1, max_size=2).map(
    lambda events: Sequence(tuple(events))
)
