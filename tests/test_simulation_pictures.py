"""What the robot's eyes see: pictures agree with the camera model, labels with pictures."""

import gc
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fusionnet import robots
from fusionnet.blocks import CLASS_NAMES, Block, Cell, Color, Gripper, Layout, Shape, random_layout
from fusionnet.errors import InputError, RenderingError, UnknownNameError
from fusionnet.geometry import apply, invert
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer, World
from fusionnet.simulation.renderer import EXTERNAL
from fusionnet.simulation.tabletop import BLOCK_HALF

GOLDEN = Path(__file__).with_name("golden") / "left_eye.png"
SMALL = (480, 270)


@pytest.fixture(scope="module")
def renderer(pictures_here):
    made = SceneRenderer(size=SMALL)
    yield made
    made.close()


def block(name: str, *cell: int) -> Block:
    shape, color = name.split("_")
    return Block(Color(color), Shape(shape), Cell(*cell))


def corners(renderer: SceneRenderer, cell: Cell) -> np.ndarray:
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return renderer.robot.cell_position(cell) + signs * BLOCK_HALF


EVERY_KIND = Layout(
    tuple(
        Block(color, shape, Cell(2 * (i % 4), 2 * (i // 4) + 1 + 3 * (shape is Shape.PRISM), 0))
        for shape in Shape
        for i, color in enumerate(Color)
        if not (shape is Shape.PRISM and i >= 4)
    )
)


@pytest.mark.parametrize("camera", ["left_eye", "right_eye", EXTERNAL])
@pytest.mark.parametrize("cell", [Cell(0, 0, 0), Cell(7, 7, 0), Cell(3, 4, 7), Cell(7, 0, 3)])
def test_a_block_appears_where_the_camera_model_projects_it(renderer, camera, cell):
    seen = renderer.view(Layout((Block(Color.RED, Shape.CUBE, cell),)), camera)
    pixels = seen.camera.project(corners(renderer, cell))
    projected = np.r_[pixels.min(axis=0) + 0.5, pixels.max(axis=0) + 0.5]
    np.testing.assert_allclose(seen.boxes[0], projected, atol=1.01)


@pytest.mark.parametrize("seed", range(3))
def test_every_box_lies_within_the_projected_block_whatever_the_look(renderer, seed):
    rng = generator(seed, "boxes")
    layout = random_layout(rng)
    look = Appearance.sample(rng)
    seen = renderer.view(layout, appearance=look)
    assert len(seen.boxes) == len(seen.classes) == np.count_nonzero(seen.visible)
    for box, index, class_index in zip(seen.boxes, seen.indices, seen.classes, strict=True):
        assert class_index == layout.blocks[index].class_index
        pixels = seen.camera.project(corners(renderer, layout.blocks[index].cell)) + 0.5
        margin = 3.5  # displaced by up to 1.5 mm and turned by a few degrees
        assert np.all(box[:2] >= np.floor(pixels.min(axis=0)) - margin)
        assert np.all(box[2:] <= np.ceil(pixels.max(axis=0)) + margin)
        assert 0 < seen.visible[index] <= (box[2] - box[0]) * (box[3] - box[1])


def test_a_block_behind_a_tower_has_fewer_pixels_than_alone(renderer):
    behind = block("cube_red", 7, 3, 0)
    tower = tuple(block("cube_blue", 6, 3, z) for z in range(3))
    alone = renderer.view(Layout((behind,))).visible[0]
    hidden = renderer.view(Layout((behind, *tower)))
    assert hidden.visible[0] < 0.3 * alone
    assert hidden.visible[1:].min() > 0


def test_a_block_enclosed_by_others_has_no_box(renderer):
    around = [Cell(x, y, z) for x in range(3) for y in range(3) for z in range(2)]
    around.remove(Cell(1, 1, 0))
    layout = Layout(
        (block("cube_red", 1, 1, 0), *(Block(Color.GRAY, Shape.CUBE, cell) for cell in around))
    )
    seen = renderer.view(layout)
    assert seen.visible[0] == 0
    assert 0 not in seen.indices


def test_masks_are_the_visible_pixels_of_each_box(renderer):
    layout = random_layout(generator(5, "masks"))
    seen = renderer.view(layout, masks=True)
    masks = seen.masks
    assert masks.shape == (len(seen.boxes), *SMALL[::-1])
    np.testing.assert_array_equal(masks.sum(axis=(1, 2)), seen.visible[seen.indices])
    for mask, (left, top, right, bottom) in zip(masks, seen.boxes.astype(int), strict=True):
        rows, columns = np.nonzero(mask)
        edges = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        assert edges == (left, top, right, bottom)
    with pytest.raises(InputError, match="masks=True"):
        renderer.view(layout).masks  # noqa: B018


@pytest.mark.parametrize("camera", ["left_eye", EXTERNAL])
def test_depth_and_camera_lead_back_to_the_surface_of_the_block(renderer, camera):
    """Every pixel of a mask, with its depth, is a point of the block that the mask shows."""
    layout = Layout((block("cube_red", 2, 5, 0), block("cube_blue", 5, 2, 0)))
    seen = renderer.view(layout, camera, masks=True, depth=True)
    for index, mask in zip(seen.indices, seen.masks, strict=True):
        rows, columns = np.nonzero(mask)
        pixels = np.stack([columns, rows, np.ones_like(rows)])
        rays = np.linalg.inv(seen.camera.matrix) @ pixels
        points = (rays * seen.depth[rows, columns]).T
        offsets = apply(invert(seen.camera.camera_from_robot), points)
        offsets -= renderer.robot.cell_position(layout.blocks[index].cell)
        beyond = np.abs(offsets) - BLOCK_HALF
        assert beyond.max() < 1e-3  # no point is outside ...
        assert np.abs(beyond.max(axis=1)).max() < 1e-3  # ... and none inside the block


def test_asking_for_more_does_not_change_the_picture(renderer):
    look = Appearance.sample(generator(4, "look"))
    plain = renderer.view(EVERY_KIND, appearance=look, labels=False)
    full = renderer.view(EVERY_KIND, appearance=look, masks=True, depth=True)
    np.testing.assert_array_equal(plain.image, full.image)
    assert plain.depth is None and plain.block_at is None


def test_pictures_do_not_depend_on_what_was_drawn_before(renderer):
    layout = EVERY_KIND
    look = Appearance.sample(generator(3, "look"))
    first = renderer.view(layout, appearance=look)
    renderer.view(random_layout(generator(1, "other")), EXTERNAL)
    renderer.view(Layout((block("cube_red", 3, 3, 4),), Gripper(Cell(3, 3, 4), closed=True)))
    again = renderer.view(layout, appearance=look)
    np.testing.assert_array_equal(first.image, again.image)
    np.testing.assert_array_equal(first.boxes, again.boxes)
    np.testing.assert_array_equal(
        first.image, renderer.view(layout, appearance=look, labels=False).image
    )


def test_the_look_follows_its_generator():
    one, same, other = (Appearance.sample(generator(s, "look")) for s in (1, 1, 2))
    for name, value in vars(one).items():
        np.testing.assert_array_equal(value, getattr(same, name))
    assert not np.array_equal(one.camera_rotation, other.camera_rotation)
    assert np.abs(one.camera_rotation).max() <= np.deg2rad(2.0)
    assert np.abs(one.camera_translation).max() <= 0.01


def test_a_held_block_is_seen_in_the_hand(renderer):
    held = block("prism_green", 5, 2, 5)
    away = renderer.view(Layout((held, block("cube_red", 2, 2, 0))), EXTERNAL)
    in_hand = renderer.view(
        Layout((held, block("cube_red", 2, 2, 0)), Gripper(held.cell, closed=True)), EXTERNAL
    )
    assert in_hand.visible[0] > 0
    changed = np.abs(in_hand.image.astype(int) - away.image).max(axis=2) > 30
    assert changed.mean() > 0.02  # the arm is elsewhere


def test_the_hand_that_waits_is_outside_both_eyes(renderer):
    for eye in ("left_eye", "right_eye"):
        image = renderer.view(Layout(()), eye, Appearance(shadows=False)).image
        table_and_floor = {tuple(c) for c in image.reshape(-1, 3)[::7]}
        assert len(table_and_floor) < 12  # floor, table, squares, table edge: flat colours only


@pytest.mark.parametrize("seed", [None, *range(6)])
def test_the_eight_colors_stay_apart_in_every_light(renderer, seed):
    look = Appearance(blur=0.0)
    if seed is not None:
        look = Appearance.sample(generator(seed, "colors"))
    layout = Layout(tuple(Block(c, Shape.CUBE, Cell(3, i, 0)) for i, c in enumerate(Color)))
    seen = renderer.view(layout, appearance=look)
    means = []
    for left, top, right, _ in seen.boxes.astype(int):
        # The upper middle of the box is the block's top face.
        patch = seen.image[top + 2 : top + 5, (left + right) // 2 - 2 : (left + right) // 2 + 2]
        means.append(patch.reshape(-1, 3).mean(axis=0))
    means = np.array(means)
    assert len(means) == len(Color)
    gaps = np.linalg.norm(means[:, None] - means[None], axis=2) + 1e3 * np.eye(len(means))
    assert gaps.min() > 35


def test_a_white_block_stands_out_from_a_white_square(renderer):
    cell = Cell(3, 4, 0)  # x + y odd: a light square
    layout = Layout((Block(Color.WHITE, Shape.CUBE, cell),))
    with_block = renderer.view(layout)
    without = renderer.view(Layout(()))
    left, top, right, bottom = with_block.boxes[0].astype(int)
    inside = np.s_[top:bottom, left:right]
    difference = np.abs(with_block.image[inside].astype(int) - without.image[inside]).max(axis=2)
    assert np.mean(difference > 20) > 0.6


def test_no_shape_of_the_sixteen_is_missing(renderer):
    layout = Layout(
        tuple(
            Block(color, shape, Cell(i, 2 + 3 * j, 0))
            for j, shape in enumerate(Shape)
            for i, color in enumerate(Color)
        )
    )
    seen = renderer.view(layout)
    assert {CLASS_NAMES[c] for c in seen.classes} == set(CLASS_NAMES)


def test_the_picture_is_the_golden_one(renderer, request):
    layout = Layout(
        (
            block("cube_red", 6, 5, 0),
            block("prism_green", 6, 5, 1),
            block("cube_white", 2, 3, 0),
            block("prism_yellow", 1, 6, 0),
            block("cube_cyan", 3, 0, 0),
            block("cube_cyan", 3, 0, 1),
            block("cube_gray", 0, 0, 0),
        )
    )
    image = renderer.view(layout).image
    if request.config.getoption("--update-golden"):
        GOLDEN.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(GOLDEN), image[..., ::-1])
    golden = cv2.imread(str(GOLDEN))[..., ::-1].astype(int)
    difference = np.abs(image - golden).max(axis=2)
    assert difference.mean() < 1.5  # renderers round edges differently
    assert np.mean(difference > 30) < 0.01


def test_an_unknown_camera_is_refused_with_a_hint(renderer):
    with pytest.raises(UnknownNameError, match="left_eye, right_eye, external.*mean 'left_eye'"):
        renderer.view(Layout(()), camera="left_eey")


def test_a_camera_is_known_before_the_first_picture():
    renderer = SceneRenderer(size=(64, 36))
    before = renderer.camera("left_eye").camera_from_robot
    after = renderer.view(Layout(())).camera.camera_from_robot
    renderer.close()
    np.testing.assert_array_equal(before, after)


def test_a_world_draws_the_very_robot_that_it_simulates(renderer):
    nico = robots.load("nico")
    other = replace(nico, head_angles={name: 0.0 for name in nico.head_angles})
    seen = [World(robot, Layout(())).image("left_eye", [64, 36]) for robot in (nico, other)]
    assert not np.array_equal(*seen)


def test_a_picture_from_another_thread_is_refused_in_one_line(renderer):
    def take():
        with pytest.raises(RenderingError, match="it serves the thread that made it alone") as told:
            renderer.view(Layout(()))
        return str(told.value)

    renderer.view(Layout(()))
    with ThreadPoolExecutor(1) as pool:
        assert "\n" not in pool.submit(take).result()


@pytest.mark.parametrize("size", [(0, 3), (-5, 5), (20000, 3), (64.5, 36), (64,), (np.nan, 3)])
def test_a_size_that_no_picture_can_have_is_refused(size):
    with pytest.raises(InputError, match="cannot have the size.*1 to 16384 pixels"):
        SceneRenderer(size=size)


def test_a_broken_backend_is_one_line_with_a_remedy(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setitem(sys.modules, "mujoco.osmesa", None)
    with pytest.raises(RenderingError, match="'osmesa' failed.*libegl1") as caught:
        SceneRenderer(size=(64, 36))
    assert "\n" not in str(caught.value)


def test_rendering_switched_off_is_said_so(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(RenderingError, match="switched off by MUJOCO_GL"):
        SceneRenderer(size=(64, 36))


def test_an_episode_needs_no_graphics():
    code = """
from fusionnet.blocks import Block, Cell, Color, Layout, Move, Shape
from fusionnet.errors import RenderingError
from fusionnet.simulation import joint_targets, make_world
world = make_world(layout=Layout((Block(Color.RED, Shape.CUBE, Cell(2, 2, 0)),)))
episode = world.execute(joint_targets("nico", Move(Cell(2, 2, 0), Cell(5, 5, 0))))
assert episode.layout_after.at(Cell(5, 5, 0)), episode.reason
try:
    world.image()
except RenderingError:
    print("no picture")
"""
    environment = {**os.environ, "MUJOCO_GL": "disabled"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "no picture", done.stderr


def test_a_renderer_that_is_dropped_spoils_no_other(size=(160, 90)):
    first, second = (SceneRenderer("nico", size) for _ in range(2))
    layout = random_layout(np.random.default_rng(0))
    before = second.view(layout)
    first.view(layout)
    del first
    gc.collect()
    after = second.view(layout)
    np.testing.assert_array_equal(after.image, before.image)
    np.testing.assert_array_equal(after.visible, before.visible)


def test_pytorch_can_be_imported_after_a_picture():
    # Triton and Mesa both bring LLVM; in the wrong order the process ends without a word.
    lines = (
        "from fusionnet.simulation import SceneRenderer",
        "from fusionnet.blocks import Layout",
        "SceneRenderer('nico', size=(64, 36)).view(Layout(()))",
        "import torchvision",
    )
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-500:]
