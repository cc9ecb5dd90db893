"""NICO at its table: nothing collides, both eyes see the whole grid, and the hand holds a block."""

from itertools import product

import mujoco
import numpy as np
import pytest

from fusionnet import robots
from fusionnet.blocks.grid import BLOCK_SIZE, GRID
from fusionnet.robots import CollisionBit
from fusionnet.simulation.inverse_kinematics import InverseKinematics

WIDTH, HEIGHT = 960, 540
ROBOT = robots.load("nico")
CELLS = list(product(range(GRID), repeat=3))


@pytest.fixture(scope="module")
def at_the_table() -> mujoco.MjModel:
    """NICO with its table, which collides with everything that moves."""
    spec, top = ROBOT.spec(), ROBOT.table_top
    half = [(top.x[1] - top.x[0]) / 2, (top.y[1] - top.y[0]) / 2, 0.0125]
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        pos=[sum(top.x) / 2, sum(top.y) / 2, top.height - half[2]],
        contype=CollisionBit.WORLD,
        conaffinity=CollisionBit.ARM | CollisionBit.HAND,
    )
    return spec.compile()


def take(model: mujoco.MjModel, data: mujoco.MjData, joints: np.ndarray, closed: float) -> None:
    """Put the robot into a posture."""
    for name, value in zip(ROBOT.joint_names, joints, strict=True):
        data.joint(name).qpos = value
    for name, (opened, shut) in ROBOT.finger_positions.items():
        data.joint(name).qpos = opened + closed * (shut - opened)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[frozenset[str]]:
    """The bodies that touch."""
    mujoco.mj_collision(model, data)
    return {
        frozenset(model.body(model.geom_bodyid[geom]).name for geom in contact.geom)
        for contact in data.contact
        if contact.dist < 0
    }


def test_no_posture_of_the_table_touches_robot_or_table(at_the_table):
    data = mujoco.MjData(at_the_table)
    for cell, closed in product(CELLS, (0.0, 0.5, 1.0)):
        take(at_the_table, data, ROBOT.joint_angles(cell), closed)
        assert touching(at_the_table, data) == set(), cell


def test_the_way_to_the_board_touches_nothing(at_the_table):
    data = mujoco.MjData(at_the_table)
    inverse = InverseKinematics(ROBOT)
    for cell in product((0, 4, 7), (0, 4, 7), (0, 7)):
        target, at_cell = ROBOT.pinch_position(cell), ROBOT.joint_angles(cell)
        above = inverse.solve(target + [0, 0, 0.08], maximum_tilt=np.radians(40), start=at_cell)
        stations = [ROBOT.poses["prepare"], ROBOT.poses["ready"], above, at_cell]
        for start, end in zip(stations[:-1], stations[1:], strict=True):
            for part in np.linspace(0, 1, 12):
                take(at_the_table, data, start + part * (end - start), 0.0)
                assert touching(at_the_table, data) == set(), cell


def test_ready_hovers_over_the_board_above_the_highest_block():
    pinch = robots.ArmKinematics(ROBOT).robot_from_pinch(ROBOT.poses["ready"])[:3, 3]
    lowest, highest = ROBOT.cell_position((2, 2, 7)), ROBOT.cell_position((5, 5, 7))
    assert np.all(lowest[:2] < pinch[:2]) and np.all(pinch[:2] < highest[:2])
    carried = BLOCK_SIZE + ROBOT.pinch_clearance
    assert pinch[2] - carried > highest[2] + BLOCK_SIZE / 2 + 0.01


def test_a_hand_pushed_into_the_table_or_the_chest_does_touch(at_the_table):
    data = mujoco.MjData(at_the_table)
    inverse = InverseKinematics(ROBOT)
    low = inverse.solve(
        ROBOT.pinch_position((4, 4, 0)) - [0, 0, 0.03], start=ROBOT.joint_angles((4, 4, 0))
    )
    take(at_the_table, data, low, 0.0)
    assert frozenset({"world", "left_index_3"}) in touching(at_the_table, data)
    across = np.radians([20.0, -80.0, -100.0, -100.0, 60.0, 0.0])
    take(at_the_table, data, across, 0.0)
    assert frozenset({"torso", "left_palm"}) in touching(at_the_table, data)


