"""Looking again: where a displaced block is, and what the arm makes of it."""

from dataclasses import replace

import numpy as np
import pytest

from fusionnet import load_policy, make_world
from fusionnet.blocks import BLOCK_SIZE, Block, Cell, Color, Layout, Move, Shape, apply
from fusionnet.errors import InputError
from fusionnet.evaluation.policy import PolicyEvaluation, evaluate
from fusionnet.policy import Servo, block_shift, with_boxed_blocks
from fusionnet.simulation import joint_targets

RED = Block(Color.RED, Shape.CUBE, Cell(3, 3, 0))
BLUE = Block(Color.BLUE, Shape.CUBE, Cell(5, 5, 0))
LAYOUT = Layout((RED, BLUE))
SENTENCE = "put the red cube on the blue cube"


@pytest.mark.parametrize("shift", [(0.008, 0.0), (0.0, -0.009), (-0.006, 0.006)])
def test_a_displaced_block_is_found_to_a_few_millimetres(shift):
    world = make_world(layout=LAYOUT, shifts=np.array([shift, (0.0, 0.0)]))
    sight = load_policy("compact").detector.see(world.image("left_eye"))
    middle = (np.array(RED.cell) + 0.5) * BLOCK_SIZE
    found = block_shift(sight, RED.class_index, middle)
    assert found is not None
    assert np.linalg.norm(found - [*shift, 0.0]) < 0.004
    mistaken = Block(Color.CYAN, Shape.CUBE, RED.cell).class_index
    assert np.array_equal(block_shift(sight, mistaken, middle), found)
    other = Block(Color.RED, Shape.PRISM, RED.cell).class_index
    assert block_shift(sight, other, middle) is None
    assert block_shift(sight, RED.class_index, middle + [0.06, 0.0, 0.0]) is None


def test_what_is_known_of_a_carried_block_tells_higher_from_farther():
    world = make_world(layout=LAYOUT)
    sight = load_policy("compact").detector.see(world.image("left_eye"))
    middle = (np.array(RED.cell) + 0.5) * BLOCK_SIZE
    lower = middle - [0.0, 0.0, 0.008]  # it stands 8 mm higher than this
    upwards = block_shift(sight, RED.class_index, lower, np.diag([0.001, 0.006, 0.02]) ** 2)
    away = block_shift(sight, RED.class_index, lower, np.diag([0.02, 0.006, 0.001]) ** 2)
    assert np.linalg.norm(upwards - [0.0, 0.0, 0.008]) < 0.003
    assert away[0] > 0.004 and abs(away[2]) < 0.002


def test_the_arm_goes_where_the_second_look_says():
    move = Move(RED.cell, Cell(6, 2, 0), begins_held=False, ends_held=False)
    targets, expected = joint_targets("nico", move), apply(move, LAYOUT)
    shifts = np.array([(0.0095, 0.0095), (0.0, 0.0)])
    assert not make_world(layout=LAYOUT, shifts=shifts).execute(targets, expected=expected).success
    asked = []

    def told(phase, rise, world):
        asked.append((phase, rise))
        shift = np.array([*shifts[0], 0.0]) if phase == "grasp" else np.zeros(3)
        return world.robot.robot_from_board[:3, :3] @ shift

    world = make_world(layout=LAYOUT, shifts=shifts)
    episode = world.execute(targets, expected=expected, look_again=told)
    assert episode.success, episode.reason
    assert [phase for phase, _ in asked] == ["grasp", "place"]
    assert asked[1][1] == pytest.approx(0.03, abs=0.003)
    assert "look" in [phase.name for phase in episode.phases]


def test_a_policy_that_looks_again_grasps_a_block_out_of_its_cell():
    shifts = np.array([(0.0095, 0.0095), (0.0, 0.0)])
    policy = load_policy("compact", displaced=True)
    world = make_world(layout=LAYOUT, shifts=shifts)
    answer = policy(world.image("left_eye"), SENTENCE)
    expected = apply(answer.move, LAYOUT)
    episode = world.execute(answer, expected=expected, look_again=Servo(policy, answer))
    assert episode.success, episode.reason


def test_an_evaluation_displaces_and_disturbs_alike_with_and_without_the_loop():
    reports = [
        evaluate(
            PolicyEvaluation(
                corpus="examples", episodes=2, displaced=5.0, joint_noise=0.3, closed_loop=loop
            )
        )
        for loop in (False, True)
    ]
    assert [r.command for r in reports[0].records] == [r.command for r in reports[1].records]
    numbers = reports[1].as_json()
    assert numbers["closed_loop"] and numbers["displaced_mm"] == 5.0
    with pytest.raises(InputError, match="shape"):
        make_world(layout=LAYOUT, shifts=np.zeros((1, 2)))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.005, -0.005), (-0.007, 0.007), (0.0, 0.01)])
def test_a_block_beside_its_cell_belongs_to_it(shift):
    policy = load_policy("compact", displaced=True)
    answer = policy(
        make_world(layout=LAYOUT, shifts=np.array([shift, (0.0, 0.0)])).image("left_eye"), SENTENCE
    )
    assert answer.layout == LAYOUT
    assert answer.move.source == RED.cell


def test_a_box_that_no_free_cell_explains_adds_no_block():
    sight = load_policy("compact").detector.see(make_world(layout=LAYOUT).image("left_eye"))
    assert np.array_equal(with_boxed_blocks(sight).cells, sight.cells)
    elsewhere = replace(sight.detected, xyxy=sight.detected.xyxy * 0.05)
    moved = with_boxed_blocks(replace(sight, detected=elsewhere))
    assert np.array_equal(moved.cells, sight.cells)
