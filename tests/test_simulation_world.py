"""Pick and place in physics: what should work works, and a miss looks like a miss."""

import json
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest

from fusionnet import robots
from fusionnet.blocks import Block, Cell, Color, Gripper, Layout, Move, Shape, apply, random_layout
from fusionnet.errors import InputError
from fusionnet.randomness import generator
from fusionnet.robots import ArmKinematics
from fusionnet.simulation import execution, joint_targets, make_world, physics
from fusionnet.simulation.motion import PathPlanner

NICO = robots.load("nico")
PLANNER = PathPlanner(ArmKinematics(NICO))


def block(name: str, *cell: int) -> Block:
    shape, color = name.split("_")
    return Block(Color(color), Shape(shape), Cell(*cell))


SCENE = Layout(
    (
        block("cube_red", 3, 3, 0),
        block("cube_blue", 3, 4, 0),
        block("cube_blue", 3, 4, 1),
        block("prism_green", 3, 5, 0),
        block("cube_white", 2, 3, 0),
        block("prism_yellow", 3, 3, 1),
    )
)
TOWER = Layout((*(block("cube_red", 3, 3, z) for z in range(4)), block("cube_blue", 1, 1, 0)))
FAR_CELL = Cell(6, 6, 0)
FAR = NICO.joint_angles(FAR_CELL)


def near(cell: Cell, *offset: float) -> np.ndarray:
    """Angles that bring the pinch beside the grasp point of a cell, by an offset in metres."""
    target = NICO.pinch_position(cell) + offset
    angles, missing = PLANNER.reach(target, NICO.joint_angles(cell))
    assert missing < 1e-4
    return angles


def targets(grasp: np.ndarray, place: np.ndarray = FAR, closed: tuple[int, int] = (0, 0)):
    return np.r_[grasp, closed[0], place, closed[1]]


def do(layout: Layout, move: Move, **options):
    world = make_world(layout=layout)
    return world.execute(joint_targets("nico", move), expected=apply(move, layout), **options)


def test_targets_are_the_tables_angles_and_the_gripper_before_and_after():
    take = joint_targets("nico", Move(Cell(1, 2, 0), Cell(1, 2, 5), ends_held=True))
    assert take.shape == (14,)
    np.testing.assert_array_equal(take[:6], NICO.joint_angles(Cell(1, 2, 0)))
    np.testing.assert_array_equal(take[7:13], NICO.joint_angles(Cell(1, 2, 5)))
    assert (take[6], take[13]) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("source", "target"),
    [
        (Cell(3, 3, 1), Cell(6, 1, 0)),  # a pyramid, from a cube to the table
        (Cell(3, 4, 1), Cell(2, 3, 1)),  # a cube, from a stack to a stack, among neighbours
        (Cell(3, 5, 0), Cell(3, 4, 2)),  # a pyramid onto two cubes
        (Cell(2, 3, 0), Cell(0, 7, 0)),  # a cube to a corner
    ],
)
def test_a_move_ends_as_expected_and_disturbs_nobody(source, target):
    episode = do(SCENE, Move(source, target))
    assert episode.success, episode.reason
    assert episode.grasped == SCENE.at(source)
    assert episode.layout_after.same_blocks(apply(Move(source, target), SCENE))
    assert episode.errors.max() < 1.0
    assert episode.displacement < 0.5
    assert episode.grasp_distance < 1.0
    assert not episode.stopped and not episode.touched
    assert 3.0 < episode.seconds < 12.0


def test_the_parts_of_an_episode_follow_each_other():
    episode = do(SCENE, Move(Cell(3, 3, 1), Cell(6, 1, 0)))
    names = [phase.name for phase in episode.phases]
    assert names == "ready reach grasp lift move place release retreat rest".split()
    ends = [phase.end for phase in episode.phases]
    np.testing.assert_allclose([phase.start for phase in episode.phases], [0.0, *ends[:-1]])


