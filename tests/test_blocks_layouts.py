"""Layouts: random ones obey gravity, and files are read with suspicion."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusionnet.blocks import (
    CLASS_NAMES,
    GRID,
    Block,
    Cell,
    Color,
    Gripper,
    Layout,
    Shape,
    layout_from_json,
    layout_to_json,
    random_layout,
    read_layout,
    validate,
    write_layout,
)
from fusionnet.errors import InputError, OutputError

seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.none() | st.integers(1, 256), st.none() | st.booleans())
def test_random_layouts_neither_overlap_nor_float(seed, blocks, held):
    layout = random_layout(np.random.default_rng(seed), blocks=blocks, held=held)
    validate(layout)
    resting = {block.cell: block for block in layout.resting}
    assert len(layout.blocks) == len({block.cell for block in layout.blocks})
    for x, y, z in resting:
        assert z == 0 or resting[Cell(x, y, z - 1)].shape is Shape.CUBE
    assert blocks is None or len(layout.blocks) == blocks
    assert held is None or (layout.held is not None) == held
    assert layout.gripper.closed == (layout.held is not None)


def test_random_layouts_depend_on_their_generator_alone():
    one, two, other = (random_layout(np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert one == two != other


def test_random_layouts_are_of_many_kinds():
    rng = np.random.default_rng(0)
    layouts = [random_layout(rng) for _ in range(300)]
    assert 15 <= sum(layout.held is not None for layout in layouts) <= 60
    assert {len(layout.blocks) for layout in layouts} >= set(range(3, 20))
    assert max(block.cell.z for layout in layouts for block in layout.resting) >= 4
    classes = {block.class_index for layout in layouts for block in layout.blocks}
    assert classes == set(range(len(CLASS_NAMES)))


@pytest.mark.parametrize("blocks", [0, 257])
def test_random_layouts_refuse_other_sizes(blocks):
    with pytest.raises(ValueError, match="1 to 256"):
        random_layout(np.random.default_rng(0), blocks=blocks)


@given(seeds)
def test_json_gives_the_layout_back(seed):
    layout = random_layout(np.random.default_rng(seed))
    assert layout_from_json(json.loads(json.dumps(layout_to_json(layout)))) == layout


def test_files_give_the_layout_back(tmp_path):
    layout = Layout((Block(Color.RED, Shape.PRISM, Cell(1, 2, 0)),), Gripper(Cell(0, 0, 7)), 4)
    write_layout(layout, tmp_path / "layout.json")
    assert read_layout(tmp_path / "layout.json") == layout
    assert [path.name for path in tmp_path.iterdir()] == ["layout.json"]
    (tmp_path / "usual").touch()
    modes = [(tmp_path / name).stat().st_mode for name in ("layout.json", "usual")]
    assert modes[0] == modes[1]
    write_layout(Layout(()), tmp_path / "empty.json")
    assert read_layout(tmp_path / "empty.json") == Layout(())


def test_a_file_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="Cannot write"):
        write_layout(Layout(()), tmp_path / "file" / "layout.json")


def block(color="red", shape="cube", cell=(0, 0, 0)):
    return {"color": color, "shape": shape, "cell": list(cell)}


def test_other_words_for_shapes_and_colours():
    layout = layout_from_json({"blocks": [block("grey", "pyramid")]})
    assert layout.blocks == (Block(Color.GRAY, Shape.PRISM, Cell(0, 0, 0)),)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([], "Expected a layout as a JSON object, found []."),
        ({}, "A layout needs the field 'blocks'."),
        ({"blocks": 3}, "'blocks' is a list of blocks, not 3."),
        ({"blocks": [], "griper": {}},
         "A layout has no field 'griper'; it has blocks, gripper, id. Did you mean 'gripper'?"),
        ({"blocks": [], "id": True}, "A layout's 'id' is a whole number, not True."),
        ({"blocks": [], "gripper": {"cell": [0, 0, 8]}},
         "The gripper at (0, 0, 8) is off the grid; x, y and z are 0 to 7."),
        ({"blocks": [], "gripper": {"cell": [0, 0, 7], "closed": 1}},
         "The gripper's 'closed' is true or false, not 1."),
        ({"blocks": ["red"]}, "Expected block 1 as a JSON object, found 'red'."),
        ({"blocks": [block(color="rde")]},
         "The color of block 1 is 'rde'; known: blue, cyan, red, yellow, green, magenta, gray, "
         "white, grey. Did you mean 'red'?"),
        ({"blocks": [block(color=["red"])]},
         "The color of block 1 is ['red']; known: blue, cyan, red, yellow, green, magenta, gray, "
         "white, grey."),
        ({"blocks": [block(shape="ball")]},
         "The shape of block 1 is 'ball'; known: cube, prism, pyramid."),
        ({"blocks": [block(cell=(0, 0))]},
         "The cell of block 1 is three whole numbers [x, y, z] from 0 to 7, not [0, 0]."),
        ({"blocks": [block(cell=(0, 0, 0.5))]},
         "The cell of block 1 is three whole numbers [x, y, z] from 0 to 7, not [0, 0, 0.5]."),
        ({"blocks": [block(cell=(8, 0, 0))]},
         "The red cube at (8, 0, 0) is off the grid; x, y and z are 0 to 7."),
        ({"blocks": [block(), block("blue")]},
         "2 blocks overlap in the cell (0, 0, 0); it has room for one."),
        ({"blocks": [block(cell=(0, 0, 1))]},
         "The red cube at (0, 0, 1) floats: nothing is below it, "
         "and the closed gripper is not there."),
        ({"blocks": [block(shape="prism"), block(cell=(0, 0, 1))]},
         "The red cube at (0, 0, 1) stands on the tip of a pyramid."),
        ({"blocks": [block(), block("blue", cell=(0, 0, 1))],
          "gripper": {"cell": [0, 0, 0], "closed": True}},
         "The blue cube at (0, 0, 1) rests on the block that the gripper holds."),
    ],
)  # fmt: skip
def test_faults_of_layouts_are_named(value, message):
    with pytest.raises(InputError) as refused:
        layout_from_json(value)
    assert str(refused.value) == message


def test_a_grid_has_room_for_512_blocks():
    with pytest.raises(InputError, match="513 blocks; the grid has 512 cells"):
        layout_from_json({"blocks": [block()] * 513})
    full = [block(cell=(x, y, z)) for x in range(GRID) for y in range(GRID) for z in range(GRID)]
    assert len(layout_from_json({"blocks": full}).blocks) == 512


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not JSON: Expecting value in line 1, column 1."),
        (b'{"blocks": [\n]', "is not JSON: Expecting ',' delimiter in line 2, column 2."),
        (b"\xff\xfe\x00", "is not JSON: it is not UTF-8 text."),
        (b"[" * 200_000, "is no layout: its JSON is beyond all measure."),
        (b'{"id": ' + b"9" * 5000 + b"}", "is no layout: its JSON is beyond all measure."),
        (b" " * 1_000_001, "has more than 1000000 bytes: it is not a layout."),
        (b'{"blocks": [NaN]}', "Expected block 1 as a JSON object, found nan."),
    ],
)
def test_faults_of_files_are_named(tmp_path, content, message):
    path = tmp_path / "layout.json"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_layout(path)
    assert message in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_missing_file_and_a_folder(tmp_path):
    with pytest.raises(InputError, match="There is no file"):
        read_layout(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read_layout(tmp_path)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["blocks", "gripper", "id", "cell", "closed", "color", "shape"]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=8,
)


@given(json_values)
def test_no_json_whatever_ends_in_another_error(value):
    try:
        validate(layout_from_json(value))
    except InputError as refused:
        assert len(str(refused)) > 10
