"""What a run draws: boxes and labels, trees over their words, boards, heat."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from fusionnet import rcl
from fusionnet.apps.board_drawing import board_svg, heat_svg, highest_level
from fusionnet.apps.drawing import PAINT, Box, around, draw_boxes, hexadecimal, ink_on
from fusionnet.apps.tree_drawing import draw_tree, parts_of
from fusionnet.blocks import CLASS_NAMES, Block, Cell, Color, Gripper, Layout, Move, Shape
from fusionnet.corpora import load_corpus
from fusionnet.sentences import tokenize

TABLE = (150, 140, 120)


def plain_picture(width: int = 960, height: int = 540) -> np.ndarray:
    return np.full((height, width, 3), TABLE, np.uint8)


def contrast(a: tuple[int, int, int], b: tuple[int, int, int]) -> float:
    """Contrast ratio as in WCAG 2."""

    def luminance(color: tuple[int, int, int]) -> float:
        linear = [
            c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
            for c in (v / 255 for v in color)
        ]
        return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))

    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("color", Color)
def test_labels_are_readable_on_every_color(color) -> None:
    assert contrast(PAINT[color], ink_on(PAINT[color])) >= 4.0


def test_every_class_has_a_paint_and_a_name_for_people() -> None:
    for name in CLASS_NAMES:
        box = Box(name, 1.0, (0, 0, 1, 1))
        assert box.color in PAINT
        assert box.label.split()[1] in ("cube", "pyramid")
    assert Box("prism_red", 1.0, (0, 0, 1, 1)).label == "red pyramid"


def test_boxes_are_drawn_in_the_blocks_own_color() -> None:
    boxes = [
        Box("cube_red", 0.9, (400, 200, 460, 260)),
        Box("prism_cyan", 0.8, (520, 300, 560, 340)),
    ]
    drawn = draw_boxes(plain_picture(), boxes)
    for box in boxes:
        painted = (drawn == PAINT[box.color]).all(axis=2).sum()
        assert painted > 500, box.label
    assert not (drawn == PAINT["green"]).all(axis=2).any()


def test_a_picture_without_boxes_is_shown_whole() -> None:
    assert around([], (960, 540)) == (0, 0, 960, 540)
    drawn = draw_boxes(plain_picture(), [])
    assert drawn.shape == (1080, 1920, 3) and (drawn == TABLE).all()


corners = st.tuples(st.floats(0, 900), st.floats(0, 480), st.floats(2, 60), st.floats(2, 60)).map(
    lambda c: (c[0], c[1], c[0] + c[2], c[1] + c[3])
)
some_boxes = st.lists(
    st.builds(Box, st.sampled_from(CLASS_NAMES), st.just(0.9), corners), max_size=60
)


@settings(max_examples=40)
@given(some_boxes.filter(bool))
def test_the_part_around_holds_every_box_and_keeps_the_shape(boxes) -> None:
    left, top, right, bottom = around(boxes, (960, 540))
    assert 0 <= left < right <= 960 and 0 <= top < bottom <= 540
    assert (right - left) / (bottom - top) == pytest.approx(960 / 540, rel=0.05)
    for box in boxes:
        assert left <= box.corners[0] + 1 and box.corners[2] <= right + 1
        assert top <= box.corners[1] + 1 and box.corners[3] <= bottom + 1


def test_crowds_and_odd_pictures_can_be_drawn() -> None:
    crowd = [Box(CLASS_NAMES[i % 16], 0.5, (i * 7, 200, i * 7 + 12, 215)) for i in range(60)]
    assert draw_boxes(plain_picture(), crowd).shape[2] == 3
    outside = [Box("cube_red", 0.5, (-20, -20, 30, 30)), Box("cube_blue", 0.5, (50, 50, 50, 50))]
    assert draw_boxes(plain_picture(64, 64), outside).shape[2] == 3


TREE = rcl.parse(
    "(event: (action: move (token: 1)) (entity: (color: red (token: 3)) (type: prism (token: 4))) "
    "(destination: (spatial-relation: (relation: above (token: 5 7)) (entity: (id: 1) "
    "(color: blue (token: 9)) (type: cube (token: 10))))))"
)
SENTENCE = "place the red pyramid on top of the blue block"


def test_parts_stand_in_the_order_of_their_words() -> None:
    root = parts_of(TREE)
    assert root.name == "event" and root.height == 4
    assert [leaf.value for leaf in root.leaves] == [
        "move", "red", "prism", "above", "blue", "cube", "1",
    ]  # fmt: skip


@pytest.mark.parametrize("count", [10, 4, 0])
def test_a_tree_is_drawn_over_its_words(count, tmp_path) -> None:
    words = SENTENCE.split()[:count]
    svg, png = tmp_path / "tree.svg", tmp_path / "tree.png"
    draw_tree(TREE, words, svg, png)
    written = "".join(ElementTree.parse(svg).getroot().itertext())
    for word in [*words, "event", "destination", "above", "blue"]:
        assert word in written
    assert hexadecimal(PAINT["blue"]) in svg.read_text()
    with Image.open(png) as picture:
        assert picture.width > 400 and picture.height > 300


def test_words_stand_below_their_leaves(tmp_path) -> None:
    svg = tmp_path / "tree.svg"
    draw_tree(TREE, SENTENCE.split(), svg)
    at = {}
    for element in ElementTree.parse(svg).getroot().iter("{http://www.w3.org/2000/svg}text"):
        at.setdefault("".join(element.itertext()), []).append(float(element.get("x")))
    assert at["red"][0] == pytest.approx(at["red"][1])  # the leaf, and the word below it
    assert at["prism"] == pytest.approx(at["pyramid"])
    assert at["on"][0] < at["above"][0] < at["of"][0]
    words = [at[word][-1] for word in SENTENCE.split() if word != "the"]
    assert words == sorted(words)


def test_drawing_twice_gives_the_same_file(tmp_path) -> None:
    for name in ("a.svg", "b.svg"):
        draw_tree(TREE, SENTENCE.split(), tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_hostile_words_stay_words(tmp_path) -> None:
    words = ["<script>", "$\\frac{1}$", "&amp;", "\u6f22\U0001f600", '"'] * 2
    draw_tree(TREE, words, tmp_path / "tree.svg")
    svg = (tmp_path / "tree.svg").read_text(encoding="utf-8")
    assert "<script>" not in svg and "&lt;script&gt;" in svg


def test_every_leaf_of_the_examples_is_drawn() -> None:
    for command in load_corpus("examples").commands:
        said = {token for leaf in parts_of(command.tree).leaves for token in leaf.tokens}
        written = rcl.format(command.tree)
        assert len(parts_of(command.tree).leaves) == sum(
            written.count(f"({name}: ")
            for name in (*rcl.LEAF_VALUES, "id", "cardinal", "reference-id")
        )
        assert max(said) <= len(tokenize(command.sentence))


LAYOUT = Layout(
    (
        Block(Color.RED, Shape.PRISM, Cell(4, 3, 5)),
        Block(Color.BLUE, Shape.CUBE, Cell(0, 0, 0)),
        Block(Color.GREEN, Shape.CUBE, Cell(0, 0, 1)),
    ),
    Gripper(Cell(4, 3, 5), closed=True),
)


def test_a_board_shows_every_block_the_move_and_the_hand() -> None:
    move = Move(Cell(4, 3, 5), Cell(0, 0, 2), begins_held=True)
    svg = board_svg(LAYOUT, move=move, title="before & after")
    root = ElementTree.fromstring(svg)
    polygons = [e for e in root.iter("polygon") if not e.get("class", "").startswith("tile")]
    assert len(polygons) == 4 + 3 + 3 + 2  # a pyramid, two cubes, the outlined target
    assert root.find("path[@class='arrow']") is not None
    assert root.find("title").text == "before & after"
    assert highest_level(LAYOUT, move) == 5


def test_near_blocks_cover_far_ones() -> None:
    svg = board_svg(LAYOUT, title="board")
    blue, green = (
        svg.index(hexadecimal(tuple(round(c * 0.88) for c in PAINT[color])))
        for color in ("blue", "green")
    )
    far = svg.index(hexadecimal(tuple(round(c * 0.92) for c in PAINT["red"])))
    assert far < blue < green


def test_heat_stands_where_the_probability_is() -> None:
    cells = np.zeros(512)
    cells[Cell(2, 3, 0).index], cells[Cell(2, 3, 4).index], cells[Cell(7, 7, 0).index] = (
        0.5,
        0.2,
        0.3,
    )
    opacities = sorted(
        float(o) for o in re.findall(r'fill-opacity="([\d.]+)"', heat_svg(cells, title="x"))
    )
    assert opacities == [0.3, 0.7]
