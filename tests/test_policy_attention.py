"""What each part of a command rests on: words, cells, and pixels of the picture."""

import dataclasses
import json

import numpy as np
import pytest

from fusionnet import load_policy, make_world
from fusionnet.blocks import Cell
from fusionnet.corpora import load_corpus
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera
from fusionnet.models.tree_symbols import owned_symbols, symbols_of
from fusionnet.policy._attention import attended_pixels
from fusionnet.rcl import Entity, Event, SpatialRelation, parse

COMMAND = load_corpus("examples", None).commands[2]


@pytest.fixture(scope="module")
def world():
    return make_world(layout=COMMAND.scene.before)


@pytest.fixture(scope="module")
def answer(world):
    return load_policy("compact")(world.image("left_eye"), COMMAND.sentence)


def marked(attention):
    return [word for word, share in attention.words if share > 0.1]


def test_every_part_has_its_words_and_its_cell(answer):
    assert {part.label: (marked(part), tuple(part.cell)) for part in answer.attention} == {
        "the green one": (["green", "one"], (2, 2, 0)),
        "the blue cube on the green one": (["blue", "cube"], (2, 2, 1)),
        "the red and yellow stack": (["red", "yellow", "stack"], (3, 5, 1)),
        "grasp": (["move"], (2, 2, 1)),
        "place": (["onto"], (3, 5, 2)),
    }


def test_shares_are_shares(answer):
    for part in answer.attention:
        assert part.cells.min() >= 0 and part.cells.sum() == pytest.approx(1, abs=1e-4)
        shares = [share for _, share in part.words]
        assert min(shares) >= 0 and sum(shares) <= 1 + 1e-4


def test_a_block_is_lit_where_it_is_seen(answer, world):
    """The lit pixels are those of the block's exact mask, but for its rim."""
    green, blue = answer.attention[0], answer.attention[1]
    view = world.view("left_eye", masks=True)
    for part in (green, blue):
        block = COMMAND.scene.before.blocks.index(COMMAND.scene.before.at(part.cell))
        mask, lit = view.block_at == block, answer.pixels(part) > 0.5
        assert lit.shape == mask.shape
        assert (lit & mask).sum() / (lit | mask).sum() > 0.85
    assert not (answer.pixels(green) * answer.pixels(blue) > 0.5).any()  # one stands on the other


def test_empty_cells_are_squares_and_cubes(answer):
    for cell, tall in (((7, 1, 0), False), ((7, 1, 2), True)):
        assert answer.layout.at(Cell(*cell)) is None
        cells = np.zeros(512)
        cells[Cell(*cell).index] = 1.0
        lit = answer.pixels(dataclasses.replace(answer.attention[0], cells=cells))
        rows, columns = np.nonzero(lit > 0.5)
        assert rows.size and bool(np.ptp(rows) > np.ptp(columns)) is tall


def test_a_camera_that_cannot_see_the_board_lights_nothing(answer):
    away = np.eye(4)
    away[2, 3] = -10.0
    camera = PinholeCamera(64, 48, np.eye(3), away)
    assert not attended_pixels(answer.source, answer.layout, camera).any()
    with pytest.raises(InputError, match="no camera"):
        dataclasses.replace(answer, camera=None).pixels(answer.attention[0])


def test_attention_goes_to_json_compactly(answer):
    found = json.loads(json.dumps(answer.as_json(), allow_nan=False))["attention"]
    assert [part["of"] for part in found] == [part.label for part in answer.attention]
    assert [word["word"] for word in found[2]["words"]] == ["red", "yellow", "stack"]
    assert found[4]["cells"][0]["cell"] == [3, 5, 2]
    assert len(json.dumps(found)) < 2500


def test_a_block_that_is_lifted_rests_on_the_verb(world):
    answer = load_policy("compact")(world.image("left_eye"), "pick up the blue cube")
    place = answer.attention[-1]
    assert place.label == "place" and marked(place) == ["pick", "up"]


def test_every_symbol_belongs_to_one_node():
    tree = parse(
        "(event: (action: move) (entity: (color: red) (type: prism)) (destination: "
        "(spatial-relation: (measure: (entity: (cardinal: 2) (type: tile))) (relation: left) "
        "(entity: (color: blue) (type: cube) (spatial-relation: (relation: above) "
        "(entity: (type: board)))))))"
    )
    owned = owned_symbols(tree)
    assert tuple(symbol for _, symbol in owned) == symbols_of(tree)
    assert [(type(node), symbol.name) for node, symbol in owned] == [
        (Event, "action:move"),
        (Entity, "color:red"),
        (Entity, "type:prism"),
        (SpatialRelation, "destination"),
        (SpatialRelation, "measure"),
        (SpatialRelation, "cardinal:2"),
        (SpatialRelation, "type:tile"),
        (SpatialRelation, "relation:left"),
        (Entity, "color:blue"),
        (Entity, "type:cube"),
        (Entity, "relation:above"),
        (Entity, "type:board"),
    ]
    blue = tree.destination.entity
    assert [node is blue for node, _ in owned[-4:]] == [True, True, True, False]
