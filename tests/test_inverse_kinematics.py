"""Inverse kinematics: whatever forward kinematics reaches can be found again, within limits."""

import numpy as np
import pytest

from fusionnet import robots
from fusionnet.blocks import BLOCK_SIZE
from fusionnet.errors import InputError, UnreachableError
from fusionnet.randomness import generator
from fusionnet.simulation.inverse_kinematics import InverseKinematics


@pytest.fixture(scope="module", params=robots.names())
def robot(request) -> robots.Robot:
    return robots.load(request.param)


@pytest.fixture(scope="module")
def inverse(robot) -> InverseKinematics:
    return InverseKinematics(robot)


@pytest.fixture(scope="module")
def forward(robot) -> robots.ArmKinematics:
    return robots.ArmKinematics(robot)


def within(robot: robots.Robot, joints: np.ndarray) -> bool:
    return bool(np.all(joints >= robot.joint_limits[:, 0] - 1e-9)) and bool(
        np.all(joints <= robot.joint_limits[:, 1] + 1e-9)
    )


def test_the_pinch_arrives_where_it_was_sent(robot, inverse, forward):
    rng = generator(0, "targets over the board")
    for _ in range(30):
        cell = rng.integers(0, 8, 3)
        target = robot.pinch_position(cell) + rng.uniform(-0.01, 0.01, 3)
        joints = inverse.solve(target)
        assert within(robot, joints)
        np.testing.assert_allclose(forward.robot_from_pinch(joints)[:3, 3], target, atol=1e-4)


def test_the_answer_stays_near_a_good_start(robot, inverse):
    for cell in ((0, 0, 0), (4, 3, 2), (7, 7, 7)):
        start = robot.joint_angles(cell)
        target = robot.pinch_position(cell) + [0.002, -0.002, 0.002]
        assert np.abs(inverse.solve(target, start=start) - start).max() < np.radians(5)


def test_8_cm_above_every_cell_can_be_reached_for_the_approach(robot, inverse, forward):
    rng = generator(0, "cells to hover above")
    corners = [(x, y, z) for x in (0, 7) for y in (0, 7) for z in (0, 7)]
    for cell in [*corners, *rng.integers(0, 8, (30, 3))]:
        target = robot.pinch_position(cell) + [0, 0, 0.08]
        joints = inverse.solve(
            target, maximum_tilt=np.radians(40), start=robot.joint_angles(tuple(cell))
        )
        assert within(robot, joints)
        np.testing.assert_allclose(forward.robot_from_pinch(joints)[:3, 3], target, atol=1e-4)
        assert np.degrees(forward.tilt(joints)) <= 40.2


def test_the_same_question_has_the_same_answer(robot, inverse):
    target = robot.pinch_position((3, 3, 3)) + [0.004, 0.004, 0.004]
    first = inverse.solve(target)
    inverse.solve(robot.pinch_position((7, 0, 7)))
    np.testing.assert_array_equal(inverse.solve(target), first)
    np.testing.assert_array_equal(InverseKinematics(robot).solve(target), first)


def test_a_place_out_of_reach_is_a_typed_failure(robot, inverse):
    with pytest.raises(UnreachableError, match="16 attempts") as failure:
        inverse.solve(np.array([3.0, 0.0, 0.6]))
    assert failure.value.attempts == 16
    assert 1.0 < failure.value.residual < 3.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": np.array([0.3, np.nan, 0.6])}, "not finite"),
        ({"rotation": 2 * np.eye(3)}, "not a rotation matrix"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, "not a rotation matrix"),
        ({"rotation": np.eye(3), "maximum_tilt": 0.1}, "not both"),
    ],
)
def test_impossible_questions_are_refused(inverse, arguments, message):
    with pytest.raises(InputError, match=message):
        inverse.solve(**{"position": np.array([0.3, 0.0, 0.6]), **arguments})


class TestOrientation:
    """NICO's arm has joints to spare for the hand's orientation."""

    nico = robots.load("nico")
    inverse = InverseKinematics(nico)
    forward = robots.ArmKinematics(nico)

    def test_most_poses_of_the_arm_are_found_again(self):
        rng = generator(0, "poses of the arm")
        found = 0
        for _ in range(25):
            pose = self.forward.robot_from_pinch(rng.uniform(*self.nico.joint_limits.T))
            try:
                joints = self.inverse.solve(pose[:3, 3], rotation=pose[:3, :3])
            except UnreachableError:
                continue
            found += 1
            assert within(self.nico, joints)
            np.testing.assert_allclose(self.forward.robot_from_pinch(joints), pose, atol=3e-3)
        assert found >= 20

    def test_a_tilted_hand_is_brought_upright(self):
        target = self.nico.pinch_position((0, 3, 2))
        start = self.nico.joint_angles((0, 3, 2))
        free = self.inverse.solve(target, start=start)
        assert np.degrees(self.forward.tilt(free)) > 15
        upright = self.inverse.solve(target, start=start, maximum_tilt=np.radians(12))
        assert np.degrees(self.forward.tilt(upright)) <= 12.2
        reached = self.forward.robot_from_pinch(upright)[:3, 3]
        np.testing.assert_allclose(reached, target, atol=1e-4)

    def test_an_orientation_out_of_reach_says_so(self):
        target = self.nico.pinch_position((7, 7, 7))
        upwards = np.eye(3)
        with pytest.raises(UnreachableError, match="with the asked orientation.*degrees too far"):
            self.inverse.solve(target, rotation=upwards)


def test_without_a_step_the_start_is_measured(robot):
    still = InverseKinematics(robot, iterations=0, attempts=1)
    start = robot.joint_angles((3, 3, 0))
    np.testing.assert_array_equal(still.solve(robot.pinch_position((3, 3, 0)), start=start), start)
    with pytest.raises(UnreachableError) as missed:
        still.solve(robot.pinch_position((3, 3, 1)), start=start)
    assert missed.value.residual > BLOCK_SIZE - 2e-4
