"""The planner: refusals in plain sentences, and laws that hold for every tree and layout."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.blocks import (
    HOLDING_HEIGHT,
    Block,
    Cell,
    Color,
    Gripper,
    Layout,
    Move,
    Shape,
    apply,
    plan,
    random_layout,
    validate,
)
from fusionnet.errors import PlanningError
from fusionnet.rcl import parse
from rcl_trees import trees

# Under test, beartype looks into containers by chance, also while trees are being drawn.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")


def layout(*columns: str, held: str | None = None) -> Layout:
    """Columns like "34 red green^": x, y and from the bottom up; ^ is a pyramid."""
    blocks = []
    for column in columns:
        place, *names = column.split()
        for z, name in enumerate(names):
            shape = Shape.PRISM if name.endswith("^") else Shape.CUBE
            cell = Cell(int(place[0]), int(place[1]), z)
            blocks.append(Block(Color(name.rstrip("^")), shape, cell))
    if held is None:
        return Layout(tuple(blocks))
    cell = Cell(4, 4, 6)
    shape = Shape.PRISM if held.endswith("^") else Shape.CUBE
    blocks.append(Block(Color(held.rstrip("^")), shape, cell))
    return Layout(tuple(blocks), Gripper(cell, closed=True))


def entity(words: str, *relations: str) -> str:
    """The text of an entity from words like "leftmost red cube"."""
    *before, kind = words.split()
    leaves = [f"({'color' if w in set(Color) else 'indicator'}: {w})" for w in before]
    return f"(entity: {' '.join([*leaves, f'(type: {kind})', *relations])})"


def relation(kind: str, landmark: str = "", squares: int | None = None) -> str:
    tiles = f"(measure: (entity: (cardinal: {squares}) (type: tile)))" if squares else ""
    return f"(spatial-relation: {tiles} (relation: {kind}) {landmark})"


def command(action: str, what: str, where: str = "") -> str:
    destination = f"(destination: {where})" if where else ""
    return f"(event: (action: {action}) {what} {destination})"


def planned(text: str, where: Layout, **options: bool) -> Move:
    return plan(parse(text), where, **options)


def refusal(text: str, where: Layout) -> str:
    with pytest.raises(PlanningError) as refused:
        planned(text, where)
    message = str(refused.value)
    assert message.endswith(".")
    assert message[0].isupper() or message[0] in "'0123456789"
    return message


TABLE = layout("25 red^", "43 blue", "56 green yellow", "11 red", "62 red red")


def onto(what: str, landmark: str) -> str:
    return command("move", entity(what), relation("above", entity(landmark)))


@pytest.mark.parametrize(
    ("text", "source", "target"),
    [
        (onto("red prism", "blue cube"), (2, 5, 0), (4, 3, 1)),
        (onto("blue cube", "red stack"), (4, 3, 0), (6, 2, 2)),
        (onto("blue cube", "green yellow stack"), (4, 3, 0), (5, 6, 2)),
        (onto("blue cube", "individual red cube"), (4, 3, 0), (1, 1, 1)),
        (onto("blue cube", "nearest red cube"), (4, 3, 0), (1, 1, 1)),
        (command("move", entity("blue cube"), relation("left", squares=3)), (4, 3, 0), (4, 6, 0)),
        (command("move", entity("blue cube"), relation("forward", squares=1)),
         (4, 3, 0), (5, 3, 0)),
        (command("move", entity("blue cube"), relation("right", entity("prism"))),
         (4, 3, 0), (2, 4, 0)),
        (command("move", entity("blue cube"), relation("front", entity("prism"), 2)),
         (4, 3, 0), (4, 5, 0)),
        (command("move", entity("blue cube"), relation("within", entity("front left corner"))),
         (4, 3, 0), (7, 7, 0)),
        (command("move", entity("rightmost cube"), relation("above", entity("prism"))), None, None),
    ],
)  # fmt: skip
def test_moves(text, source, target):
    if source is None:
        assert refusal(text, TABLE) == "Nothing can rest on the tip of the red pyramid."
    else:
        assert planned(text, TABLE) == Move(Cell(*source), Cell(*target))


def test_a_take_lifts_straight_up_and_a_drop_lets_down():
    take = planned(command("take", entity("yellow cube")), TABLE)
    assert take == Move(Cell(5, 6, 1), Cell(5, 6, HOLDING_HEIGHT), ends_held=True)
    holding = apply(take, TABLE)
    assert holding.held == Block(Color.YELLOW, Shape.CUBE, take.target)
    drop = planned(command("drop", entity("cube")), holding)
    assert drop == Move(take.target, Cell(5, 6, 1), begins_held=True)
    assert apply(drop, holding).same_blocks(TABLE)
    assert planned(onto("yellow cube", "blue cube"), holding).target == Cell(4, 3, 1)
    down = command("drop", entity("cube"), relation("above", entity("board")))
    assert planned(down, layout("00 red", held="blue")).target == Cell(4, 4, 0)


def test_a_sequence_is_one_move():
    sequence = (
        "(sequence: (event: (action: take) (entity: (id: 1) (color: red) (type: prism))) "
        "(event: (action: drop) (entity: (type: reference) (reference-id: 1)) "
        "(destination: (spatial-relation: (relation: above) "
        "(entity: (color: blue) (type: cube))))))"
    )
    assert planned(sequence, TABLE) == planned(onto("red prism", "blue cube"), TABLE)


@pytest.mark.parametrize("columns", [(), ("44 green",)])
def test_a_dropped_block_can_be_named_by_its_looks(columns):
    holding = layout("43 blue", *columns, held="red")
    drop = command("drop", entity("red cube"), relation("above", entity("blue cube")))
    take = command("take", entity("red cube"))
    move = planned(f"(sequence: {drop} {take})", holding)
    assert move == Move(Cell(4, 4, 6), Cell(4, 3, 5), begins_held=True, ends_held=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (onto("cyan prism", "blue cube"), "There is no cyan pyramid here."),
        (onto("red prism", "white cube"), "There is no white cube here."),
        (command("take", entity("green cube")), "Something rests on top of the green cube."),
        (command("take", entity("red cube")),
         "2 blocks match 'the red cube', at (1, 1, 0), (6, 2, 1); say which one is meant."),
        (command("take", entity("red stack")),
         "'the red stack' is more than one block; name one block."),
        (command("take", entity("left corner")),
         "The left corner is a place; only a block can be moved."),
        (command("take", entity("cube", relation("above", entity("blue cube")))),
         "No cube is on the blue cube."),
        (command("take", entity("individual green cube")),
         "No single green cube stands by itself."),
        (command("drop", entity("red prism")), "Nothing is held, so nothing can be put down."),
        (onto("blue cube", "green cube"), "Something rests on top of the green cube."),
        (onto("blue cube", "prism"), "Nothing can rest on the tip of the red pyramid."),
        (onto("yellow cube", "green cube"), "The yellow cube already is there."),
        (command("move", entity("blue cube"), relation("right", squares=4)),
         "That place is off the board."),
        (command("move", entity("blue cube"), relation("above", entity("center region"))),
         "3 places match 'into the centre of the board', at (3, 3, 0), (3, 4, 0), (4, 4, 0); "
         "say which one is meant."),
        (command("move", entity("blue cube"), relation("above", entity("board"))),
         "It is not clear where on the board."),
        (command("move", entity("blue cube")), "It is not said where the blue cube shall go."),
        (command("move", entity("blue cube"), relation("above", entity("robot"))),
         "Nothing can be put on the robot."),
        (command("take", "(entity: (type: reference) (reference-id: 3))"),
         "'it' refers to something that was not named before."),
        (command("take", "(entity: (cardinal: 2) (color: red) (type: cube))"),
         "'the two red cubes' is more than one block; name one block at a time."),
    ],
)  # fmt: skip
def test_refusals_are_sentences(text, message):
    assert refusal(text, TABLE) == message


def test_refusals_about_the_gripper():
    holding = layout("43 blue", held="red^")
    assert refusal(command("take", entity("blue cube")), holding) == (
        "The gripper already holds the red pyramid."
    )
    assert refusal(command("drop", entity("blue cube")), holding) == (
        "The gripper holds the red pyramid, not the blue cube."
    )
    assert refusal(
        command("move", entity("left corner"), relation("left", squares=1)), holding
    ) == ("The gripper holds the red pyramid, not the left corner.")


def test_a_full_tower_is_refused():
    tower = layout("33 " + "green " * 8, "43 blue")
    assert refusal(onto("blue cube", "green stack"), tower) == (
        "The tower below is already 8 blocks high."
    )


def test_softened_colours():
    table = layout("43 cyan", "25 white^")
    text = onto("gray prism", "blue cube")
    assert refusal(text, table) == "There is no gray pyramid here."
    assert planned(text, table, soften=True) == Move(Cell(2, 5, 0), Cell(4, 3, 1))


def test_apply_refuses_what_cannot_be():
    with pytest.raises(PlanningError, match=r"no block at \(0, 0, 0\)"):
        apply(Move(Cell(0, 0, 0), Cell(1, 1, 1)), TABLE)
    with pytest.raises(PlanningError, match=r"\(4, 3, 0\) is occupied"):
        apply(Move(Cell(2, 5, 0), Cell(4, 3, 0)), TABLE)


def test_the_level_of_a_held_block_does_not_count():
    low, high = layout("00 red", held="blue"), layout("00 red", held="blue")
    cell = Cell(4, 4, 3)
    low = Layout((low.blocks[0], Block(Color.BLUE, Shape.CUBE, cell)), Gripper(cell, closed=True))
    assert low.same_blocks(high)
    assert not low.same_blocks(layout("00 red", held="red"))
    assert not low.same_blocks(layout("00 red"))


@settings(max_examples=50)
@given(trees, st.integers(0, 2**32 - 1))
def test_every_tree_gives_a_move_or_a_sentence(tree, seed):
    before = random_layout(np.random.default_rng(seed), blocks=12)
    for soften in (False, True):
        try:
            move = plan(tree, before, soften=soften)
        except PlanningError as refused:
            assert str(refused).endswith(".")
        else:
            check_move(move, before)


simple = st.builds(
    lambda action, what, kind, landmark: command(
        action, entity(what), relation(kind, entity(landmark))
    ),
    st.sampled_from(["move", "drop", "take"]),
    st.sampled_from(["cube", "prism", "leftmost cube", "nearest prism", "red cube", "blue prism"]),
    st.sampled_from(["above", "left", "right", "forward", "within", "adjacent"]),
    st.sampled_from(["cube", "rightmost cube", "stack", "front left corner", "leftmost prism"]),
)


@given(simple, st.integers(0, 2**32 - 1))
def test_a_move_keeps_all_blocks_and_the_laws_of_the_table(text, seed):
    before = random_layout(np.random.default_rng(seed))
    try:
        move = planned(text, before)
    except PlanningError:
        return
    check_move(move, before)


def check_move(move: Move, before: Layout) -> None:
    after = apply(move, before)
    validate(after)
    assert move.source.on_grid and move.target.on_grid
    assert move.begins_held == (before.held is not None)
    assert move.ends_held == (after.held is not None)
    assert [(b.color, b.shape) for b in after.blocks] == [(b.color, b.shape) for b in before.blocks]
    changed = set(after.blocks) ^ set(before.blocks)
    assert {block.cell for block in changed} <= {move.source, move.target}
    assert (move.source == move.target) <= move.ends_held
