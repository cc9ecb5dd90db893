"""Blocks drawn into photographs stand where the camera says, hide and shade what they should."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from fusionnet.blocks import Block, Cell, Color, Gripper, Layout, Shape, random_layout
from fusionnet.blocks.grid import BLOCK_SIZE
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera, PointBehindCameraError, invert, transform
from fusionnet.randomness import generator
from fusionnet.robots import load
from fusionnet.simulation import Appearance
from fusionnet.simulation.tabletop import drawn_corners
from fusionnet.views.lighting import PAPER, estimate_light
from fusionnet.views.noise import Look, level_one
from fusionnet.views.overlay import OverlayRenderer, displaced_poses
from fusionnet.views.shadows import light_directions, table_ratio
from fusionnet.views.view import EnvironmentalView
from real_views import real_view

SIZE = (480, 270)


@pytest.fixture(scope="module")
def renderer(pictures_here):
    made = OverlayRenderer(SIZE)
    yield made
    made.close()


def made_view(level: int = 150, **changes: object) -> EnvironmentalView:
    """An even grey table seen obliquely by a camera with oblong pixels and its centre well off."""
    eye, target = np.array([-0.30, 0.02, 0.52]), np.array([0.105, 0.105, 0.03])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.column_stack([right, np.cross(forward, right), forward])
    view = EnvironmentalView(
        name="made",
        environment="nowhere",
        part="train",
        image=np.full((SIZE[1], SIZE[0], 3), level, np.uint8),
        matrix=np.array([[420.0, 0.0, 265.0], [0.0, 380.0, 120.0], [0.0, 0.0, 1.0]]),
        camera_from_board=invert(transform(axes, eye)),
    )
    return replace(view, **changes)


def block(name: str, *cell: int) -> Block:
    shape, color = name.split("_")
    return Block(Color(color), Shape(shape), Cell(*cell))


def projected_boxes(view: EnvironmentalView, layout: Layout, look: Look) -> np.ndarray:
    corners = drawn_corners(layout.blocks, displaced_poses(layout.blocks, look))
    camera = PinholeCamera(*SIZE, view.matrix, view.camera_from_board)
    pixels = camera.project(corners.reshape(-1, 3)).reshape(len(corners), 8, 2) + 0.5
    return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)


@pytest.mark.parametrize("shape", list(Shape))
@pytest.mark.parametrize("noisy", [False, True])
def test_a_block_appears_where_the_camera_projects_its_corners(renderer, shape, noisy):
    view = made_view()
    look = level_one().sample(generator(1, "look")) if noisy else Look()
    for cell in (Cell(0, 0, 0), Cell(7, 7, 0), Cell(3, 4, 5), Cell(7, 0, 2)):
        layout = Layout((Block(Color.RED, shape, cell),))
        seen = renderer.view(layout, view, look)
        np.testing.assert_allclose(seen.boxes, projected_boxes(view, layout, look), atol=1.0)
        assert seen.shares[0] > 0.95


def test_a_layout_on_a_real_photograph_covers_the_board_s_own_squares(data_folder):
    """The cells' corners are the corners that the calibration found: blocks stand on squares."""
    view = real_view(data_folder / "checkerboard", "left03")
    overlay = OverlayRenderer((640, 480))
    try:
        layout = Layout((block("cube_red", 2, 3, 0), block("prism_blue", 5, 5, 0)))
        seen = overlay.view(layout, view, masks=True)
    finally:
        overlay.close()
    camera = PinholeCamera(640, 480, view.matrix, view.camera_from_board)
    middles = np.array([[*(np.array(b.cell[:2]) + 0.5) * BLOCK_SIZE, 0.0] for b in layout.blocks])
    columns, rows = np.rint(camera.project(middles)).astype(int).T
    assert list(seen.block_at[rows, columns]) == [0, 1]
    untouched = (seen.block_at < 0) & (seen.image.astype(int) - view.image > 0).any(axis=2)
    edge = np.zeros_like(untouched)
    for mask in seen.masks:
        grown = np.pad(mask, 1)
        for i in range(3):
            for j in range(3):
                edge |= grown[i : i + edge.shape[0], j : j + edge.shape[1]]
    assert not np.any(untouched & ~edge)  # brighter than before only where a block's edge is


def test_an_empty_layout_leaves_the_photograph_as_it_is(renderer):
    rng = generator(0, "photograph")
    view = made_view(image=rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8))
    seen = renderer.view(Layout(()), view, masks=True)
    np.testing.assert_array_equal(seen.image, view.image)
    assert seen.boxes.shape == (0, 4) and seen.masks.shape == (0, 270, 480)
    seen.image[:] = 0  # ... which stays as it is even so
    np.testing.assert_array_equal(renderer.view(Layout(()), view).image, view.image)


