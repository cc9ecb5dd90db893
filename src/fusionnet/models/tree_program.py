"""A tree as a list of steps that a network can run, many trees at once.

Compiling settles what needs no picture: which entity refers to which, what kind of
thing each one is, and in which order they can be grounded (a landmark before what is
related to it, the moved block before its destination). Packing lays the steps of
several trees side by side, so that one tensor operation serves a level of all trees.
"""

from collections.abc import Sequence as Run
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import product
from typing import NamedTuple

import torch
from jaxtyping import Int
from torch import Tensor

from fusionnet.errors import PlanningError
from fusionnet.rcl import (
    Action,
    Color,
    Entity,
    Event,
    Indicator,
    Relation,
    SpatialRelation,
    Tree,
    Type,
    events,
)

LARGEST_NUMBER = 8
"""Cardinals and measures above this are read as this: the board has eight tiles a side."""

MOST_COLORS = 3
"""Colours of one entity that are heard; the treebank has no more."""


class Kind(IntEnum):
    """What an entity is as a landmark: each kind has its own displacements."""

    BLOCK = 0
    GROUP = 1
    PLACE = 2
    BOARD = 3
    ROBOT = 4


class Subject(IntEnum):
    """What is related to a landmark: a thing that is there, a place, or where to put a block."""

    THING = 0
    PLACE = 1
    TARGET = 2


class Goal(IntEnum):
    """How the place of a command follows."""

    DESTINATION = 0
    LIFT = 1
    DOWN = 2


class Held(IntEnum):
    """Whether an entity is the block in the hand."""

    NO = 0
    YES = 1
    IF_ANY = 2


KIND_OF_TYPE = {
    Type.CUBE: Kind.BLOCK,
    Type.PRISM: Kind.BLOCK,
    Type.STACK: Kind.GROUP,
    Type.CUBE_GROUP: Kind.GROUP,
    Type.CORNER: Kind.PLACE,
    Type.EDGE: Kind.PLACE,
    Type.REGION: Kind.PLACE,
    Type.BOARD: Kind.BOARD,
    Type.ROBOT: Kind.ROBOT,
}
TYPES = tuple(KIND_OF_TYPE)

_NUMBERS = range(1, LARGEST_NUMBER + 1)
_THINGS = tuple(t for t in TYPES if KIND_OF_TYPE[t] <= Kind.GROUP)
_PLACES = tuple(t for t in TYPES if KIND_OF_TYPE[t] > Kind.GROUP)
_COLOR_COUNTS = range(MOST_COLORS + 1)
ATTRIBUTES = (
    *(f"type:{t}" for t in TYPES),
    *(f"thing indicator:{i}" for i in Indicator),
    *(f"type:{t} indicator:{i}" for t, i in product(_PLACES, Indicator)),
    *(f"type:{t} cardinal:{n}" for t, n in product(_THINGS, _NUMBERS)),
    *(f"type:{t} colors:{n}" for t, n in product(_THINGS, _COLOR_COUNTS)),
    *(f"role:{role}" for role in ("moved", "held", "landmark", "destination")),
)
"""What can be said of an entity beside its colours; each has learned scores."""

DIRECTIONS = (
    Relation.LEFT,
    Relation.RIGHT,
    Relation.FORWARD,
    Relation.FRONT,
    Relation.BACKWARD,
)
"""Relations that may have a measure."""

RELATIONS = (
    *product(Relation, (0,), Subject, Kind),
    *product(DIRECTIONS, _NUMBERS, Subject, Kind),
)
"""Every relation with its measure (0: none), its subject and its landmark's kind."""

RANKINGS = tuple(product((Relation.NEAREST, Relation.ABOVE, Relation.WITHIN), (0,), Subject, Kind))
"""The relations that pick the best of several."""

_ATTRIBUTE_NUMBER = {name: number for number, name in enumerate(ATTRIBUTES)}
_RELATION_NUMBER = {key: number for number, key in enumerate(RELATIONS)}
_RANKING_NUMBER = {key: number for number, key in enumerate(RANKINGS)}
_COLOR_NUMBER = {color: number for number, color in enumerate(Color)}
_REFERRING = (Type.REFERENCE, Type.TYPE_REFERENCE, Type.TYPE_REFERENCE_GROUP)