def test_collision_bits_are_declared_ones():
    model = ROBOT.spec().compile()
    names = {
        bit: {
            model.body(model.geom_bodyid[geom]).name.removesuffix("_1").removesuffix("_3")
            for geom in range(model.ngeom)
            if model.geom_contype[geom] == bit
        }
        for bit in (CollisionBit.ARM, CollisionBit.HAND, CollisionBit.TRUNK)
    }
    assert names[CollisionBit.ARM] == {"left_upper_arm", "left_lower_arm", "left_wrist"}
    assert {"left_palm", "left_thumb", "left_index", "left_ring"} <= names[CollisionBit.HAND]
    assert {"torso", "head", "right_lower_arm"} <= names[CollisionBit.TRUNK]
    assert set(model.geom_contype) <= {0, *names}


@pytest.mark.parametrize("eye", ["left_eye", "right_eye"])
class TestEyes:
    """At the prepare pose."""

    def test_every_corner_of_every_cell_is_in_the_picture(self, at_the_table, eye):
        data = mujoco.MjData(at_the_table)
        take(at_the_table, data, ROBOT.poses["prepare"], 0.0)
        camera = data.camera(eye)
        corners = np.array(
            [
                ROBOT.cell_position(cell) + np.array(side) * BLOCK_SIZE / 2
                for cell, side in product(CELLS, product((-1, 1), repeat=3))
            ]
        )
        seen = (corners - camera.xpos) @ camera.xmat.reshape(3, 3)
        focal = HEIGHT / 2 / np.tan(np.radians(at_the_table.camera(eye).fovy[0]) / 2)
        assert seen[:, 2].max() < 0
        columns = WIDTH / 2 - focal * seen[:, 0] / seen[:, 2]
        rows = HEIGHT / 2 + focal * seen[:, 1] / seen[:, 2]
        assert columns.min() > 10 and columns.max() < WIDTH - 10
        assert rows.min() > 10 and rows.max() < HEIGHT - 10

    def test_nothing_of_the_robot_stands_between_the_eye_and_the_grid(self, at_the_table, eye):
        data = mujoco.MjData(at_the_table)
        take(at_the_table, data, ROBOT.poses["prepare"], 0.0)
        mujoco.mj_forward(at_the_table, data)
        origin = data.camera(eye).xpos
        hit = np.zeros(1, np.int32)
        for cell in CELLS:
            ray = ROBOT.cell_position(cell) - origin
            length = np.linalg.norm(ray)
            distance = mujoco.mj_ray(
                at_the_table, data, origin, ray / length, None, True, -1, hit, None
            )
            assert distance < 0 or distance > length, cell


def test_closed_fingertips_lie_against_a_block_and_open_ones_leave_it():
    spec = ROBOT.spec()
    palm = spec.body("left_palm")
    site = spec.site("pinch")
    block = palm.add_geom(name="block", type=mujoco.mjtGeom.mjGEOM_BOX, size=[BLOCK_SIZE / 2] * 3)
    model = spec.compile()
    below = np.array([0.0, 0.0, BLOCK_SIZE / 2 + ROBOT.pinch_clearance])
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.site("pinch").quat)
    block.pos = site.pos + rotation.reshape(3, 3) @ below
    block.quat = model.site("pinch").quat
    model = spec.compile()
    data = mujoco.MjData(model)

    def gaps(closed: float) -> dict[str, float]:
        take(model, data, ROBOT.poses["ready"], closed)
        held = model.geom("block").id
        found = {}
        for finger in ("thumb", "index", "ring"):
            first = model.body(f"left_{finger}_3").geomadr[0]
            found[finger] = mujoco.mj_geomDistance(model, data, first, held, 1.0, None)
        return found

    assert all(abs(gap) < 0.002 for gap in gaps(1.0).values())
    assert all(gap > 0.01 for gap in gaps(0.0).values())


def test_the_head_can_be_turned_elsewhere():
    straight = ROBOT.spec({"head_y": 0.0, "head_z": 0.0}).compile()
    data = mujoco.MjData(straight)
    mujoco.mj_kinematics(straight, data)
    mujoco.mj_camlight(straight, data)
    view = -data.camera("left_eye").xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(view, [1, 0, 0], atol=1e-6)
