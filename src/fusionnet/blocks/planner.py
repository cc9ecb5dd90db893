"""The planner: what a tree asks of the arm in a layout, or why it cannot be done.

Executed in the layout before, each of the treebank's 2,500 trees gives the
recorded layout after; of a take, the block that is held (the recorded height
at which it is held, 2 to 7, follows no rule).
"""

from collections.abc import Iterable

from fusionnet.blocks.grid import GRID, Block, Cell, Gripper, Layout, Move, Shape
from fusionnet.blocks.grounding import EXACT, SOFTENED, Grounding
from fusionnet.blocks.things import STEPS, Column, Thing
from fusionnet.errors import PlanningError
from fusionnet.rcl import Action, Event, Relation, SpatialRelation, Tree, Type, describe, events
from fusionnet.rcl.english import describe_relation

HOLDING_HEIGHT = 5
"""Level to which a take lifts its block: the median of the recorded ones."""

GRID_COLUMNS = frozenset((x, y) for x in range(GRID) for y in range(GRID))


def plan(tree: Tree, layout: Layout, *, soften: bool = False) -> Move:
    """The move that a tree asks for in a layout.

    A take lifts its block straight up to level `HOLDING_HEIGHT`, or one level
    where it already stands as high. A drop without a destination lets the held
    block down straight below the gripper.

    Args:
        tree: What was asked.
        layout: Where; it is not checked (see `validate`).
        soften: Let cyan pass for blue and white for gray, and the reverse.

    Raises:
        PlanningError: If it cannot be done; the message says why in a sentence.
    """
    grounding = Grounding(layout, SOFTENED if soften else EXACT)
    held = grounding.held is not None
    block: Block | None = None
    target: Cell | None = None
    for event in events(tree):
        chosen = _moved_block(event, grounding, held)
        if block is not None and chosen is not block:
            raise PlanningError("Only one block can be moved at a time.")
        block = grounding.moved = chosen
        action = event.action.value
        here = block.cell if target is None else target
        if event.destination is not None and action is not Action.TAKE:
            target = _place(event.destination, here, block, grounding)
            held = False
        elif action is Action.TAKE:
            target = Cell(here.x, here.y, min(max(HOLDING_HEIGHT, here.z + 1), GRID - 1))
            held = True
        elif action is Action.DROP:
            target = _resting(here[:2], grounding)
            held = False
        else:
            raise PlanningError(f"It is not said where {describe(event.entity)} shall go.")
    assert block is not None and target is not None
    if target == block.cell and not held:
        raise PlanningError(f"{_the(block)} already is there.")
    return Move(block.cell, target, begins_held=block is grounding.held, ends_held=held)


def apply(move: Move, layout: Layout) -> Layout:
    """The layout after a move; the gripper stays where it holds the block, or rises from it.

    Raises:
        PlanningError: If no block is where the move begins, or one where it ends.
    """
    block = layout.at(move.source)
    if block is None:
        raise PlanningError(f"There is no block at {tuple(move.source)}.")
    if move.target != move.source and layout.at(move.target) is not None:
        raise PlanningError(f"The place {tuple(move.target)} is occupied.")
    moved = Block(block.color, block.shape, move.target)
    x, y, z = move.target
    gripper = Gripper(move.target if move.ends_held else Cell(x, y, GRID - 1), move.ends_held)
    return Layout(tuple(moved if b is block else b for b in layout.blocks), gripper)


def _the(block: Block) -> str:
    return f"The {block.color} {'cube' if block.shape is Shape.CUBE else 'pyramid'}"


def _moved_block(event: Event, grounding: Grounding, held: bool) -> Block:
    """The one block that an event moves."""
    entity, action = event.entity, event.action.value
    if entity.type.value is Type.REFERENCE and grounding.moved is not None:
        return grounding.moved
    layout = grounding.layout
    if held:
        holds = grounding.moved or grounding.held
        assert holds is not None
        if action is Action.TAKE:
            raise PlanningError(f"The gripper already holds {_the(holds).lower()}.")
        if entity.type.value is Type.REFERENCE:  # "drop it": what is in the hand
            return holds
        try:
            found = grounding.find(entity, among=[holds])
        except PlanningError:
            found = []
        if not any(thing.blocks == 1 and thing.cells[0] == holds.cell for thing in found):
            raise PlanningError(f"The gripper holds {_the(holds).lower()}, not {describe(entity)}.")
        return holds
    if action is Action.DROP:
        raise PlanningError("Nothing is held, so nothing can be put down.")
    found = grounding.find(entity)
    if not found[0].blocks:
        raise PlanningError(
            f"{describe(entity).capitalize()} is a place; only a block can be moved."
        )
    if found[0].blocks > 1 or entity.type.value in (Type.STACK, Type.CUBE_GROUP):
        raise PlanningError(f"'{describe(entity)}' is more than one block; name one block.")
    free = [thing for thing in found if _is_top(thing.cells[0], grounding)]
    if len(free) == 1:
        block = layout.at(free[0].cells[0])
        assert block is not None
        if entity.id is not None:
            grounding.named[entity.id.value] = (entity.type.value, free)
        return block
    if not free:
        if len(found) > 1:
            raise PlanningError(f"All {len(found)} that match '{describe(entity)}' are covered.")
        raise PlanningError(f"Something rests on top of {describe(entity)}.")
    raise PlanningError(_several("blocks", entity_text=describe(entity), cells=_cells(free)))


