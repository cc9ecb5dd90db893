"""What an entity of a tree stands for in a layout: blocks, stacks of cubes, or places.

The meanings below are those with which all 2,500 trees of the treebank execute
to the recorded layout:

* A stack, or a group of cubes, is the lower part of a column of at least two
  cubes that has exactly the colours that are named. Where no column fits, a
  group may be one cube.
* "Above" a stack is the block that rests on it; where none does, its top cube.
* "Above" or "within" a side of the board is whatever lies nearest to that side.
* "Front" is the board's far side and "forward" leads there; "nearest" without
  a landmark is nearest to the robot.
* Superlatives (nearest, leftmost, ...) choose among what type, colour and
  "single" have left over; those equally near all stay.
"""

import math
from collections.abc import Iterable, Mapping

from fusionnet.blocks.grid import Block, Cell, Color, Layout, Shape
from fusionnet.blocks.things import BOARD, CENTER, STEPS, Thing, distance, places
from fusionnet.errors import PlanningError
from fusionnet.rcl import Entity, Indicator, Relation, SpatialRelation, Type
from fusionnet.rcl.english import describe, describe_relation

SOFTENED: Mapping[Color, Color] = {
    **{color: color for color in Color},
    Color.CYAN: Color.BLUE,
    Color.WHITE: Color.GRAY,
}
"""Colours that people confuse, by one name each: cyan with blue, white with gray."""

EXACT: Mapping[Color, Color] = {color: color for color in Color}
"""Every colour by its own name."""

_SHAPES = {Type.CUBE: Shape.CUBE, Type.PRISM: Shape.PRISM}
_PLACES = (Type.CORNER, Type.EDGE, Type.REGION, Type.BOARD, Type.ROBOT)
_STACKS = (Type.STACK, Type.CUBE_GROUP, Type.TYPE_REFERENCE_GROUP)


