"""FusionNet: named losses, joint values, answers, and the checkpoint."""

from pathlib import Path

import numpy as np
import pytest
import torch

from fusionnet.blocks import Cell, plan
from fusionnet.corpora import load_corpus
from fusionnet.errors import CheckpointError, InputError, PlanningError
from fusionnet.models.checkpoint import save_checkpoint
from fusionnet.models.fusionnet import FusionNet, compact
from fusionnet.models.program_pack import pack
from fusionnet.models.tree_program import compile_tree
from fusionnet.rcl import describe, parse
from fusionnet.robots import load as load_robot
from fusionnet.training.fusion import batch_of
from fusionnet.training.simulated_readings import cells_of, exact_readings, simulated_readings

EXAMPLES = load_corpus("examples").commands
SHIPPED = Path(__file__).resolve().parent.parent / "src/fusionnet/weights/compact/fusion"


def readings(severity: float = 0.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """The example scenes as a reader sees them."""
    cells, held = cells_of([command.scene.before for command in EXAMPLES])
    if not severity:
        return exact_readings(cells, held)
    bad = np.full(len(EXAMPLES), severity)
    return simulated_readings(cells, held, np.random.default_rng(seed), bad)


def example_batch():
    occupancy, holding = readings()
    moves = [(c.tree, plan(c.tree, c.scene.before)) for c in EXAMPLES]
    return batch_of(moves, occupancy, holding)


@pytest.fixture(scope="module")
def taught() -> FusionNet:
    """A network that has seen the examples, and nothing else, a few dozen times."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # small tensors: on a busy machine threads wait for each other
    model, batch = compact(), example_batch()
    optimizer = torch.optim.Adam(model.parameters(), lr=0.05)
    for _ in range(40):
        losses = model.losses(*batch)
        optimizer.zero_grad()
        torch.stack(list(losses.values())).sum().backward()
        optimizer.step()
    torch.set_num_threads(threads)
    return model.eval()


def test_it_can_learn_a_batch_by_heart(taught: FusionNet) -> None:
    with torch.no_grad():
        losses = {n: float(value) for n, value in taught.losses(*example_batch()).items()}
    assert list(losses) == ["grasp", "place", "holds", "joints", "evidence"]
    assert losses["grasp"] < 0.1
    assert losses["place"] < 0.3
    assert losses["holds"] < 0.3
    assert losses["joints"] < 0.01


def test_the_answer_points_at_the_cells_and_reads_the_joint_table(taught: FusionNet) -> None:
    robot = load_robot("nico")
    occupancy, holding = readings()
    for place, command in enumerate(EXAMPLES):
        move = plan(command.tree, command.scene.before)
        answer = taught(occupancy[place], float(holding[place]), [(command.tree, 1.0)])
        assert (answer.source_cell, answer.target_cell) == (move.source.index, move.target.index)
        assert answer.source.sum() == pytest.approx(1, abs=1e-4)
        assert answer.target.sum() == pytest.approx(1, abs=1e-4)
        assert 0 < answer.confidence <= 1
        grasp, place_angles = answer.targets[:6], answer.targets[7:13]
        assert np.degrees(np.abs(grasp - robot.joint_angles(move.source))).max() < 0.3
        assert np.degrees(np.abs(place_angles - robot.joint_angles(move.target))).max() < 0.3
        assert answer.targets[6] == float(move.begins_held)
        assert answer.targets[13] == float(move.ends_held)
        assert round(answer.ends_held) == move.ends_held


def test_attention_names_every_entity(taught: FusionNet) -> None:
    occupancy, holding = readings()
    command = EXAMPLES[2]  # the blue cube from the green one onto the red and yellow stack
    answer = taught(occupancy[2], float(holding[2]), [(command.tree, 1.0)])
    assert [describe(entity) for entity, _ in answer.attention] == [
        "the green cube",
        "the blue cube on the green cube",
        "the red and yellow stack",
    ]
    blue = answer.attention[1][1]
    assert blue.shape == (512,)
    assert int(blue.argmax()) == plan(command.tree, command.scene.before).source.index


def test_readings_are_weighed_and_senseless_ones_left_out(taught: FusionNet) -> None:
    occupancy, holding = readings()
    tree = EXAMPLES[0].tree
    nonsense = parse("(event: (action: take) (entity: (type: corner)))")
    alone = taught(occupancy[0], float(holding[0]), [(tree, 1.0)])
    both = taught(occupancy[0], float(holding[0]), [(nonsense, 0.9), (tree, 0.1)])
    assert both.weights == pytest.approx((1.0,))
    assert np.array_equal(alone.targets, both.targets)
    with pytest.raises(InputError, match="There is no reading"):
        taught(occupancy[0], float(holding[0]), [])
    with pytest.raises(PlanningError, match="not one block"):
        taught(occupancy[0], 0.0, [(nonsense, 1.0)])


def test_scaling_is_undone_exactly(taught: FusionNet) -> None:
    robot = load_robot("nico")
    cell = Cell(2, 3, 1)
    targets = np.concatenate([robot.joint_angles(cell), [0.0], robot.joint_angles(cell), [1.0]])
    assert np.allclose(taught.unscale(robot.scale(targets)), targets)
    assert np.allclose(taught.scaled_table[cell.index], robot.scale(robot.joint_angles(cell)))


def test_a_checkpoint_gives_the_same_answers(taught: FusionNet, tmp_path: Path) -> None:
    taught.save(tmp_path / "fusion", {"note": 1})
    again = FusionNet.from_folder(tmp_path / "fusion")
    assert torch.equal(again.table, taught.table)  # micro-radians survive half precision
    occupancy, holding = readings()
    for place, command in enumerate(EXAMPLES[:4]):
        question = (occupancy[place], float(holding[place]), [(command.tree, 1.0)])
        assert np.allclose(again(*question).targets, taught(*question).targets, atol=1e-4)


def test_a_checkpoint_that_does_not_fit_is_refused(taught: FusionNet, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="No checkpoint"):
        FusionNet.from_folder(tmp_path)
    config = {**taught.config, "joint_names": ["only"]}
    tensors = taught.state_dict()
    save_checkpoint(tmp_path / "a", kind="fusionnet", config=config, tensors=tensors)
    with pytest.raises(CheckpointError, match="limits"):
        FusionNet.from_folder(tmp_path / "a")
    save_checkpoint(tmp_path / "b", kind="fusionnet", config={}, tensors=tensors)
    with pytest.raises(CheckpointError, match="not valid"):
        FusionNet.from_folder(tmp_path / "b")
    few = {name: t for name, t in tensors.items() if name != "executor.order"}
    save_checkpoint(tmp_path / "c", kind="fusionnet", config=taught.config, tensors=few)
    with pytest.raises(CheckpointError, match="do not fit"):
        FusionNet.from_folder(tmp_path / "c")
    save_checkpoint(tmp_path / "d", kind="detector", config=taught.config, tensors=tensors)
    with pytest.raises(CheckpointError, match="expected a 'fusionnet'"):
        FusionNet.from_folder(tmp_path / "d")


@pytest.fixture(scope="module")
def shipped() -> FusionNet:
    if not SHIPPED.is_dir():
        pytest.skip("the fusion part's weights are not in this checkout")
    return FusionNet.from_folder(SHIPPED)


@pytest.mark.parametrize("severity", [0.0, 0.3])
def test_the_shipped_network_carries_out_the_examples(shipped: FusionNet, severity: float) -> None:
    occupancy, holding = readings(severity)
    for place, command in enumerate(EXAMPLES):
        move = plan(command.tree, command.scene.before)
        answer = shipped(occupancy[place], float(holding[place]), [(command.tree, 1.0)])
        cells = (answer.source_cell, answer.target_cell)
        assert cells == (move.source.index, move.target.index), command.sentence


def test_the_shipped_network_prefers_a_reading_that_the_scene_fits(shipped: FusionNet) -> None:
    occupancy, holding = readings()
    absent = parse("(event: (action: take) (entity: (color: magenta) (type: cube)))")
    tree = EXAMPLES[0].tree
    answer = shipped(occupancy[0], float(holding[0]), [(absent, 0.6), (tree, 0.4)])
    assert answer.source_cell == plan(tree, EXAMPLES[0].scene.before).source.index


@torch.inference_mode()
def test_the_shipped_network_misses_what_is_not_there(shipped: FusionNet) -> None:
    occupancy, holding = readings()
    cells, held = torch.from_numpy(occupancy), torch.from_numpy(holding)
    execution, _ = shipped.execute(pack([compile_tree(c.tree) for c in EXAMPLES]), cells, held)
    absent = parse("(event: (action: take) (entity: (color: magenta) (type: cube)))")
    missing, _ = shipped.execute(pack([compile_tree(absent)]), cells[:1], held[:1])
    assert float(execution.evidence.min()) > 20 * float(missing.evidence[0])


def test_the_shipped_network_is_for_this_robot(shipped: FusionNet) -> None:
    robot = load_robot("nico")
    assert shipped.config["joint_names"] == list(robot.joint_names)
    table = shipped.table.numpy() * 1e-6
    assert np.allclose(table, robot.joint_table.reshape(512, -1), atol=1e-6)
