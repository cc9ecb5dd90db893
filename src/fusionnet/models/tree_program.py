"""A tree as a list of steps that a network can run.

Compiling settles what needs no picture: which entity refers to which, what kind of
thing each one is, and in which order they can be grounded (a landmark before what is
related to it, the moved block before its destination).
"""

from dataclasses import dataclass, field

from fusionnet.errors import PlanningError
from fusionnet.models.program_values import (
    ATTRIBUTES,
    DIRECTIONS,
    KIND_OF_TYPE,
    LARGEST_NUMBER,
    MOST_COLORS,
    RANKINGS,
    RELATIONS,
    THINGS,
    Goal,
    Held,
    Kind,
    Subject,
)
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
        entity: What is grounded.
        kind: What it is as a landmark.
        level: Steps of a lower level must be done before.
        attributes: Numbers in `ATTRIBUTES`.
        colors: Numbers of its colours.
        ranks: Whether an indicator picks the best among several.
        held: Whether it is the held block rather than a standing one.
        related: Its relations.
        moved: Step of the block that the command moves, for what comes after it.
    """

    entity: Entity
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
        raise PlanningError(f"'{_label(first.entity)}' is not one block to be moved.")
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
            entity=entity,
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
    if type_ in THINGS:
        names += [f"role:{role}", f"type:{type_} colors:{min(len(entity.colors), MOST_COLORS)}"]
        if entity.cardinal is not None:
            number = max(1, min(entity.cardinal.value, LARGEST_NUMBER))
            names.append(f"type:{type_} cardinal:{number}")
    group = "thing" if type_ in THINGS else names[0]
    names += [f"{group} indicator:{leaf.value}" for leaf in entity.indicators]
    return tuple(_ATTRIBUTE_NUMBER[name] for name in dict.fromkeys(names))


def _label(entity: Entity) -> str:
    words = [str(leaf.value) for leaf in entity.indicators]
    words += [str(entity.cardinal.value)] if entity.cardinal is not None else []
    words += [str(leaf.value) for leaf in entity.colors]
    return " ".join([*words, str(entity.type.value)])
