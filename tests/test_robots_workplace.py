"""Every robot at its table: nothing collides, both eyes see the whole grid."""

from itertools import product

import mujoco
import numpy as np
import pytest

from fusionnet import robots
from fusionnet.blocks.grid import BLOCK_SIZE, GRID
from fusionnet.simulation.inverse_kinematics import InverseKinematics
from robot_at_table import AtTheTable

WIDTH, HEIGHT = 960, 540
CELLS = list(product(range(GRID), repeat=3))


@pytest.fixture(scope="module", params=robots.names())
def robot(request) -> robots.Robot:
    return robots.load(request.param)


@pytest.fixture(scope="module")
def scene(robot) -> AtTheTable:
    return AtTheTable(robot)


def test_no_posture_of_the_table_touches_robot_or_table(robot, scene):
    for cell, closed in product(CELLS, (0.0, 0.5, 1.0)):
        scene.take(robot.joint_angles(cell), closed)
        assert scene.touching() == set(), cell


def test_the_way_to_the_board_touches_nothing(robot, scene):
    inverse = InverseKinematics(robot)
    for cell in product((0, 4, 7), (0, 4, 7), (0, 7)):
        target, at_cell = robot.pinch_position(cell), robot.joint_angles(cell)
        above = inverse.solve(target + [0, 0, 0.08], maximum_tilt=np.radians(40), start=at_cell)
        stations = [robot.poses["prepare"], robot.poses["ready"], above, at_cell]
        for start, end in zip(stations[:-1], stations[1:], strict=True):
            for part in np.linspace(0, 1, 12):
                scene.take(start + part * (end - start))
                assert scene.touching() == set(), cell


def test_ready_hovers_over_the_board_above_the_highest_block(robot):
    pinch = robots.ArmKinematics(robot).robot_from_pinch(robot.poses["ready"])[:3, 3]
    lowest, highest = robot.cell_position((2, 2, 7)), robot.cell_position((5, 5, 7))
    assert np.all(lowest[:2] < pinch[:2]) and np.all(pinch[:2] < highest[:2]), (
        f"`ready` has the pinch at {pinch[:2]}; bring it between {lowest[:2]} and {highest[:2]}"
    )
    carried = BLOCK_SIZE + robot.pinch_clearance
    needed = highest[2] + BLOCK_SIZE / 2 + 0.01 + carried
    assert pinch[2] > needed, (
        f"`ready` has the pinch {pinch[2]:.3f} m high; raise it to {needed:.3f}"
    )


@pytest.mark.parametrize("eye", ["left_eye", "right_eye"])
class TestEyes:
    """At the prepare pose."""

    def test_every_corner_of_every_cell_is_in_the_picture(self, robot, scene, eye):
        scene.take(robot.poses["prepare"])
        camera = scene.data.camera(eye)
        corners = np.array(
            [
                robot.cell_position(cell) + np.array(side) * BLOCK_SIZE / 2
                for cell, side in product(CELLS, product((-1, 1), repeat=3))
            ]
        )
        seen = (corners - camera.xpos) @ camera.xmat.reshape(3, 3)
        focal = HEIGHT / 2 / np.tan(np.radians(scene.model.camera(eye).fovy[0]) / 2)
        assert seen[:, 2].max() < 0
        columns = WIDTH / 2 - focal * seen[:, 0] / seen[:, 2]
        rows = HEIGHT / 2 + focal * seen[:, 1] / seen[:, 2]
        seen_at = (
            f"the grid fills columns {columns.min():.0f} to {columns.max():.0f} and rows"
            f" {rows.min():.0f} to {rows.max():.0f} of {WIDTH}x{HEIGHT}:"
            " turn the head, or widen fovy"
        )
        assert columns.min() > 10 and columns.max() < WIDTH - 10, seen_at
        assert rows.min() > 10 and rows.max() < HEIGHT - 10, seen_at

    def test_nothing_of_the_robot_stands_between_the_eye_and_the_grid(self, robot, scene, eye):
        scene.take(robot.poses["prepare"])
        mujoco.mj_forward(scene.model, scene.data)
        origin = scene.data.camera(eye).xpos
        hit = np.zeros(1, np.int32)
        for cell in CELLS:
            ray = robot.cell_position(cell) - origin
            length = np.linalg.norm(ray)
            distance = mujoco.mj_ray(
                scene.model, scene.data, origin, ray / length, None, True, -1, hit, None
            )
            assert distance < 0 or distance > length, cell
