"""Trees by chance that speak of what is there: the meaning half of the synthetic corpus.

Every tree is of the forms that people used in the treebank, in roughly their
proportions: moves, takes, drops, and sequences of a take and a drop. Whether it
can be executed is for the planner to say.
"""

from dataclasses import replace
from random import Random

from fusionnet.blocks import GRID, Block, Layout, Shape
from fusionnet.rcl import (
    Action,
    Color,
    Entity,
    Event,
    Indicator,
    Leaf,
    Measure,
    Relation,
    Sequence,
    SpatialRelation,
    Tree,
    Type,
)

_SIDES = (Indicator.LEFT, Indicator.RIGHT, Indicator.FRONT, Indicator.BACK)
_TYPES = {Shape.CUBE: Type.CUBE, Shape.PRISM: Type.PRISM}
_BESIDE = (Relation.LEFT, Relation.RIGHT, Relation.FRONT)
_STEPS = (Relation.LEFT, Relation.RIGHT, Relation.FORWARD, Relation.BACKWARD)


class Meanings:
    """Draws trees for one layout.

    Args:
        layout: What the trees speak of.
        chance: Where chance comes from.
    """

    def __init__(self, layout: Layout, chance: Random) -> None:
        self.chance = chance
        self.held = layout.held
        self.columns = layout.columns
        self.tops = [column[-1] for column in self.columns.values()]
        self.cubes = [block for block in self.tops if block.shape is Shape.CUBE]

    def tree(self) -> Tree | None:
        """A tree, or None where chance asked for something that is not there."""
        if self.held is not None:
            return self._drop(self.held)
        if not self.tops:
            return None
        block = self.chance.choice(self.tops)
        kind = self.chance.random()
        if kind < 0.09:
            return Event(Leaf(Action.TAKE), self._subject(block))
        if kind < 0.53:
            subject = self._subject(block)
            destination = self._destination(block)
            if destination is None:
                return None
            if destination.entity is not None and subject.id is None:
                subject, destination = self._shared_type(subject, destination)
            return Event(Leaf(Action.MOVE), subject, destination)
        destination = self._destination(block)
        if destination is None:
            return None
        subject = _numbered(self._subject(block))
        if destination.entity is not None:
            subject, destination = self._shared_type(subject, destination)
        take = Event(Leaf(Action.TAKE), subject)
        it = Entity(Leaf(Type.REFERENCE), reference_id=Leaf(1))
        return Sequence((take, Event(Leaf(Action.DROP), it, destination)))

    def _drop(self, held: Block) -> Event | None:
        colored = self.chance.random() < 0.7
        subject = Entity(Leaf(_TYPES[held.shape]), (Leaf(held.color),) if colored else ())
        kind = self.chance.random()
        if kind < 0.45:
            return Event(Leaf(Action.DROP), subject)
        if kind < 0.5:
            board = SpatialRelation(Leaf(Relation.ABOVE), Entity(Leaf(Type.BOARD)))
            return Event(Leaf(Action.DROP), subject, board)
        destination = self._destination(held)
        return None if destination is None else Event(Leaf(Action.DROP), subject, destination)

    def _shared_type(
        self, subject: Entity, destination: SpatialRelation
    ) -> tuple[Entity, SpatialRelation]:
        """At times a destination of the kind spoken of becomes "the blue one".

        What was spoken of last counts: in "the pyramid from the red cube onto the blue one" the
        cube, which then has the name.
        """
        landmark = destination.entity
        below = next((r.entity for r in subject.relations if _is_block(r.entity)), None)
        spoken = subject if below is None else below
        if (
            landmark is None
            or landmark.type.value is not spoken.type.value
            or not landmark.colors
            or self.chance.random() > (0.12 if below is None else 0.4)
            or (below is not None and subject.id is not None)
        ):
            return subject, destination
        one = Entity(
            Leaf(Type.TYPE_REFERENCE),
            landmark.colors,
            landmark.indicators,
            relations=landmark.relations,
            reference_id=Leaf(1),
        )
        there = SpatialRelation(destination.relation, one, destination.measure)
        if below is None:
            return _numbered(subject), there
        [lying] = subject.relations
        named = replace(lying, entity=_numbered(below))
        return replace(subject, relations=(named,)), there

    def _subject(self, block: Block) -> Entity:
        """A description that fits a block, though perhaps not it alone."""
        chance = self.chance
        kind = Leaf(_TYPES[block.shape])
        colors = (Leaf(block.color),) if chance.random() < 0.88 else ()
        style = chance.random()
        if style < 0.24 and block.cell.z > 0:
            return Entity(kind, colors, relations=(self._above(block),))
        if style < 0.45:
            return Entity(kind, colors, relations=(self._situation(block),))
        if style < 0.54:
            return Entity(kind, colors, self._indicators(block))
        if style < 0.57 and block.shape is Shape.CUBE:
            return Entity(kind, colors, cardinal=Leaf(1))
        return Entity(kind, colors)

    def _indicators(self, block: Block) -> tuple[Leaf[Indicator], ...]:
        """What tells a block from others of its kind: "leftmost", "single", "nearest single"."""
        single = len(self.columns.get(block.cell[:2], ())) == 1
        if single and self.chance.random() < 0.5:
            return (Leaf(Indicator.INDIVIDUAL),)
        chosen = self.chance.choice(
            (
                Indicator.LEFTMOST,
                Indicator.LEFTMOST,
                Indicator.RIGHTMOST,
                Indicator.NEAREST,
                Indicator.NEAREST,
                Indicator.LEFT,
                Indicator.RIGHT,
            )
        )
        both = single and self.chance.random() < 0.25
        return (Leaf(chosen), *((Leaf(Indicator.INDIVIDUAL),) if both else ()))

    def _above(self, block: Block) -> SpatialRelation:
        """On what a block stands: a cube, or the stack below it."""
        below = self.columns[block.cell[:2]][: block.cell.z]
        above = Leaf(Relation.ABOVE)
        if len(below) > 1 and self.chance.random() < 0.6:
            return SpatialRelation(above, self._stack(below))
        colors = (Leaf(below[-1].color),) if self.chance.random() < 0.95 else ()
        return SpatialRelation(above, Entity(Leaf(Type.CUBE), colors))

    def _stack(self, cubes: tuple[Block, ...]) -> Entity:
        """A stack or a group of cubes, by its colours from the top or from the bottom."""
        colors: list[Color] = []
        for cube in cubes if self.chance.random() < 0.5 else reversed(cubes):
            if cube.color not in colors:
                colors.append(cube.color)
        kind = Type.STACK if self.chance.random() < 0.75 else Type.CUBE_GROUP
        if len(colors) > 3 or (kind is Type.STACK and self.chance.random() < 0.03):
            return Entity(Leaf(Type.STACK))
        return Entity(Leaf(kind), tuple(Leaf(color) for color in colors))

    def _situation(self, block: Block) -> SpatialRelation:
        """Where a block is: near something, in a corner, beside another block."""
        chance = self.chance
        x, y, _ = block.cell
        style = chance.random()
        if style < 0.12 and x in (0, GRID - 1) and y in (0, GRID - 1):
            sides = (_SIDES[2 + (x == 0)], _SIDES[y == 0])
            relation = Relation.WITHIN if chance.random() < 0.85 else Relation.ABOVE
            return SpatialRelation(Leaf(relation), self._corner(sides))
        if style < 0.18 and (x in (0, GRID - 1) or y in (0, GRID - 1)):
            side = _SIDES[2 + (x == 0)] if x in (0, GRID - 1) else _SIDES[y == 0]
            edge = Entity(Leaf(Type.EDGE), indicators=(Leaf(side),))
            return SpatialRelation(Leaf(Relation.ABOVE), edge)
        if style < 0.26 and x in (3, 4) and y in (3, 4):
            return SpatialRelation(Leaf(Relation.WITHIN), _region(Indicator.CENTER))
        if style < 0.3:
            side = chance.choice(_SIDES[:2])
            relation = chance.choice((Relation.ABOVE, Relation.WITHIN))
            return SpatialRelation(Leaf(relation), _region(side))
        if style < 0.4:
            beside = self._beside(block)
            if beside is not None:
                return beside
        return SpatialRelation(Leaf(Relation.NEAREST), self._near())

    def _beside(self, block: Block) -> SpatialRelation | None:
        """To which neighbour a block stands next, if it has one."""
        x, y, _ = block.cell
        found = []
        for relation, column in (
            (Relation.LEFT, (x, y - 1)),
            (Relation.RIGHT, (x, y + 1)),
            (Relation.FRONT, (x - 1, y)),
        ):
            if column in self.columns:
                found.append((relation, self.columns[column][-1]))
        if not found:
            return None
        relation, other = self.chance.choice(found)
        if self.chance.random() < 0.35:
            relation = Relation.ADJACENT
        other_kind = Leaf(_TYPES[other.shape])
        return SpatialRelation(Leaf(relation), Entity(other_kind, (Leaf(other.color),)))

    def _corner(self, sides: tuple[Indicator, Indicator]) -> Entity:
        first, second = sides if self.chance.random() < 0.7 else sides[::-1]
        return Entity(Leaf(Type.CORNER), indicators=(Leaf(first), Leaf(second)))

    def _any_corner(self) -> Entity:
        return self._corner((self.chance.choice(_SIDES[2:]), self.chance.choice(_SIDES[:2])))

    def _near(self) -> Entity:
        """A landmark for "nearest"."""
        chance = self.chance
        kind = chance.random()
        if kind < 0.36:
            return _region(chance.choice(_SIDES))
        if kind < 0.4:
            return _region(Indicator.CENTER)
        if kind < 0.66:
            return self._any_corner()
        if kind < 0.81:
            return Entity(Leaf(Type.EDGE), indicators=(Leaf(chance.choice(_SIDES)),))
        if kind < 0.88:
            return Entity(Leaf(Type.ROBOT))
        block = chance.choice(self.tops)
        column = tuple(b for b in self.columns[block.cell[:2]] if b.shape is Shape.CUBE)
        if len(column) > 1 and chance.random() < 0.5:
            return self._stack(column)
        return Entity(Leaf(_TYPES[block.shape]), (Leaf(block.color),))

    def _destination(self, moved: Block) -> SpatialRelation | None:
        """Where a block may go."""
        chance = self.chance
        style = chance.random()
        if style < 0.07:
            return SpatialRelation(Leaf(Relation.WITHIN), self._any_corner())
        if style < 0.11:
            return SpatialRelation(Leaf(Relation.ABOVE), self._any_corner())
        if style < 0.16 and moved is not self.held:
            distance = self._distance() if chance.random() < 0.6 else None
            return SpatialRelation(Leaf(chance.choice(_STEPS)), None, distance)
        others = [block for block in self.tops if block is not moved]
        if style < 0.22 and others:
            other = chance.choice(others)
            landmark = Entity(Leaf(_TYPES[other.shape]), (Leaf(other.color),))
            if chance.random() < 0.5:
                return SpatialRelation(Leaf(chance.choice(_BESIDE)), landmark)
            step = chance.choice(_STEPS[:3])
            return SpatialRelation(Leaf(step), landmark, self._distance())
        cubes = [block for block in self.cubes if block is not moved]
        if not cubes:
            return None
        landmark = self._landmark(chance.choice(cubes), moved)
        return SpatialRelation(Leaf(Relation.ABOVE), landmark)

    def _distance(self) -> Measure:
        count = self.chance.choice((1, 1, 1, 1, 2, 2, 2, 3, 3, 4))
        return Measure(Entity(Leaf(Type.TILE), cardinal=Leaf(count)))

    def _landmark(self, cube: Block, moved: Block) -> Entity:
        """A description that fits a cube on which something can be put."""
        column = tuple(b for b in self.columns[cube.cell[:2]] if b is not moved)
        if len(column) > 1 and self.chance.random() < 0.55:
            stack = self._stack(column)
            if self.chance.random() < 0.12:
                return Entity(stack.type, stack.colors, relations=(self._situation(cube),))
            if self.chance.random() < 0.06:
                which = self.chance.choice((Indicator.LEFTMOST, Indicator.NEAREST))
                return Entity(stack.type, stack.colors, (Leaf(which),))
            return stack
        described = self._subject(cube)
        return Entity(described.type, described.colors, described.indicators,
                      relations=described.relations)  # fmt: skip


def _region(side: Indicator) -> Entity:
    return Entity(Leaf(Type.REGION), indicators=(Leaf(side),))


def _is_block(entity: Entity | None) -> bool:
    blocks = (Type.CUBE, Type.PRISM, Type.STACK, Type.CUBE_GROUP)
    return entity is not None and entity.type.value in blocks


def _numbered(entity: Entity) -> Entity:
    """The same entity with the id 1, the only one that the treebank has."""
    if entity.id is not None:
        return entity
    return replace(entity, id=Leaf(1))