@dataclass(frozen=True, slots=True)
class Related:
    """One relation to a landmark.

    Attributes:
        number: Its number in `RELATIONS`, or in `RANKINGS` if it ranks.
        landmark: The landmark's step.
        ranks: Whether it picks the best of several.
    """

    number: int
    landmark: int
    ranks: bool


@dataclass(frozen=True, slots=True)
class Step:
    """How one entity is grounded.

    Attributes:
        label: The entity in words, for explanations.
        kind: What it is as a landmark.
        level: Steps of a lower level must be done before.
        attributes: Numbers in `ATTRIBUTES`.
        colors: Numbers of its colours.
        ranks: Whether an indicator picks the best among several.
        held: Whether it is the held block rather than a standing one.
        related: Its relations.
        moved: Step of the block that the command moves, for what comes after it.
    """

    label: str
    kind: Kind
    level: int
    attributes: tuple[int, ...] = ()
    colors: tuple[int, ...] = ()
    ranks: bool = False
    held: Held = Held.NO
    related: tuple[Related, ...] = ()
    moved: int | None = None


@dataclass(frozen=True, slots=True)
class TreeProgram:
    """A compiled tree.

    Attributes:
        steps: Its entities, landmarks first.
        source: Step of the block that is moved.
        goal: How its place follows.
        destination: The relation that its place must have, if any.
        held: Whether the block must be in the hand already.
        ends_held: Whether it stays in the hand.
    """

    steps: tuple[Step, ...]
    source: int
    goal: Goal
    destination: Related | None
    held: Held
    ends_held: bool


def compile_tree(tree: Tree) -> TreeProgram:
    """The program of a tree.

    Raises:
        PlanningError: If the tree cannot be carried out in any layout, for example
            because it refers to nothing or does not say where to.
    """
    compiler = _Compiler()
    happenings = events(tree)
    if not happenings:
        raise PlanningError("The command is empty.")
    first, last = happenings[0], happenings[-1]
    action = first.action.value
    role = "held" if action == Action.DROP else "moved"
    compiler.held = {Action.DROP: Held.YES, Action.MOVE: Held.IF_ANY}.get(action, Held.NO)
    source = compiler.entity(first.entity, role)
    if compiler.steps[source].kind != Kind.BLOCK:
        raise PlanningError(f"'{compiler.steps[source].label}' is not one block to be moved.")
    compiler.moved = source
    destination = None
    for event in happenings:
        if event is not first:
            _must_speak_of_the_same_block(event, first)
        if event.destination is not None:
            destination = compiler.destination(event.destination)
    if last.action.value == Action.TAKE:
        goal = Goal.LIFT
    elif destination is not None:
        goal = Goal.DESTINATION
    elif last.action.value == Action.DROP or last.destination is not None:
        goal = Goal.DOWN
    else:
        raise PlanningError("The command does not say where the block shall go.")
    return TreeProgram(
        steps=tuple(compiler.steps),
        source=source,
        goal=goal,
        destination=destination if goal is Goal.DESTINATION else None,
        held=compiler.steps[source].held,
        ends_held=goal is Goal.LIFT,
    )


def _must_speak_of_the_same_block(event: Event, first: Event) -> None:
    if event.action.value == Action.TAKE:
        raise PlanningError("The command takes a block while another is in the hand.")
    wanted = first.entity.id.value if first.entity.id is not None else None
    refers = event.entity.reference_id.value if event.entity.reference_id is not None else None
    if event.entity.type.value == Type.REFERENCE and refers != wanted:
        raise PlanningError("The command refers to something that it did not name before.")


