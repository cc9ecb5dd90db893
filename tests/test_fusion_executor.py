"""Trees as programs, soft layouts, and the executor that joins them."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.blocks import Cell
from fusionnet.blocks.plausibility import PlausibleLayouts
from fusionnet.corpora import load_corpus
from fusionnet.errors import PlanningError
from fusionnet.models.fusers.tree_executor import TreeExecutor
from fusionnet.models.program_pack import pack
from fusionnet.models.program_values import Goal, Held, Kind
from fusionnet.models.soft_layout import soft_layout
from fusionnet.models.tree_program import compile_tree
from fusionnet.rcl import Type, parse
from fusionnet.training.simulated_readings import cells_of, exact_readings, simulated_readings

EXAMPLES = load_corpus("examples").commands


def event(action: str, entity: str, destination: str = "") -> str:
    return f"(event: (action: {action}) {entity} {destination})"


def test_a_take_and_drop_is_one_program_with_the_landmark_first() -> None:
    program = compile_tree(EXAMPLES[3].tree)
    kinds = [step.entity.type.value for step in program.steps]
    assert kinds == [Type.CUBE, Type.STACK]
    assert program.source == 0
    assert program.goal is Goal.DESTINATION
    assert program.destination is not None
    assert program.destination.landmark == 1
    assert program.steps[1].moved == 0
    assert program.steps[1].kind is Kind.GROUP
    assert (program.held, program.ends_held) == (Held.NO, False)


def test_a_bare_drop_goes_down_and_a_take_goes_up() -> None:
    drop = compile_tree(parse(event("drop", "(entity: (type: cube))")))
    assert (drop.goal, drop.held, drop.ends_held) == (Goal.DOWN, Held.YES, False)
    take = compile_tree(parse(event("take", "(entity: (type: cube))")))
    assert (take.goal, take.held, take.ends_held) == (Goal.LIFT, Held.NO, True)


def test_it_may_be_the_held_block() -> None:
    corner = "(destination: (spatial-relation: (relation: above) (entity: (type: corner))))"
    it = "(entity: (type: reference) (reference-id: 1))"
    program = compile_tree(parse(event("drop", it, corner)))
    assert program.held is Held.YES
    with pytest.raises(PlanningError, match="did not name"):
        compile_tree(parse(event("take", it)))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (event("move", "(entity: (type: cube))"), "where"),
        (event("take", "(entity: (type: corner))"), "not one block"),
        (event("take", "(entity: (cardinal: 2) (type: cube))"), "more than one"),
        (event("take", "(entity: (type: tile))"), "nothing that could be found"),
    ],
)
def test_what_makes_sense_nowhere_is_refused(text: str, reason: str) -> None:
    with pytest.raises(PlanningError, match=reason):
        compile_tree(parse(text))


def test_every_tree_of_the_treebank_compiles(data_folder) -> None:
    commands = load_corpus("treebank", data_folder).commands
    programs = [compile_tree(command.tree) for command in commands]
    for command, program in zip(commands, programs, strict=True):
        assert all(
            program.steps[r.landmark].level < step.level
            for step in program.steps
            for r in step.related
        )
        assert program.ends_held == (command.scene.after.held is not None), command.id


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), holding=st.floats(0, 1))
def test_soft_layouts_obey_the_laws_of_probability(seed: int, holding: float) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.dirichlet(np.full(17, 0.05), size=(8, 8, 8))
    layout = soft_layout(
        torch.from_numpy(cells[None]), torch.tensor([holding], dtype=torch.float64)
    )
    one = torch.ones((), dtype=torch.float64)
    assert torch.allclose(layout.heights.sum(2), one)
    assert torch.allclose(layout.classes.sum(2), one)
    assert layout.held.sum().item() == pytest.approx(holding, abs=1e-6)
    standing = layout.standing.unflatten(1, (64, 8))
    assert bool((standing.diff(dim=2) <= 1e-9).all())  # no gaps


def test_soft_and_drawn_layouts_follow_the_same_law() -> None:
    cells, held = cells_of([command.scene.before for command in EXAMPLES])
    occupancy, holding = simulated_readings(cells, held, np.random.default_rng(0))
    soft = soft_layout(torch.from_numpy(occupancy), torch.zeros(len(EXAMPLES)))
    hanging = soft_layout(torch.from_numpy(occupancy), torch.ones(len(EXAMPLES)))
    for place in range(len(EXAMPLES)):
        plausible = PlausibleLayouts(occupancy[place], float(holding[place]))
        assert np.allclose(soft.heights[place], plausible.heights, atol=1e-3)
        held_cells = plausible.hanging.sum(1).ravel()
        assert np.allclose(hanging.held[place], held_cells, atol=1e-3)


def test_an_exact_reading_is_the_layout_itself() -> None:
    before = EXAMPLES[0].scene.before
    cells, held = cells_of([before])
    occupancy, holding = exact_readings(cells, held)
    layout = soft_layout(torch.from_numpy(occupancy), torch.from_numpy(holding))
    filled = {Cell.from_index(int(i)) for i in (layout.standing[0] > 0.5).nonzero()[:, 0]}
    assert filled == {block.cell for block in before.blocks}
    for block in before.blocks:
        assert int(layout.classes[0, block.cell.index].argmax()) == block.class_index
    landing = layout.landing[0].unflatten(0, (64, 8)).sum(1)
    prisms = {b.cell.x * 8 + b.cell.y for b in before.blocks if b.shape == "prism"}
    assert {int(i) for i in (landing < 0.5).nonzero()[:, 0]} == prisms


@pytest.fixture(scope="module")
def executor() -> TreeExecutor:
    torch.manual_seed(0)
    executor = TreeExecutor()
    with torch.no_grad():
        for parameter in executor.parameters():
            parameter.add_(0.5 * torch.randn_like(parameter))
    return executor.double()


def _examples() -> tuple[torch.Tensor, torch.Tensor]:
    cells, held = cells_of([command.scene.before for command in EXAMPLES])
    occupancy, holding = simulated_readings(cells, held, np.random.default_rng(1))
    return torch.from_numpy(occupancy).double(), torch.from_numpy(holding).double()


def test_a_pack_gives_what_its_programs_give_alone(executor: TreeExecutor) -> None:
    occupancy, holding = _examples()
    programs = [compile_tree(command.tree) for command in EXAMPLES]
    together = executor(pack(programs), soft_layout(occupancy, holding))
    for place, program in enumerate(programs):
        one = slice(place, place + 1)
        alone = executor(pack([program]), soft_layout(occupancy[one], holding[one]))
        assert torch.allclose(together.source[place], alone.source[0], atol=1e-6)
        assert torch.allclose(together.target[place], alone.target[0], atol=1e-6)


def test_distributions_add_up_to_one(executor: TreeExecutor) -> None:
    occupancy, holding = _examples()
    programs = pack([compile_tree(command.tree) for command in EXAMPLES])
    execution = executor(programs, soft_layout(occupancy, holding))
    one = torch.ones((), dtype=torch.float64)
    assert torch.allclose(execution.source.exp().sum(1), one)
    assert torch.allclose(execution.target.exp().sum(1), one)
    assert bool((execution.steps <= 1e-6).all())


def test_gradients_reach_what_was_seen(executor: TreeExecutor) -> None:
    occupancy, holding = _examples()
    programs = pack([compile_tree(command.tree) for command in EXAMPLES])
    occupancy.requires_grad_(True)

    def score(cells: torch.Tensor) -> torch.Tensor:
        execution = executor(programs, soft_layout(cells, holding))
        return (execution.source.exp() ** 2).sum() + (execution.target.exp() ** 2).sum()

    score(occupancy).backward()
    assert occupancy.grad is not None
    towards = torch.randn(occupancy.shape, generator=torch.Generator().manual_seed(0)).double()
    towards = torch.where((occupancy > 1e-3) & (occupancy < 1 - 1e-3), towards, 0.0).detach()
    step = 1e-6
    with torch.no_grad():
        change = score(occupancy + step * towards) - score(occupancy - step * towards)
    expected = (occupancy.grad * towards).sum().item()
    assert change.item() / (2 * step) == pytest.approx(expected, rel=2e-3)