def test_a_take_ends_with_the_block_in_the_air_and_a_drop_begins_so():
    take = Move(Cell(3, 3, 1), Cell(5, 5, 4), ends_held=True)
    world = make_world(layout=SCENE)
    episode = world.execute(joint_targets("nico", take), expected=apply(take, SCENE))
    assert episode.success, episode.reason
    assert world.layout.held == block("prism_yellow", 5, 5, 4)

    drop = Move(Cell(5, 5, 4), Cell(6, 5, 0), begins_held=True)
    after = apply(drop, world.layout)
    episode = world.execute(joint_targets("nico", drop), expected=after)
    assert episode.success, episode.reason
    assert world.layout.held is None


def test_a_world_may_begin_with_a_held_block():
    held = block("cube_cyan", 4, 2, 5)
    layout = Layout((*SCENE.blocks, held), Gripper(held.cell, closed=True))
    world = make_world(layout=layout)
    assert world.layout.held == held
    move = Move(held.cell, Cell(4, 2, 0), begins_held=True)
    episode = world.execute(joint_targets("nico", move), expected=apply(move, layout))
    assert episode.success, episode.reason
    assert "ready" not in [phase.name for phase in episode.phases]


def test_a_pinch_outside_the_gate_holds_nothing():
    world = make_world(layout=SCENE)
    episode = world.execute(targets(near(Cell(2, 3, 0), -0.016, 0.0, 0.0)), expected=SCENE)
    assert episode.grasped is None
    assert episode.success  # nothing was to change, and nothing did
    episode = world.execute(
        targets(near(Cell(2, 3, 0), -0.016, 0.0, 0.0)),
        expected=apply(Move(Cell(2, 3, 0), Cell(6, 6, 0)), SCENE),
    )
    assert episode.success is False
    assert "held nothing" in episode.reason
    assert 15.0 < episode.grasp_distance < 17.0


def test_an_empty_hand_closed_beside_a_block_holds_nothing():
    world = make_world("gantry", layout=Layout((block("cube_red", 3, 3, 0),)))
    beside = world.robot.joint_angles(Cell(3, 3, 0)) + [0.0115, 0.0, 0.007]
    world.drive(beside, False, 1.0)
    world.drive(beside, True, 0.5)
    assert world.hand_closed
    assert world.layout.held is None


@pytest.mark.parametrize(("offset", "holds"), [(0.011, True), (0.0145, False)])
def test_the_gate_is_thirteen_millimetres_wide(offset, holds):
    world = make_world(layout=Layout((block("cube_red", 3, 3, 0),)))
    episode = world.execute(targets(near(Cell(3, 3, 0), 0.0, offset, 0.0)))
    assert (episode.grasped is not None) == holds
    assert episode.success is None


def test_the_arm_does_not_go_through_the_table():
    low, missing = PLANNER.reach(
        NICO.pinch_position(Cell(6, 6, 0)) - [0.0, 0.0, 0.06], NICO.joint_angles(Cell(6, 6, 0))
    )
    assert missing < 1e-3  # a posture within limits, but its hand would be in the table top
    world = make_world(layout=SCENE)
    episode = world.execute(targets(low), expected=apply(Move(Cell(2, 3, 0), FAR_CELL), SCENE))
    assert episode.touched == ("the table",)
    assert "touched the table" in episode.reason


def test_the_arm_does_not_go_through_the_body():
    across = np.radians([20.0, -80.0, -100.0, -99.0, 60.0, 0.0])  # the palm in the chest
    world = make_world(layout=SCENE)
    episode = world.execute(targets(across), expected=apply(Move(Cell(2, 3, 0), FAR_CELL), SCENE))
    assert "its own body" in episode.touched
    assert episode.success is False
    assert "own body" in episode.reason


def test_a_block_held_off_centre_is_put_down_off_centre():
    world = make_world(layout=Layout((block("cube_red", 3, 3, 0),)))
    move = Move(Cell(3, 3, 0), Cell(6, 6, 0))
    expected = apply(move, world.layout)
    episode = world.execute(targets(near(Cell(3, 3, 0), 0.0, 0.008, 0.0)), expected=expected)
    assert episode.success
    assert episode.errors[0] == pytest.approx(8.0, abs=1.0)