@pytest.mark.parametrize("seed", range(3))
def test_shadows_only_darken_the_photograph_and_do_so_beside_blocks(renderer, seed):
    view, layout = made_view(), random_layout(generator(seed, "shadows"))
    seen = renderer.view(layout, view, masks=True)
    plain = renderer.view(layout, view, light=Appearance(shadows=False), masks=True)
    np.testing.assert_array_equal(seen.block_at, plain.block_at)
    table = (seen.block_at < 0) & np.all(plain.image == 150, axis=2)
    darkened = 150 - seen.image[table].astype(int)
    assert darkened.min() == 0
    assert 25 < darkened.max() < 149
    assert np.mean(darkened > 3) > 0.005


def test_a_shadow_falls_where_the_rays_lead():
    """A cube under one lamp darkens the table on the far side by the lamp's share of the light."""
    nominal = Appearance()
    light = Appearance(fill=np.zeros(3), light_direction=np.array([1.0, 0.0, -1.0]))
    layout = Layout((block("cube_red", 3, 3, 0),))
    plan, board_from_plan = table_ratio(
        drawn_corners(layout.blocks, displaced_poses(layout.blocks)), light, 0.35
    )
    lamp = light.light.mean() * np.sqrt(0.5)
    without_lamp = nominal.ambient.mean() / (nominal.ambient.mean() + lamp)
    plan_from_board = np.linalg.inv(board_from_plan)

    def ratio(x: float, y: float) -> float:
        column, row, _ = np.rint(plan_from_board @ [x * BLOCK_SIZE, y * BLOCK_SIZE, 1.0]).astype(
            int
        )
        return plan[row, column] / 255.0

    assert 0.6 * without_lamp < ratio(4.4, 3.5) < without_lamp  # ... and of some of the sky
    assert ratio(2.6, 3.5) > without_lamp + 0.2
    assert ratio(5.3, 3.5) > 0.9


def test_sharp_shadows_are_where_rays_to_the_lamp_meet_a_block():
    """The plan of the table against casting every ray on its own, also for tilted blocks."""
    lamp_alone = Appearance(fill=np.zeros(3), ambient=np.zeros(3))
    layout = Layout(
        tuple(
            block(*b)
            for b in (
                ("cube_red", 2, 2, 0),
                ("cube_blue", 2, 2, 1),
                ("prism_red", 5, 3, 0),
                ("prism_blue", 4, 6, 2),
            )
        )
    )
    look = level_one().sample(generator(4, "tilted"))
    look = replace(look, shifts=np.abs(look.shifts))  # above the table
    corners = drawn_corners(layout.blocks, displaced_poses(layout.blocks, look))
    plan, board_from_plan = table_ratio(corners, lamp_alone, 0.35)
    rng = generator(0, "points")
    near_board = np.column_stack([rng.uniform(0.0, 0.26, (1500, 2)), np.ones(1500)])
    pixels = np.rint(near_board @ np.linalg.inv(board_from_plan).T)[:, :2].astype(int)
    points = np.column_stack([pixels, np.ones(len(pixels))]) @ board_from_plan.T
    points[:, 2] = 0.0
    lamp, _ = light_directions(lamp_alone)
    light = np.zeros(len(points))
    for ray, share in zip(lamp.rays, lamp.shares, strict=True):
        hit = np.zeros(len(points), bool)
        for body in corners:
            planes = ConvexHull(body, qhull_options="QJ").equations
            height, slope = points @ planes[:, :3].T + planes[:, 3], planes[:, :3] @ -ray
            times = -height / slope
            enters = np.where(slope < 0.0, times, 0.0).max(axis=1)
            leaves = np.where(slope > 0.0, times, np.inf).min(axis=1)
            hit |= enters < leaves
        light += share * ~hit
    differences = np.abs(plan[pixels[:, 1], pixels[:, 0]] / 255.0 - light)
    assert 0.03 < np.mean(light < 0.5) < 0.5
    assert np.mean(differences > 0.02) < 0.05  # the edges, which are smoothed
    assert np.mean(differences > 0.5) < 0.005


def test_light_on_the_table_is_shared_out_whole():
    lamp, surroundings = light_directions(Appearance())
    rays = np.concatenate([lamp.rays, surroundings.rays])
    assert np.all(rays[:, 2] < 0.0)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    assert lamp.shares.sum() + surroundings.shares.sum() == pytest.approx(1.0)


def test_what_is_nearer_hides_what_is_farther(renderer):
    view = made_view()
    behind = block("cube_red", 7, 3, 0)
    tower = tuple(block("cube_blue", 5, 3, z) for z in range(4))
    for blocks in ((behind, *tower), (*tower, behind)):
        layout = Layout(blocks)
        red = blocks.index(behind)
        seen = renderer.view(layout, view, masks=True)
        alone = renderer.view(Layout((behind,)), view)
        assert seen.visible[red] < 0.25 * alone.visible[0]
        assert seen.shares[red] == pytest.approx(
            seen.visible[red] / alone.visible[0] * alone.shares[0], abs=0.02
        )
        assert all(seen.mostly_hidden[seen.indices == red])
        assert not seen.mostly_hidden[seen.indices != red].any()
        mask = seen.block_at == red
        assert np.all(seen.image[mask][:, 0].astype(int) >= seen.image[mask][:, 2])


