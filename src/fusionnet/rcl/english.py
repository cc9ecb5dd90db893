"""What a tree says, for people: `describe` in plain English, `outline` as indented text.

Sides are named from the robot's view, so that nothing has to be known about the
treebank's own words: its "front" is the board's far side (x = 7), its "back" the
near one (x = 0).
"""

from collections.abc import Iterator
from typing import Any

from fusionnet.rcl.tree import Entity, Event, Leaf, Measure, Node, Sequence, SpatialRelation, Tree
from fusionnet.rcl.values import Action, Indicator, Relation, Type

_SIDES = {
    Indicator.FRONT: "far",
    Indicator.BACK: "near",
    Indicator.LEFT: "left",
    Indicator.RIGHT: "right",
}
_INDICATORS = {
    Indicator.INDIVIDUAL: "single",
    Indicator.CENTER: "most central",
    Indicator.LEFTMOST: "leftmost",
    Indicator.RIGHTMOST: "rightmost",
    Indicator.NEAREST: "nearest",
    Indicator.LEFT: "left",
    Indicator.RIGHT: "right",
    Indicator.FRONT: "farthest",
    Indicator.BACK: "nearest",
}
_NOUNS = {
    Type.CUBE: "cube",
    Type.PRISM: "pyramid",
    Type.CUBE_GROUP: "cubes",
    Type.STACK: "stack",
    Type.CORNER: "corner",
    Type.EDGE: "edge",
    Type.TILE: "square",
    Type.BOARD: "board",
    Type.ROBOT: "robot",
    Type.REFERENCE: "it",
    Type.TYPE_REFERENCE: "one",
    Type.TYPE_REFERENCE_GROUP: "ones",
}
_DIRECTIONS = {
    Relation.LEFT: "to the left",
    Relation.RIGHT: "to the right",
    Relation.FORWARD: "away from the robot",
    Relation.FRONT: "away from the robot",
    Relation.BACKWARD: "towards the robot",
}
_BESIDE = {
    Relation.LEFT: "to the left of",
    Relation.RIGHT: "to the right of",
    Relation.FORWARD: "beyond",
    Relation.FRONT: "beyond",
    Relation.BACKWARD: "on the near side of",
    Relation.ADJACENT: "next to",
    Relation.NEAREST: "nearest to",
}
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight")
_PLACES = (Type.CORNER, Type.EDGE, Type.REGION, Type.BOARD)


def describe(node: Node) -> str:
    """A tree or a part of one in plain English.

    A tree becomes a sentence, an entity a phrase: "the red pyramid on the blue cube".
    """
    match node:
        case Sequence(events):
            first, *rest = (_event(e) for e in events)
            text = ", then ".join([first, *rest])
            return f"{text[0].upper()}{text[1:]}."
        case Event():
            text = _event(node)
            return f"{text[0].upper()}{text[1:]}."
        case Entity():
            return _entity(node)
        case Measure(entity):
            return _squares(entity)
        case SpatialRelation():
            return describe_relation(node)
    raise TypeError(f"not a node of a tree: {node!r}")


def describe_relation(relation: SpatialRelation, destination: bool = False) -> str:
    """How something lies ("on the blue cube") or where it shall go ("onto the blue cube")."""
    kind, landmark = relation.relation.value, relation.entity
    measure = f"{_squares(relation.measure.entity)} " if relation.measure else ""
    if landmark is None:
        return measure + _DIRECTIONS.get(kind, kind.value)
    if kind in (Relation.ABOVE, Relation.WITHIN):
        inside = landmark.type.value is Type.CORNER or _is_center(landmark)
        preposition = "in" if inside else "on"
        return f"{preposition}{'to' * destination} {_entity(landmark)}"
    if kind is Relation.NEAREST and destination:
        return f"as near as possible to {_entity(landmark)}"
    return f"{measure}{_BESIDE[kind]} {_entity(landmark)}"