@pytest.mark.parametrize(("offset", "feels"), [(0.003, True), (-0.004, True), (0.003, False)])
def test_a_block_that_comes_down_on_an_edge_finds_its_gap(offset, feels, monkeypatch):
    if not feels:
        monkeypatch.setattr(execution, "FEELS", 0)
    gap, move = Cell(3, 4, 0), Move(Cell(6, 6, 0), Cell(3, 4, 0))
    blocks = ("cube_blue", 3, 3, 0), ("cube_blue", 3, 5, 0), ("cube_red", 6, 6, 0)
    world = make_world(layout=Layout(tuple(block(*b) for b in blocks)))
    expected = apply(move, world.layout)
    episode = world.execute(targets(FAR, near(gap, 0.0, offset, 0.0)), expected=expected)
    assert episode.success is feels, episode.reason
    assert ("place" in episode.stopped) is not feels
    assert episode.displacement < 2.0


def test_a_descent_beside_the_middle_of_a_tower_topples_it():
    world = make_world(layout=TOWER)
    episode = world.execute(targets(near(Cell(3, 3, 0), 0.015, 0.0, 0.0)), expected=TOWER)
    assert episode.success is False
    assert episode.displacement > 20.0
    assert world.layout.at(Cell(3, 3, 3)) is None


def test_a_descent_straight_onto_a_tower_stops_on_top():
    world = make_world(layout=TOWER)
    episode = world.execute(targets(NICO.joint_angles(Cell(3, 3, 0))), expected=TOWER)
    assert "reach" in episode.stopped
    assert episode.grasped == block("cube_red", 3, 3, 3)
    assert episode.success is False


def test_a_block_let_go_in_the_air_falls():
    move = Move(Cell(3, 3, 3), Cell(6, 6, 5))
    world = make_world(layout=TOWER)
    episode = world.execute(joint_targets("nico", move), expected=apply(move, TOWER))
    assert episode.success is False
    assert episode.grasped == block("cube_red", 3, 3, 3)
    assert "red cube is in cell" in episode.reason
    fallen = [b for b in world.layout.blocks if b.cell.z == 0 and b.cell[:2] != (3, 3)]
    assert len(fallen) == 2  # this one, and the blue one that stood there


def test_a_hand_told_to_open_at_once_drops_its_block():
    held = block("cube_cyan", 4, 2, 5)
    layout = Layout((held,), Gripper(held.cell, closed=True))
    world = make_world(layout=layout)
    expected = apply(Move(held.cell, Cell(6, 6, 0), begins_held=True), layout)
    episode = world.execute(targets(NICO.joint_angles(held.cell)), expected=expected)
    assert episode.success is False
    assert "told to open" in episode.reason
    assert world.layout.blocks[0].cell.z == 0


def test_a_hand_told_to_stay_closed_grasps_nothing_after_it_was_opened():
    layout = Layout(SCENE.blocks, Gripper(Cell(6, 5, 4), closed=True))
    world = make_world(layout=layout)
    move = Move(Cell(2, 3, 0), Cell(6, 6, 0))
    answer = targets(NICO.joint_angles(move.source), FAR, closed=(1, 0))
    episode = world.execute(answer, expected=apply(move, SCENE))
    assert episode.grasped is None
    assert "closed before the grasp" in episode.reason


def test_commands_follow_each_other_in_one_world():
    world = make_world(layout=SCENE)
    layout = SCENE
    for move in (
        Move(Cell(3, 3, 1), Cell(6, 1, 0)),
        Move(Cell(2, 3, 0), Cell(3, 3, 1)),
        Move(Cell(6, 1, 0), Cell(3, 3, 2)),
    ):
        layout = apply(move, layout)
        episode = world.execute(joint_targets("nico", move), expected=layout)
        assert episode.success, episode.reason
    assert world.layout.same_blocks(layout)


def test_the_same_targets_give_the_same_trajectory():
    rng = generator(0, "noise")
    noisy = joint_targets("nico", Move(Cell(3, 3, 1), Cell(6, 1, 0)))
    noisy[:6] += rng.normal(0.0, 0.02, 6)
    one, other = (make_world(layout=SCENE).execute(noisy, record=True) for _ in range(2))
    np.testing.assert_array_equal(one.recording.postures, other.recording.postures)
    np.testing.assert_array_equal(one.recording.positions, other.recording.positions)
    assert one.as_json() == other.as_json()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's own account")
