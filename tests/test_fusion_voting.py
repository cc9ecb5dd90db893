"""The planner's vote over layouts that a reader's probabilities leave open."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.blocks import EMPTY, Cell, Color, Layout, Shape, plan, random_layout, validate
from fusionnet.blocks.plausibility import PlausibleLayouts, layout_from_classes
from fusionnet.blocks.voting import likely_layout, vote
from fusionnet.corpora import load_corpus
from fusionnet.errors import InputError
from fusionnet.rcl import parse
from fusionnet.training.simulated_readings import cells_of, exact_readings, simulated_readings

TAKE_RED = parse("(event: (action: take) (entity: (color: red) (type: cube)))")
TAKE_BLUE = parse("(event: (action: take) (entity: (color: blue) (type: cube)))")
TAKE_CYAN = parse("(event: (action: take) (entity: (color: cyan) (type: cube)))")
RED, BLUE, CYAN, GREEN = (
    list(Color).index(c) for c in (Color.RED, Color.BLUE, Color.CYAN, Color.GREEN)
)


def occupancy(**cells: dict[int, float]) -> np.ndarray:
    """Probabilities from `c123={class: p}`: the rest of a cell's mass is empty."""
    result = np.zeros((8, 8, 8, 17))
    result[..., EMPTY] = 1
    for name, classes in cells.items():
        x, y, z = (int(digit) for digit in name[1:])
        for number, probability in classes.items():
            result[x, y, z, number] = probability
        result[x, y, z, EMPTY] = 1 - sum(classes.values())
    return result


def elect(cells: np.ndarray, *readings, holding: float = 0.0, samples: int = 64):
    return vote(cells, holding, list(readings), np.random.default_rng(0), samples)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), holding=st.floats(0, 1))
def test_every_drawn_layout_is_physically_possible(seed: int, holding: float) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.dirichlet(np.full(17, 0.1), size=(8, 8, 8))
    plausible = PlausibleLayouts(cells, holding)
    drawn = plausible.draw(rng, 4)
    for layout in [plausible.likeliest(), *(drawn.layout(place) for place in range(4))]:
        validate(layout)


def test_a_certain_reading_gives_the_layout_and_the_planners_move_back() -> None:
    for command in load_corpus("examples").commands:
        before = command.scene.before
        cells, held = cells_of([before])
        exact, holding = exact_readings(cells, held)
        assert likely_layout(exact[0], float(holding[0])).same_blocks(before)
        elected = elect(exact[0], (command.tree, 1.0), holding=float(holding[0]))
        assert elected.move == plan(command.tree, before)
        assert elected.share == elected.turnout == pytest.approx(1.0)
        assert elected.tree == command.tree


def test_a_likely_block_outvotes_an_unlikely_one() -> None:
    cells = occupancy(c110={RED: 0.95}, c550={RED: 0.3})
    elected = elect(cells, (TAKE_RED, 1.0))
    assert elected.move is not None
    assert elected.move.source == Cell(1, 1, 0)
    assert 0.5 < elected.share < 1
    assert elected.turnout < 1  # two red cubes, or none: nobody votes


def test_hidden_cells_below_a_block_are_filled_whatever_was_seen() -> None:
    cells = occupancy(c330={GREEN: 0.4}, c331={GREEN: 0.4}, c332={RED: 0.99})
    assert elect(cells, (TAKE_RED, 1.0)).move.source == Cell(3, 3, 2)


def test_a_phantom_in_the_air_is_not_believed() -> None:
    cells = occupancy(c110={RED: 0.9}, c554={RED: 0.6})
    assert likely_layout(cells, 0.0).same_blocks(likely_layout(occupancy(c110={RED: 0.9}), 0.0))


def test_what_hangs_in_the_air_is_held_if_something_is() -> None:
    cells = occupancy(c110={RED: 0.9}, c554={RED: 0.6})
    layout = likely_layout(cells, 0.95)
    assert layout.held is not None
    assert layout.held.cell == Cell(5, 5, 4)
    drop = parse("(event: (action: drop) (entity: (color: red) (type: cube)))")
    assert elect(cells, (drop, 1.0), holding=0.95).move.target == Cell(5, 5, 0)


def test_a_reading_that_the_scene_does_not_fit_gives_way_to_one_that_it_does() -> None:
    elected = elect(occupancy(c110={RED: 1.0}), (TAKE_BLUE, 0.8), (TAKE_RED, 0.2))
    assert elected.tree == TAKE_RED
    assert elected.turnout == pytest.approx(0.2)


def test_cyan_passes_for_blue_only_when_nothing_else_can_be_done() -> None:
    elected = elect(occupancy(c110={BLUE: 1.0}), (TAKE_CYAN, 1.0))
    assert elected.softened
    assert elected.move.source == Cell(1, 1, 0)
    both = elect(occupancy(c110={BLUE: 1.0}, c440={CYAN: 1.0}), (TAKE_CYAN, 1.0))
    assert not both.softened
    assert both.move.source == Cell(4, 4, 0)


def test_a_refusal_says_what_the_planner_says() -> None:
    elected = elect(occupancy(c110={GREEN: 1.0}), (TAKE_RED, 1.0))
    assert elected.move is None
    assert elected.share == 0
    assert "red cube" in elected.refusal


def test_unnamed_colours_change_no_vote() -> None:
    rng = np.random.default_rng(3)
    layout = random_layout(rng)
    cells, held = cells_of([layout])
    soft, holding = simulated_readings(cells, held, rng, np.array([0.6]))
    for tree in (TAKE_RED, TAKE_BLUE):
        for place in range(8):
            drawn = PlausibleLayouts(soft[0], 0.0).draw(np.random.default_rng(place), 1).layout(0)
            repainted = Layout(
                tuple(
                    b
                    if b.color in (Color.RED, Color.BLUE)
                    else type(b)(Color.GREEN, b.shape, b.cell)
                    for b in drawn.blocks
                ),
                drawn.gripper,
            )
            assert _outcome(tree, drawn) == _outcome(tree, repainted)


def _outcome(tree, layout):
    try:
        return plan(tree, layout)
    except ValueError:
        return None


def test_votes_are_the_same_for_the_same_generator() -> None:
    cells = occupancy(c110={RED: 0.6}, c550={RED: 0.5}, c660={BLUE: 0.4, CYAN: 0.4})
    assert elect(cells, (TAKE_RED, 1.0)).votes == elect(cells, (TAKE_RED, 1.0)).votes


def test_bad_arrays_are_refused() -> None:
    with pytest.raises(InputError, match="probabilities"):
        likely_layout(occupancy(), 1.5)
    with pytest.raises(InputError, match="probabilities"):
        likely_layout(np.full((8, 8, 8, 17), np.nan), 0.0)
    for beyond in (-0.2, 1.2):
        with pytest.raises(InputError, match="probabilities"):
            likely_layout(occupancy(c123={RED: beyond}), 0.0)
    with pytest.raises(InputError, match="no reading"):
        vote(occupancy(), 0.0, [], np.random.default_rng(0))


def test_classes_and_layouts_correspond() -> None:
    layout = random_layout(np.random.default_rng(5))
    cells, held = cells_of([layout])
    assert layout_from_classes(cells[0].ravel(), int(held[0])).same_blocks(layout)
    assert {b.shape for b in layout.blocks} <= set(Shape)