def test_a_block_throws_its_shadow_on_other_blocks(renderer):
    view = made_view()
    light = Appearance(light_direction=np.array([0.7, 0.0, -0.7]))
    low = block("cube_white", 4, 3, 0)
    tower = tuple(block("cube_red", 3, 3, z) for z in range(2))
    alone = renderer.view(Layout((low,)), view, light=light, masks=True)
    beside = renderer.view(Layout((low, *tower)), view, light=light, masks=True)
    both = (alone.block_at == 0) & (beside.block_at == 0)
    darkened = alone.image[both].astype(int) - beside.image[both] > 20
    assert darkened.mean() > 0.25
    assert np.all(beside.image[both][darkened] > 30)  # there is light from elsewhere


def test_boxes_and_pixels_are_those_of_the_masks(renderer):
    layout = random_layout(generator(5, "masks"))
    seen = renderer.view(layout, made_view(), masks=True)
    for mask, index, (left, top, right, bottom) in zip(
        seen.masks, seen.indices, seen.boxes.astype(int), strict=True
    ):
        rows, columns = np.nonzero(mask)
        assert seen.visible[index] == len(rows)
        edges = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        assert edges == (left, top, right, bottom)


def test_the_camera_speaks_of_the_robot_s_frame(renderer):
    view = made_view()
    seen = renderer.view(Layout((block("cube_red", 2, 6, 0),)), view)
    point = load("nico").cell_position(Cell(2, 6, 0))
    left, top, right, bottom = seen.boxes[0]
    column, row = seen.camera.project(point[None])[0] + 0.5
    assert left < column < right and top < row < bottom


def test_a_photograph_of_another_size_is_resized_with_its_camera(renderer):
    view = made_view()
    large = replace(
        view,
        image=np.full((540, 960, 3), 150, np.uint8),
        matrix=np.array([[840.0, 0.0, 530.5], [0.0, 760.0, 240.5], [0.0, 0.0, 1.0]]),
    )
    layout = random_layout(generator(2, "sizes"))
    one, other = renderer.view(layout, view), renderer.view(layout, large)
    np.testing.assert_allclose(one.boxes, other.boxes, atol=1e-9)
    assert np.abs(one.image.astype(int) - other.image).mean() < 0.5


def test_pictures_do_not_depend_on_what_was_drawn_before(renderer):
    view, look = made_view(), level_one().sample(generator(0, "again"))
    layout = random_layout(generator(7, "again"))
    first = renderer.view(layout, view, look)
    renderer.view(random_layout(generator(8, "other")), made_view(90))
    np.testing.assert_array_equal(first.image, renderer.view(layout, view, look).image)
    assert view.image.min() == view.image.max() == 150  # the photograph itself is untouched


def test_a_held_block_hangs_in_the_air(renderer):
    cell = Cell(3, 3, 4)
    held = Layout((block("cube_red", *cell),), Gripper(cell, closed=True))
    view = made_view()
    np.testing.assert_allclose(
        renderer.view(held, view).boxes, projected_boxes(view, held, Look()), atol=1.0
    )


def test_light_follows_the_pale_squares():
    dim, bright = estimate_light(made_view(60)), estimate_light(made_view(180))
    np.testing.assert_allclose(dim.ambient * 3.0, bright.ambient)
    rays = [(bright.light_direction, bright.light), (bright.fill_direction, bright.fill)]
    on_table = bright.ambient + sum(-d[2] / np.linalg.norm(d) * s for d, s in rays)
    np.testing.assert_allclose(PAPER * on_table, 180 / 255)


@pytest.mark.parametrize("angle", [0.3, 2.0, 4.4])
def test_the_lamp_stands_on_the_side_where_the_board_is_brighter(angle):
    view = made_view()
    towards = np.array([np.cos(angle), np.sin(angle)])
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    board_from_camera = invert(view.camera_from_board)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(view.matrix).T
    rays = rays @ board_from_camera[:3, :3].T
    ground = board_from_camera[:2, 3] - rays[..., :2] * board_from_camera[2, 3] / rays[..., 2:]
    level = 120 + 250 * ((ground - 4 * BLOCK_SIZE) @ towards)
    image = np.repeat(np.clip(level, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    light = estimate_light(replace(view, image=image))
    flat = -light.light_direction[:2] / np.linalg.norm(light.light_direction[:2])
    assert flat @ towards > np.cos(np.deg2rad(5.0))


def test_a_camera_among_the_blocks_is_refused_by_name(renderer):
    pose = invert(transform(np.diag([1.0, -1.0, -1.0]), (0.1, 0.1, 0.06)))
    view = made_view(camera_from_board=pose)
    layout = Layout(tuple(block("cube_red", 3, 3, z) for z in range(4)))
    with pytest.raises(PointBehindCameraError, match="'made'"):
        renderer.view(layout, view)


def test_a_look_for_too_few_blocks_is_refused(renderer):
    look = level_one().sample(generator(0, "few"), blocks=1)
    with pytest.raises(InputError, match="for 1 blocks"):
        renderer.view(
            Layout((block("cube_red", 1, 1, 0), block("cube_red", 2, 2, 0))), made_view(), look
        )