def test_worlds_that_are_done_leave_no_memory_behind():
    """The long version is `benchmarks/simulator.py --only memory`, over 1,000 episodes."""

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1])

    layout, move = Layout((block("cube_red", 3, 3, 0),)), Move(Cell(3, 3, 0), Cell(4, 4, 0))
    for _ in range(5):
        do(layout, move)
    before = resident()
    for _ in range(15):
        do(layout, move)
    assert resident() < 1.05 * before


def test_sleeping_blocks_end_where_waking_ones_do(monkeypatch):
    move = Move(Cell(3, 4, 1), Cell(2, 3, 1))
    asleep = do(SCENE, move, record=True)
    options = physics._set_options

    def without_sleep(spec: mujoco.MjSpec) -> None:
        options(spec)
        spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)

    monkeypatch.setattr(physics, "_set_options", without_sleep)
    awake = do(SCENE, move, record=True)
    last = asleep.recording.positions[-1] - awake.recording.positions[-1]
    assert np.abs(last).max() < 1e-3
    assert awake.success


def test_random_worlds_depend_on_the_seed_alone():
    assert make_world(seed=3).layout.blocks == make_world(seed=3).layout.blocks
    assert make_world(seed=3).layout.blocks == random_layout(generator(3, "world")).blocks
    assert make_world(seed=3).layout.blocks != make_world(seed=4).layout.blocks


def test_a_new_world_has_the_layout_that_was_given():
    layout = make_world(layout=SCENE).layout
    assert layout.blocks == SCENE.blocks
    assert layout.gripper.cell.on_grid


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (np.zeros(13), "needs 14 numbers"),
        (np.full(14, np.nan), "finite"),
        (targets(FAR, FAR + [0, 0, 0, 0, 0, 9.0]), "l_wrist_x.*°.*limits"),
        (targets(FAR, FAR, closed=(np.inf, 0)), "gripper value is not finite"),
        ("up a bit", "no answer"),
    ],
)
def test_bad_targets_are_refused(answer, message):
    world = make_world(layout=SCENE)
    with pytest.raises(InputError, match=message):
        world.execute(answer)
    assert world.layout.blocks == SCENE.blocks


def test_an_answer_is_anything_with_a_grasp_and_a_place():
    @dataclass
    class Pose:
        joint_angles: np.ndarray
        gripper: float

    @dataclass
    class Answer:
        grasp: Pose
        place: Pose

    move = Move(Cell(2, 3, 0), Cell(6, 6, 0))
    answer = Answer(Pose(NICO.joint_angles(move.source), 0.2), Pose(FAR, 0.4))
    episode = make_world(layout=SCENE).execute(answer, expected=apply(move, SCENE))
    assert episode.success


def test_an_impossible_expectation_is_not_reached():
    world = make_world(layout=Layout((block("cube_red", 3, 3, 0),)))
    expected = Layout((block("cube_blue", 6, 6, 0),))
    episode = world.execute(targets(NICO.joint_angles(Cell(3, 3, 0))), expected=expected)
    assert episode.success is False
    assert "no blue cube" in episode.reason


def test_the_result_is_plain_json():
    episode = do(SCENE, Move(Cell(3, 3, 1), Cell(6, 1, 0)))
    told = json.loads(json.dumps(episode.as_json()))
    assert told["success"] is True
    assert "13 mm" in told["grasp_model"]
    assert told["grasped"] == {"color": "yellow", "shape": "prism", "cell": [3, 3, 1]}


def test_only_recorded_episodes_can_be_filmed(tmp_path):
    episode = do(SCENE, Move(Cell(3, 3, 1), Cell(6, 1, 0)))
    with pytest.raises(InputError, match="record=True"):
        episode.video(tmp_path / "film.mp4")


def test_treebank_scenes_are_executed(data_folder):
    from fusionnet.blocks import plan
    from fusionnet.corpora import load_corpus

    commands = load_corpus("treebank", data_folder).commands
    for index in generator(0, "physics test").permutation(len(commands))[:8]:
        command = commands[index]
        before = command.scene.before
        move = plan(command.tree, before)
        world = make_world(layout=before)
        episode = world.execute(joint_targets("nico", move), expected=command.scene.after)
        assert episode.success, (command.id, episode.reason)
        assert episode.displacement < 2.0
        assert not episode.touched