def _cells(things: Iterable[Thing]) -> list[Cell]:
    return [thing.cells[0] for thing in things]


def _several(what: str, entity_text: str, cells: list[Cell]) -> str:
    shown = ", ".join(str(tuple(cell)) for cell in sorted(cells)[:4])
    more = ", ..." if len(cells) > 4 else ""
    return f"{len(cells)} {what} match '{entity_text}', at {shown}{more}; say which one is meant."


def _is_top(cell: Cell, grounding: Grounding) -> bool:
    """Whether nothing rests on the block in a cell: it was lifted, or is the top of its column."""
    lifted = (grounding.held, grounding.moved)
    if any(block is not None and block.cell == cell for block in lifted):
        return True
    return grounding.columns[cell[:2]][-1].cell == cell


def _resting(column: Column, grounding: Grounding) -> Cell:
    """Where a block comes to rest that is let down in a column.

    Raises:
        PlanningError: If nothing can rest there.
    """
    x, y = column
    if column not in GRID_COLUMNS:
        raise PlanningError("That place is off the board.")
    resting = grounding.columns.get(column)
    if not resting:
        return Cell(x, y, 0)
    top = resting[-1]
    if top is grounding.moved:
        if len(resting) == 1:
            return Cell(x, y, 0)
        top = resting[-2]
    if top.shape is Shape.PRISM:
        raise PlanningError(f"Nothing can rest on the tip of {_the(top).lower()}.")
    if top.cell.z == GRID - 1:
        raise PlanningError(f"The tower below is already {GRID} blocks high.")
    return Cell(x, y, top.cell.z + 1)


def _place(relation: SpatialRelation, here: Cell, block: Block, grounding: Grounding) -> Cell:
    """The one cell that a destination stands for."""
    kind, landmark = relation.relation.value, relation.entity
    reach = 1
    if relation.measure is not None and relation.measure.entity.cardinal is not None:
        reach = relation.measure.entity.cardinal.value
    if landmark is None:
        if kind not in STEPS:
            raise PlanningError("The destination names no place.")
        dx, dy = STEPS[kind]
        return _resting((here.x + reach * dx, here.y + reach * dy), grounding)
    if landmark.type.value is Type.BOARD and kind is Relation.ABOVE:
        below = _resting(here[:2], grounding)
        if below.z or below == block.cell:
            raise PlanningError("It is not clear where on the board.")
        return below
    if landmark.type.value is Type.ROBOT and kind in (Relation.ABOVE, Relation.WITHIN):
        raise PlanningError("Nothing can be put on the robot.")
    others = [other for other in grounding.layout.blocks if other is not block]
    landmarks = grounding.find(landmark, among=others)
    cells: set[Cell] = set()
    refusal: PlanningError | None = None
    for mark in landmarks:
        for column in _columns(kind, mark, reach):
            try:
                cell = _resting(column, grounding)
            except PlanningError as error:
                refusal = refusal or error
                continue
            if cell == block.cell:
                continue
            if mark.blocks and kind in (Relation.ABOVE, Relation.WITHIN):
                x, y, z = mark.cells[-1]
                if cell != (x, y, z + 1):
                    refusal = refusal or PlanningError(
                        f"Something rests on top of {describe(landmark)}."
                    )
                    continue
            cells.add(cell)
    if len(cells) == 1:
        return cells.pop()
    if not cells:
        raise refusal or PlanningError(f"{_the(block)} already is there.")
    said = describe_relation(relation, destination=True)
    raise PlanningError(_several("places", entity_text=said, cells=list(cells)))


def _columns(kind: Relation, mark: Thing, reach: int) -> set[Column]:
    """The columns that lie to a landmark as a destination says."""
    own = {cell[:2] for cell in mark.cells}
    if kind in STEPS:
        dx, dy = STEPS[kind]
        return {(x + reach * dx, y + reach * dy) for x, y in own}
    if kind is Relation.ADJACENT or (kind is Relation.NEAREST and mark.blocks):
        steps = set(STEPS.values())
        return {(x + dx, y + dy) for x, y in own for dx, dy in steps} & GRID_COLUMNS
    return own