@dataclass
class _Compiler:
    held: Held = Held.NO
    steps: list[Step] = field(default_factory=list)
    named: dict[int, tuple[int | None, Type | None]] = field(default_factory=dict)
    moved: int | None = None

    def entity(self, entity: Entity, role: str) -> int:
        """Add an entity behind its landmarks and return its step."""
        type_, refers = self._resolve(entity, role)
        if refers is not None:
            return refers
        if entity.id is not None:  # its own landmarks may already refer to its type
            self.named[entity.id.value] = (None, type_)
        kind = Kind.BLOCK if type_ is None else KIND_OF_TYPE[type_]
        if kind is Kind.BLOCK and entity.cardinal is not None and entity.cardinal.value != 1:
            raise PlanningError(f"'{_label(entity)}' is more than one block.")
        subject = Subject.THING if kind <= Kind.GROUP else Subject.PLACE
        related = tuple(
            self.related(relation, subject, "landmark")
            for relation in entity.relations
            if relation.entity is not None
        )
        before = [r.landmark for r in related] + ([self.moved] if self.moved is not None else [])
        step = Step(
            label=_label(entity),
            kind=kind,
            level=1 + max((self.steps[b].level for b in before), default=-1),
            attributes=_attributes(entity, type_, role),
            colors=tuple(_COLOR_NUMBER[c.value] for c in entity.colors[:MOST_COLORS]),
            ranks=subject is Subject.THING and bool(entity.indicators),
            held=self.held if role in ("moved", "held") else Held.NO,
            related=related,
            moved=self.moved,
        )
        self.steps.append(step)
        if entity.id is not None:
            self.named[entity.id.value] = (len(self.steps) - 1, type_)
        return len(self.steps) - 1

    def destination(self, relation: SpatialRelation) -> Related | None:
        """Where to: a relation to a landmark, or None for straight down on the board."""
        landmark = relation.entity
        if landmark is None:
            if relation.relation.value not in DIRECTIONS:
                raise PlanningError("The destination names no place.")
        elif landmark.type.value == Type.BOARD and relation.relation.value == Relation.ABOVE:
            return None
        return self.related(relation, Subject.TARGET, "destination")

    def related(self, relation: SpatialRelation, subject: Subject, role: str) -> Related:
        """A relation, its landmark added before; without one, it is the moved block."""
        landmark = self.moved if relation.entity is None else self.entity(relation.entity, role)
        assert landmark is not None
        value, kind = relation.relation.value, self.steps[landmark].kind
        measure = 0
        if relation.measure is not None and value in DIRECTIONS:
            cardinal = relation.measure.entity.cardinal
            measure = min(LARGEST_NUMBER, cardinal.value if cardinal is not None else 1)
        ranks = subject is not Subject.TARGET and (
            value == Relation.NEAREST
            or (value in (Relation.ABOVE, Relation.WITHIN) and _is_side(relation.entity))
        )
        numbers = _RANKING_NUMBER if ranks else _RELATION_NUMBER
        number = numbers[value, measure, subject, kind]
        return Related(number, landmark, ranks)

    def _resolve(self, entity: Entity, role: str) -> tuple[Type | None, int | None]:
        """The type of an entity, or the step of the entity that it refers to.

        Neither, if it is the held block and was not described.
        """
        value = entity.type.value
        if value in KIND_OF_TYPE:
            return value, None
        if value not in _REFERRING:
            raise PlanningError(f"'{_label(entity)}' is nothing that could be found on the board.")
        name = entity.reference_id.value if entity.reference_id is not None else None
        if name not in self.named:
            if role == "held":
                return None, None
            raise PlanningError("The command refers to something that it did not name before.")
        step, type_ = self.named[name]
        if value != Type.REFERENCE:
            return type_, None
        if step is None:
            raise PlanningError("The command describes something by itself.")
        return type_, step


def _is_side(entity: Entity | None) -> bool:
    """Whether a landmark is a side of the board: what is "on" it is what is nearest to it."""
    if entity is None or entity.type.value != Type.REGION:
        return False
    return all(leaf.value != Indicator.CENTER for leaf in entity.indicators)


def _attributes(entity: Entity, type_: Type | None, role: str) -> tuple[int, ...]:
    if type_ is None:
        return (_ATTRIBUTE_NUMBER[f"role:{role}"],)
    names = [f"type:{type_}"]
    if type_ in _THINGS:
        names += [f"role:{role}", f"type:{type_} colors:{min(len(entity.colors), MOST_COLORS)}"]
        if entity.cardinal is not None:
            number = max(1, min(entity.cardinal.value, LARGEST_NUMBER))
            names.append(f"type:{type_} cardinal:{number}")
    group = "thing" if type_ in _THINGS else names[0]
    names += [f"{group} indicator:{leaf.value}" for leaf in entity.indicators]
    return tuple(_ATTRIBUTE_NUMBER[name] for name in dict.fromkeys(names))


def _label(entity: Entity) -> str:
    words = [str(leaf.value) for leaf in entity.indicators]
    words += [str(entity.cardinal.value)] if entity.cardinal is not None else []
    words += [str(leaf.value) for leaf in entity.colors]
    return " ".join([*words, str(entity.type.value)])


