"""Trees and their text: each the inverse of the other, and nothing malformed gets through."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.errors import TreeError
from fusionnet.rcl import (
    LEAF_VALUES,
    Action,
    Color,
    Event,
    Relation,
    Sequence,
    Type,
    describe,
    events,
    format,
    outline,
    parse,
)
from rcl_trees import trees

# Under test, beartype looks into containers by chance, also while trees are being drawn.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")

FIGURE = (
    "(event: (action: move (token: 1)) (entity: (color: green (token: 2)) "
    "(type: prism (token: 3))) (destination: (spatial-relation: (relation: above (token: 4 6)) "
    "(entity: (color: red (token: 7)) (type: cube (token: 8))))))"
)
"""The tree of thesis figure 2.11: "place green pyramid on top of red brick"."""


def tokens_of(text: str) -> list[str]:
    return re.findall(r"token: [^)]*", text)


@settings(max_examples=50)
@given(trees)
def test_parse_inverts_format(tree):
    text = format(tree)
    again = parse(text)
    assert again == tree
    assert format(again) == text  # tokens take no part in equality, but come back too
    assert parse(format(tree, tokens=False)) == tree
    assert "token" not in format(tree, tokens=False)


@settings(max_examples=50)
@given(trees, st.data())
def test_a_text_with_a_bracket_missing_is_refused_with_its_position(tree, data):
    text = format(tree)
    at = data.draw(st.sampled_from([i for i, c in enumerate(text) if c in "()"]))
    with pytest.raises(TreeError, match=r"Malformed tree at character \d+: .+") as refused:
        parse(text[:at] + text[at + 1 :])
    position = re.search(r"character (\d+)", str(refused.value))
    assert position is not None
    assert 1 <= int(position.group(1)) <= len(text)


@given(st.text(max_size=60) | st.text("(): abcdefeventityknmov-1 ", max_size=80))
def test_no_text_whatever_ends_in_another_error(text):
    try:
        tree = parse(text)
    except TreeError as refused:
        assert "character" in str(refused)
    else:
        assert parse(format(tree)) == tree


def test_the_figure_of_the_thesis():
    tree = parse(FIGURE)
    assert isinstance(tree, Event)
    assert tree.action.value is Action.MOVE
    assert tree.entity.colors[0].value is Color.GREEN
    assert tree.entity.type.value is Type.PRISM
    assert tree.destination is not None and tree.destination.entity is not None
    assert tree.destination.relation.value is Relation.ABOVE
    assert tree.destination.relation.tokens == (4, 5, 6)
    assert tree.destination.entity.type.tokens == (8,)
    assert format(tree) == FIGURE
    assert describe(tree) == "Move the green pyramid onto the red cube."


def test_equality_leaves_word_positions_out():
    assert parse(FIGURE) == parse(FIGURE.replace("(token: 4 6)", "(token: 5)"))
    assert parse(FIGURE) != parse(FIGURE.replace("green", "blue"))
    assert len({parse(FIGURE), parse(FIGURE.replace(" (token: 1)", ""))}) == 1


def test_children_may_come_in_any_order_and_spacing():
    loose = (
        "  ( event:\n (destination: (spatial-relation: (entity: (type: cube) (color: red))"
        " (relation: above))) (entity: (type: prism)(color: green)) (action:move) )\n"
    )
    assert parse(loose) == parse(FIGURE)


def malformed(text: str) -> str:
    with pytest.raises(TreeError) as refused:
        parse(text)
    return str(refused.value)


@pytest.mark.parametrize(
    ("text", "position", "reason"),
    [
        ("", 1, "there is no tree"),
        ("   ", 4, "there is no tree"),
        ("put the red cube down", 1, "expected '(name: ...)' or ')'"),
        (")", 1, "')' closes nothing"),
        ("(event: (action: move)", 23, "'event' from character 1 is not closed"),
        ("(event: (action: move) (entity: (type: cube))) )", 48, "text after the end"),
        ("(event: (action: fly) (entity: (type: cube)))", 9, "no action is called 'fly'"),
        ("(event: (entity: (type: cube)))", 1, "an event needs an action"),
        ("(event: (action: take) (entity: (color: red)))", 24, "an entity needs a type"),
        (
            "(event: (action: take) (action: drop) (entity: (type: cube)))",
            1,
            "holds 'action' twice",
        ),
        ("(event: (action: take) (entity: (type: cube) (type: cube)))", 24, "holds 'type' twice"),
        ("(event: (action: take) (color: red) (entity: (type: cube)))", 1, "cannot hold a color"),
        ("(event: (action: take) (entity: (kind: cube)))", 33, "no leaf called 'kind'"),
        ("(event: (action: take) (entity: (entity: cube)))", 33, "holds further nodes"),
        ("(event: (action: take) (entitty: (type: cube)))", 24, "Did you mean 'entity'"),
        ("(event: (action: take) (entity: (type:)))", 33, "no value stands behind 'type'"),
        ("(event: (action: take) (entity: (type: cube) (id: 0)))", 46, "1 to 999, not 0"),
        ("(event: (action: take) (entity: (type: cube) (id: 01)))", 46, "not written as a whole"),
        ("(event: (action: take) (entity: (type: cube) (id: x)))", 46, "whole number, not 'x'"),
        ("(event: (action: take (token: 3 2)) (entity: (type: cube)))", 9, "run backwards"),
        ("(entity: (type: cube))", 1, "begins with an event or sequence, not 'entity'"),
        ("(type: cube)", 1, "begins with an event or sequence, not 'type'"),
        ("(sequence:)", 1, "a sequence needs an event"),
        ("(event: (action: take) (entity: (type: cúbe)))", 33, "no type is called 'cúbe'"),
    ],
)
def test_each_fault_is_named_with_its_position(text, position, reason):
    message = malformed(text)
    assert f"character {position}:" in message
    assert reason in message


def test_texts_without_measure_are_refused():
    assert "at most 20000" in malformed("(" * 100_000)
    deep = "(event: (action: take) " + "(entity: (spatial-relation: " * 30
    assert "more than 40 levels" in malformed(deep)


def test_events_of_a_sequence():
    tree = parse(
        "(sequence: (event: (action: take) (entity: (id: 1) (type: cube))) (event: (action: drop) "
        "(entity: (type: reference) (reference-id: 1)) (destination: (spatial-relation: "
        "(measure: (entity: (cardinal: 2) (type: tile))) (relation: left)))))"
    )
    assert isinstance(tree, Sequence)
    assert [event.action.value for event in events(tree)] == [Action.TAKE, Action.DROP]
    assert events(tree.events[0]) == (tree.events[0],)
    assert describe(tree) == "Pick up the cube, then put it two squares to the left."
    assert outline(tree).splitlines()[:5] == [
        "sequence",
        "  event: take",
        "    entity: cube",
        "      id: 1",
        "  event: drop",
    ]


def relation_of(kind: str, landmark: str) -> str:
    return f"(spatial-relation: (relation: {kind}) (entity: {landmark}))"


@pytest.mark.parametrize(
    ("relation", "said"),
    [
        (relation_of("above", "(color: blue) (color: red) (type: stack)"),
         "on the blue and red stack"),
        (relation_of("within", "(indicator: left) (indicator: front) (type: corner)"),
         "in the far left corner"),
        (relation_of("nearest", "(indicator: back) (type: region)"),
         "nearest to the near side of the board"),
        (relation_of("within", "(indicator: center) (type: region)"), "in the centre of the board"),
        (relation_of("above", "(type: edge)"), "on an edge"),
        (relation_of("above", "(type: board)"), "on the board"),
        (relation_of("nearest", "(type: robot)"), "nearest to the robot"),
        (relation_of("adjacent", "(indicator: individual) (color: red) (type: cube)"),
         "next to the single red cube"),
    ],
)  # fmt: skip
def test_descriptions_of_relations(relation, said):
    tree = parse(f"(event: (action: take) (entity: (type: prism) {relation}))")
    assert describe(tree) == f"Pick up the pyramid {said}."


@settings(max_examples=50)
@given(trees)
def test_everything_can_be_described_and_outlined(tree):
    assert describe(tree).endswith(".")
    assert "  " not in describe(tree)
    assert "Leaf(" not in outline(tree) + describe(tree)


def test_values_for_networks_are_the_enumerations():
    assert LEAF_VALUES["action"] == ("take", "drop", "move")
    assert {name: len(values) for name, values in LEAF_VALUES.items()} == {
        "action": 3,
        "type": 13,
        "color": 8,
        "indicator": 9,
        "relation": 9,
    }