class Grounding:
    """A layout, indexed, in which entities are looked up.

    Args:
        layout: Where to look.
        color_names: By which name each colour goes: `EXACT` or `SOFTENED`.

    Attributes:
        columns: The resting blocks of every column that has any, from the bottom up.
        held: The block in the gripper, if there is one.
        moved: The block that is being moved, once it is known: nothing rests on it.
        named: What entities with an `id` stand for.
    """

    def __init__(self, layout: Layout, color_names: Mapping[Color, Color] = EXACT) -> None:
        self.layout = layout
        self.color_names = color_names
        self.held = layout.held
        self.moved: Block | None = None
        self.named: dict[int, tuple[Type, list[Thing]]] = {}
        self.columns = layout.columns

    def find(
        self, entity: Entity, among: Iterable[Block] | None = None, fewest: int = 2
    ) -> list[Thing]:
        """Everything that the entity may stand for: at least one thing.

        Args:
            entity: What is looked for.
            among: The only blocks that it may be; by default every block.
            fewest: Number of cubes that a stack or group has at least.

        Raises:
            PlanningError: If there is no such thing.
        """
        kind = entity.type.value
        reference = entity.reference_id
        if reference is not None and reference.value not in self.named:
            raise PlanningError(
                f"'{describe(entity)}' refers to something that was not named before."
            )
        if kind is Type.REFERENCE:
            if reference is None:
                raise PlanningError("'it' refers to nothing.")
            return self.named[reference.value][1]
        if kind in (Type.TYPE_REFERENCE, Type.TYPE_REFERENCE_GROUP):
            if reference is None:
                raise PlanningError(f"'{describe(entity)}' does not say what kind of thing it is.")
            kind = self.named[reference.value][0]
        if entity.id is not None:
            self.named[entity.id.value] = (kind, [])
        found = self._of_type(kind, entity, among, fewest)
        if not found:
            bare = Entity(entity.type, entity.colors, cardinal=entity.cardinal)
            raise PlanningError(f"There is no {describe(bare).removeprefix('the ')} here.")
        for relation in entity.relations:
            found = self._related(found, relation, entity)
        if kind not in _PLACES and entity.indicators:
            found = self._indicated(found, entity)
        if entity.id is not None:
            self.named[entity.id.value] = (kind, found)
        return found

    def _of_type(
        self, kind: Type, entity: Entity, among: Iterable[Block] | None, fewest: int
    ) -> list[Thing]:
        """What has the right type, colours and number."""
        if kind in _PLACES:
            return places(entity)
        names = self.color_names
        if kind in _SHAPES:
            shape = _SHAPES[kind]
            if entity.cardinal is not None and entity.cardinal.value != 1:
                raise PlanningError(
                    f"'{describe(entity)}' is more than one block; name one block at a time."
                )
            blocks = self.layout.blocks if among is None else among
            if not entity.colors:
                return [Thing((block.cell,), 1) for block in blocks if block.shape is shape]
            # Several colours of one block cannot all hold: any may ("red or orange").
            said = {names[leaf.value] for leaf in entity.colors}
            return [
                Thing((block.cell,), 1)
                for block in blocks
                if block.shape is shape and names[block.color] in said
            ]
        if kind not in _STACKS:
            raise PlanningError(
                f"'{describe(entity)}' is nothing that could be found on the board."
            )
        said = {names[leaf.value] for leaf in entity.colors}
        number = None if entity.cardinal is None else entity.cardinal.value
        stacks = self._stacks(said, number, fewest)
        if not stacks and kind is not Type.STACK:
            return self._stacks(said, number, 1)
        return stacks

    def _stacks(self, colors: set[Color], number: int | None, fewest: int) -> list[Thing]:
        """Lower parts of columns with exactly these colours; without any, whole columns."""
        found = []
        for column in self.columns.values():
            cells: tuple[Cell, ...] = ()
            seen = set()
            whole = sum(b.shape is Shape.CUBE and b is not self.moved for b in column)
            for block in column[:whole]:
                cells += (block.cell,)
                seen.add(self.color_names[block.color])
                height = len(cells)
                fits = seen == colors if colors else height == whole
                if fits and height >= fewest and (number is None or number == height):
                    found.append(Thing(cells, height))
        return found

    def _related(
        self, found: list[Thing], relation: SpatialRelation, entity: Entity
    ) -> list[Thing]:
        """Those that lie to the landmark as the relation says."""
        landmark = relation.entity
        if landmark is None:  # "two squares forward" describes no thing
            return found
        landmarks = self.find(landmark)
        kind = relation.relation.value
        side = landmark.type.value is Type.REGION and landmarks[0] is not CENTER
        if kind is Relation.NEAREST or (side and kind in (Relation.ABOVE, Relation.WITHIN)):
            kept = self._nearest(found, landmarks)
        else:
            reach = 1
            if relation.measure is not None and relation.measure.entity.cardinal is not None:
                reach = relation.measure.entity.cardinal.value
            kept = _lying(found, kind, landmarks, reach)
            if not kept and kind is Relation.ABOVE:
                # "The red cube on the red stack" may be the stack's own top cube.
                tops = {mark.cells[-1] for mark in landmarks if mark.blocks > 1}
                kept = [thing for thing in found if thing.cells[-1] in tops]
            if not kept and landmark.type.value is Type.CUBE_GROUP:
                singles = self.find(landmark, fewest=1)
                kept = _lying(found, kind, singles, reach)
        if not kept:
            bare = Entity(entity.type, entity.colors, entity.indicators, entity.cardinal)
            raise PlanningError(f"No {_said(bare)} is {describe_relation(relation)}.")
        return kept

    def _nearest(self, found: list[Thing], landmarks: list[Thing]) -> list[Thing]:
        """Those at the least distance from any landmark other than themselves."""
        best = math.inf
        kept: list[Thing] = []
        for thing in found:
            away = min(
                (distance(thing, mark) for mark in landmarks if mark.cells != thing.cells),
                default=math.inf,
            )
            if away < best:
                best, kept = away, [thing]
            elif away == best < math.inf:
                kept.append(thing)
        return kept

    def _indicated(self, found: list[Thing], entity: Entity) -> list[Thing]:
        """Those that the indicators choose."""
        said = [leaf.value for leaf in entity.indicators]
        if Indicator.INDIVIDUAL in said:
            found = [thing for thing in found if len(self.columns.get(thing.cells[0][:2], ())) == 1]
            if not found:
                raise PlanningError(f"No {_said(entity)} stands by itself.")
        for indicator in said:
            if indicator is Indicator.CENTER:
                found = self._nearest(found, [CENTER])
            elif indicator is not Indicator.INDIVIDUAL:
                axis, sign = _ORDER[indicator]
                least = min(sign * thing.cells[0][axis] for thing in found)
                found = [thing for thing in found if sign * thing.cells[0][axis] == least]
        return found


_ORDER = {
    Indicator.LEFT: (1, -1),
    Indicator.LEFTMOST: (1, -1),
    Indicator.RIGHT: (1, 1),
    Indicator.RIGHTMOST: (1, 1),
    Indicator.FRONT: (0, -1),
    Indicator.BACK: (0, 1),
    Indicator.NEAREST: (0, 1),
}
"""Superlatives: the coordinate, and by which sign the chosen one is the least."""


def _lying(found: list[Thing], kind: Relation, marks: list[Thing], reach: int) -> list[Thing]:
    """The things that lie to any landmark as a relation (not "nearest") says."""
    if kind is Relation.ADJACENT:
        return [t for t in found if any(distance(t, m) == (m.blocks > 0) for m in marks)]
    if kind is Relation.ABOVE or kind is Relation.WITHIN:
        if any(mark is BOARD for mark in marks):
            return [thing for thing in found if thing.cells[0].z == 0]
        below = {mark.cells[-1] for mark in marks if mark.blocks}
        squares = {cell for mark in marks if not mark.blocks for cell in mark.cells}
        return [
            thing
            for thing in found
            for x, y, z in thing.cells[:1]
            if (x, y, z - 1) in below or (x, y, -1) in squares
        ]
    dx, dy = STEPS[kind]
    columns = {(c.x + reach * dx, c.y + reach * dy) for mark in marks for c in mark.cells}
    return [thing for thing in found if thing.cells[0][:2] in columns]


def _said(entity: Entity) -> str:
    return describe(entity).removeprefix("the ")