class PackedRelations(NamedTuple):
    """Relations of the steps (or targets) numbered `subject` to the steps `landmark`."""

    subject: Int[Tensor, " m"]
    number: Int[Tensor, " m"]
    landmark: Int[Tensor, " m"]
    ranks: Tensor


class PackedLevel(NamedTuple):
    """The steps of one level of several trees; numbers of steps count over the whole pack."""

    example: Int[Tensor, " n"]
    attributes: Int[Tensor, " a"]
    attribute_offsets: Int[Tensor, " n"]
    colors: Int[Tensor, "n 3"]
    kind: Int[Tensor, " n"]
    held: Int[Tensor, " n"]
    moved: Int[Tensor, " n"]
    ranks: Tensor
    relations: PackedRelations


class PackedPrograms(NamedTuple):
    """Several programs side by side.

    Attributes:
        levels: The steps, level by level.
        order: For each step of the pack: its example and its place in that program.
        source: Step of the moved block of each example.
        goal: Goal of each example.
        destination: Relations of the examples' targets.
        held: Whether the block must be in the hand already, for each example.
        ends_held: Whether it stays in the hand.
    """

    levels: tuple[PackedLevel, ...]
    order: tuple[tuple[int, int], ...]
    source: Int[Tensor, " b"]
    goal: Int[Tensor, " b"]
    destination: PackedRelations
    held: Int[Tensor, " b"]
    ends_held: Tensor


NOTHING = -1
"""Stands for no colour and for no moved block."""


def pack(programs: Run[TreeProgram]) -> PackedPrograms:
    """Lay programs side by side, ordered by level."""
    entries = [(e, i, s) for e, p in enumerate(programs) for i, s in enumerate(p.steps)]
    entries.sort(key=lambda entry: entry[2].level)
    place = {(e, i): n for n, (e, i, _) in enumerate(entries)}
    levels = []
    for level in range(1 + max(s.level for _, _, s in entries)):
        found = [(e, s) for e, _, s in entries if s.level == level]
        levels.append(_pack_level(found, place))
    destinations = [(e, e, p.destination) for e, p in enumerate(programs) if p.destination]
    return PackedPrograms(
        levels=tuple(levels),
        order=tuple((e, i) for e, i, _ in entries),
        source=torch.tensor([place[e, p.source] for e, p in enumerate(programs)]),
        goal=torch.tensor([int(p.goal) for p in programs]),
        destination=_pack_relations(destinations, place),
        held=torch.tensor([int(p.held) for p in programs]),
        ends_held=torch.tensor([p.ends_held for p in programs]),
    )


def _pack_level(found: list[tuple[int, Step]], place: dict[tuple[int, int], int]) -> PackedLevel:
    steps = [step for _, step in found]
    lengths = torch.tensor([len(step.attributes) for step in steps])
    colors = [(*s.colors, *[NOTHING] * (MOST_COLORS - len(s.colors))) for s in steps]
    moved = [NOTHING if s.moved is None else place[e, s.moved] for e, s in found]
    relations = [(row, e, r) for row, (e, s) in enumerate(found) for r in s.related]
    return PackedLevel(
        example=torch.tensor([e for e, _ in found]),
        attributes=torch.tensor([a for s in steps for a in s.attributes]),
        attribute_offsets=lengths.cumsum(0) - lengths,
        colors=torch.tensor(colors),
        kind=torch.tensor([int(s.kind) for s in steps]),
        held=torch.tensor([int(s.held) for s in steps]),
        moved=torch.tensor(moved),
        ranks=torch.tensor([s.ranks for s in steps]),
        relations=_pack_relations(relations, place),
    )


def _pack_relations(
    found: list[tuple[int, int, Related]], place: dict[tuple[int, int], int]
) -> PackedRelations:
    """Tensors of (row of the subject, example, relation) triples."""
    return PackedRelations(
        subject=torch.tensor([row for row, _, _ in found], dtype=torch.long),
        number=torch.tensor([r.number for _, _, r in found], dtype=torch.long),
        landmark=torch.tensor([place[e, r.landmark] for _, e, r in found], dtype=torch.long),
        ranks=torch.tensor([r.ranks for _, _, r in found], dtype=torch.bool),
    )