def _event(event: Event) -> str:
    words = {Action.MOVE: "move", Action.TAKE: "pick up", Action.DROP: "put down"}
    said = f"{words[event.action.value]} {_entity(event.entity)}"
    if event.destination is None:
        return "put it down" if said == "put down it" else said
    if event.action.value is Action.DROP:
        said = f"put {_entity(event.entity)}"
    return f"{said} {describe_relation(event.destination, destination=True)}"


def _entity(entity: Entity) -> str:
    kind = entity.type.value
    if kind is Type.REFERENCE:
        return "it"
    if kind in _PLACES:
        said = _place(entity)
    else:
        words = [_INDICATORS[leaf.value] for leaf in entity.indicators]
        if entity.cardinal is not None:
            words.append(_number(entity.cardinal.value))
        colors = [leaf.value.value for leaf in entity.colors]
        words += [" and ".join(filter(None, [", ".join(colors[:-1]), *colors[-1:]]))]
        plural = entity.cardinal is not None and entity.cardinal.value > 1
        words += [_NOUNS[kind] + "s" * (plural and kind in (Type.CUBE, Type.PRISM))]
        said = "the " + " ".join(filter(None, words))
    return " ".join([said, *(describe_relation(r) for r in entity.relations)])


def _place(entity: Entity) -> str:
    """A corner, an edge or a side of the board, or the board."""
    kind = entity.type.value
    if kind is Type.BOARD:
        return "the board"
    if _is_center(entity):
        return "the centre of the board"
    sides = [i.value for i in entity.indicators if i.value in _SIDES]
    sides.sort(key=lambda side: side not in (Indicator.FRONT, Indicator.BACK))
    words = " ".join(_SIDES[side] for side in sides)
    if kind is Type.REGION:
        return f"the {words} side of the board" if words else "a part of the board"
    noun = _NOUNS[kind]
    return f"the {words} {noun}" if words else f"a{'n' * (kind is Type.EDGE)} {noun}"


def _is_center(entity: Entity) -> bool:
    return entity.type.value is Type.REGION and any(
        leaf.value is Indicator.CENTER for leaf in entity.indicators
    )


def _number(number: int) -> str:
    return _NUMBERS[number] if number < len(_NUMBERS) else str(number)


def _squares(entity: Entity) -> str:
    count = 1 if entity.cardinal is None else entity.cardinal.value
    return f"{_number(count)} square{'s' * (count != 1)}"


def outline(tree: Tree) -> str:
    """The tree as indented text, one node a line, without word positions."""
    return "\n".join(f"{'  ' * depth}{line}" for depth, line in _outline(tree, 0))


def _outline(node: Node, depth: int) -> Iterator[tuple[int, str]]:
    def leaf(name: str, content: Leaf[Any]) -> tuple[int, str]:
        return depth + 1, f"{name}: {content.value}"

    match node:
        case Sequence(events):
            yield depth, "sequence"
            for event in events:
                yield from _outline(event, depth + 1)
        case Event(action, entity, destination):
            yield depth, f"event: {action.value}"
            yield from _outline(entity, depth + 1)
            if destination is not None:
                yield depth + 1, "destination"
                yield from _outline(destination, depth + 2)
        case SpatialRelation(relation, landmark, measure):
            yield depth, f"relation: {relation.value}"
            if measure is not None:
                yield from _outline(measure, depth + 1)
            if landmark is not None:
                yield from _outline(landmark, depth + 1)
        case Measure(entity):
            yield depth, "measure"
            yield from _outline(entity, depth + 1)
        case Entity():
            yield depth, f"entity: {node.type.value}"
            for indicator in node.indicators:
                yield leaf("indicator", indicator)
            if node.cardinal is not None:
                yield leaf("cardinal", node.cardinal)
            for color in node.colors:
                yield leaf("color", color)
            if node.id is not None:
                yield leaf("id", node.id)
            if node.reference_id is not None:
                yield leaf("reference-id", node.reference_id)
            for spatial_relation in node.relations:
                yield from _outline(spatial_relation, depth + 1)
