"""NICO's body: what its parts touch, how its hand holds a block, where its head looks."""

import itertools

import mujoco
import numpy as np

from fusionnet import robots
from fusionnet.blocks.grid import BLOCK_SIZE
from fusionnet.robots import CollisionBit
from fusionnet.simulation.inverse_kinematics import InverseKinematics
from robot_at_table import AtTheTable

ROBOT = robots.load("nico")


def test_a_hand_pushed_into_the_table_or_the_chest_does_touch():
    scene = AtTheTable(ROBOT)
    inverse = InverseKinematics(ROBOT)
    low = inverse.solve(
        ROBOT.pinch_position((4, 4, 0)) - [0, 0, 0.03], start=ROBOT.joint_angles((4, 4, 0))
    )
    scene.take(low)
    assert frozenset({"world", "left_index_3"}) in scene.touching()
    across = np.radians([20.0, -80.0, -100.0, -100.0, 60.0, 0.0])
    scene.take(across)
    assert frozenset({"torso", "left_palm"}) in scene.touching()


def test_the_hand_cannot_reach_its_own_arm():
    """So its contacts with the upper arm and the forearm need not be simulated."""
    scene = AtTheTable(ROBOT)
    model, data = scene.model, scene.data
    owner = [model.body(body).name for body in model.geom_bodyid]
    solid = [geom for geom in range(model.ngeom) if model.geom_contype[geom]]
    arm = [geom for geom in solid if owner[geom] in ("left_upper_arm", "left_lower_arm")]
    hand = [
        geom
        for geom in solid
        if owner[geom].startswith(("left_palm", "left_thumb", "left_index", "left_ring"))
    ]
    assert (len(arm), len(hand)) == (4, 12)
    elbow, turn, bend = ROBOT.joint_limits[3:]
    nearest = np.inf
    for angles in itertools.product(
        np.linspace(*elbow, 7), np.linspace(*turn, 5), np.linspace(*bend, 3)
    ):
        for closed in (0.0, 1.0):
            scene.take(np.array([0.0, 0.0, 0.0, *angles]), closed)
            gaps = [mujoco.mj_geomDistance(model, data, a, h, 0.3, None) for a in arm for h in hand]
            nearest = min(nearest, *gaps)
    assert nearest > 0.04  # metres; 0.05 on a finer grid


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


def test_closed_fingertips_lie_against_a_block_and_open_ones_leave_it():
    scene = AtTheTable(ROBOT)
    pinch = scene.data.site("pinch")
    below = np.array([0.0, 0.0, BLOCK_SIZE / 2 + ROBOT.pinch_clearance])
    block = np.full(3, BLOCK_SIZE / 2)

    def gaps(closed: float) -> list[float]:
        """Distance from each fingertip to a block that stands upright with the hand."""
        scene.take(ROBOT.poses["ready"], closed)
        pinch_from_robot = pinch.xmat.reshape(3, 3).T
        found = []
        for finger in ("thumb", "index", "ring"):
            tip = scene.model.body(f"left_{finger}_3").geomadr[0]
            radius, half_length, _ = scene.model.geom_size[tip]
            axis = scene.data.geom_xmat[tip].reshape(3, 3)[:, 2]
            along = np.linspace(-half_length, half_length, 30)[:, None]
            points = scene.data.geom_xpos[tip] + along * axis - pinch.xpos
            outside = np.maximum(np.abs(points @ pinch_from_robot.T - below) - block, 0.0)
            found.append(np.linalg.norm(outside, axis=1).min() - radius)
        return found

    assert np.abs(gaps(1.0)).max() < 0.002
    assert np.min(gaps(0.0)) > 0.01


def test_the_head_can_be_turned_elsewhere():
    straight = ROBOT.spec({"head_y": 0.0, "head_z": 0.0}).compile()
    data = mujoco.MjData(straight)
    mujoco.mj_kinematics(straight, data)
    mujoco.mj_camlight(straight, data)
    view = -data.camera("left_eye").xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(view, [1, 0, 0], atol=1e-6)
