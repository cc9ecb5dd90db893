"""Sentences by chance for trees, and which word says what: the synthetic corpus's English.

The sentence is spoken from left to right; whenever a leaf is said, the positions
of its words go into the tree. Words and alignments follow the treebank's usage:
"top" and "far" are its front, "bottom" and "back" its back, "nearest" is aligned
without its "to", and what goes without saying (a region, "from") stays unaligned.
"""

from collections.abc import Sequence as Several
from random import Random
from typing import Any

from fusionnet.corpora import _words as words
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


def word(tree: Tree, chance: Random) -> tuple[str, Tree]:
    """A sentence that says a tree, and the tree with the positions of the words that say it."""
    speaker = _Speaker(chance)
    return speaker.sentence(tree)


class _Speaker:
    """One person's way of speaking, for one sentence."""

    def __init__(self, chance: Random) -> None:
        self.chance = chance
        self.words: list[str] = []
        self.articles = chance.random() > 0.12
        self.nouns: dict[Type, str] = {}
        self.blurred = False  # would "the cube on the block" be taken for a destination?
        self.going = False  # has the destination begun?

    def _pick(self, choice: words.Choice) -> str:
        phrases, weights = choice
        return phrases[0] if len(phrases) == 1 else self.chance.choices(phrases, weights)[0]

    def _say(self, phrase: str) -> tuple[int, ...]:
        """Say the words; `a |b` aligns only b, `a| b` only a. Returns their positions."""
        if "|" not in phrase:
            first = len(self.words) + 1
            self.words += phrase.split()
            return tuple(range(first, len(self.words) + 1))
        before, after = phrase.split("|")
        if after.startswith(" "):
            said = self._say(before)
            self._say(after)
            return said
        self._say(before)
        return self._say(after)

    def _the(self) -> None:
        if self.articles:
            self.words.append("the")

    def sentence(self, tree: Tree) -> tuple[str, Tree]:
        chance = self.chance
        if chance.random() < 0.04:
            self._say("please")
        said: Tree
        if isinstance(tree, Sequence):
            first = self._event(tree.events[0])
            self._say(self._pick(words.JOINS) if self.articles else "and")
            said = Sequence((first, self._event(tree.events[1], then=True)))
        else:
            said = self._event(tree)
        return self._written(), said

    def _written(self) -> str:
        """The words as one types them: no space before a comma, capitals and stop by habit."""
        text = ""
        capital = self.chance.random() < 0.6
        begins = capital
        for spoken in self.words:
            if spoken in (",", "."):
                text += spoken
                begins = spoken == "."
            elif spoken == "-" or text.endswith("-"):
                text += spoken
            else:
                text += f"{' ' if text else ''}{spoken.capitalize() if begins else spoken}"
                begins = False
        return text + "." * (self.chance.random() < 0.35)

    def _event(self, event: Event, then: bool = False) -> Event:
        action, destination = event.action.value, event.destination
        self.blurred = action is Action.MOVE
        self.going = False
        if action is Action.MOVE:
            verb = self._pick(words.MOVES)
        elif action is Action.TAKE:
            verb = self._pick(words.TAKES)
        elif then:
            verb = self._pick(words.THEN_PUTS)
        else:
            verb = self._pick(words.DROPS if destination is None else words.PUTS)
        after = ""
        if verb in ("pick up", "put down") and not event.entity.relations:
            if self.chance.random() < 0.12:  # "pick the red cube up"
                verb, _, after = verb.partition(" ")
        said = Leaf(action, self._say(verb))
        entity = self._entity(event.entity)
        self._say(after)
        if destination is None:
            return Event(said, entity)
        if action is Action.MOVE and len(self.words) > 9 and self.chance.random() < 0.15:
            self._say(",")
        return Event(said, entity, self._destination(destination))

    def _destination(self, relation: SpatialRelation) -> SpatialRelation:
        kind, landmark = relation.relation.value, relation.entity
        measure = self._measure(relation.measure)
        self.going = True
        if landmark is None:
            return SpatialRelation(
                Leaf(kind, self._say(self._pick(words.STEPS[kind]))), None, measure
            )
        where = landmark.type.value
        if kind is Relation.WITHIN:
            phrase = self._pick(words.INTO)
        elif kind is not Relation.ABOVE:
            phrase = self._pick(words.BESIDES[kind])
        elif where in (Type.CORNER, Type.BOARD):
            phrase = "on"
        else:
            phrase = self._pick(words.DESTINATION_ABOVE)
        said = Leaf(kind, self._say(phrase))
        return SpatialRelation(said, self._entity(landmark), measure)

    def _measure(self, measure: Measure | None) -> Measure | None:
        if measure is None:
            return None
        tiles = measure.entity
        assert tiles.cardinal is not None
        count = tiles.cardinal.value
        number = words.NUMBERS[count] if self.chance.random() < 0.7 else str(count)
        cardinal = Leaf(count, self._say(number))
        noun = self._pick(words.NOUNS[Type.TILE]) + "s" * (count > 1)
        return Measure(Entity(Leaf(Type.TILE, self._say(noun)), cardinal=cardinal))

    def _entity(self, entity: Entity) -> Entity:
        kind = entity.type.value
        if kind is Type.REFERENCE:
            it = "it" if self.chance.random() < 0.95 else self.chance.choice(("that", "this"))
            return Entity(Leaf(kind, self._say(it)), reference_id=entity.reference_id)
        if kind in (Type.CORNER, Type.EDGE, Type.REGION, Type.BOARD, Type.ROBOT):
            return self._place(entity)
        cardinal = entity.cardinal
        if cardinal is not None:
            cardinal = Leaf(cardinal.value, self._say(words.NUMBERS[cardinal.value]))
        else:
            self._the()
        indicators = tuple(
            Leaf(leaf.value, self._say(self._pick(words.INDICATORS[leaf.value])))
            for leaf in entity.indicators
        )
        colors, noun = self._colored(entity)
        relations = tuple(self._relation(relation) for relation in entity.relations)
        return Entity(noun, colors, indicators, cardinal, relations, entity.id, entity.reference_id)

    def _colored(self, entity: Entity) -> tuple[tuple[Leaf[Color], ...], Leaf[Type]]:
        """The colours and the noun, mostly in this order: "red and blue tower"."""
        kind = entity.type.value
        if kind is Type.STACK and entity.colors and self.chance.random() < 0.08:
            noun = Leaf(kind, self._say(self.chance.choice(("tower", "stack", "pile"))))
            self._say("of")
            colors = self._colors(entity.colors)
            self._say(self.chance.choice(("cubes", "blocks")))
            return colors, noun
        colors = self._colors(entity.colors)
        return colors, Leaf(kind, self._say(self._noun(kind, len(colors))))

    def _noun(self, kind: Type, colors: int) -> str:
        if kind is Type.TYPE_REFERENCE:
            return "one"
        if kind is Type.CUBE_GROUP:
            if colors > 1 and self.chance.random() < 0.5:
                return "block"
            return self.chance.choice(("cubes", "blocks", "blocks", "bricks"))
        if kind not in self.nouns or self.chance.random() < 0.1:
            self.nouns[kind] = self._pick(words.NOUNS[kind])
        return self.nouns[kind]

    def _colors(self, colors: Several[Leaf[Color]]) -> tuple[Leaf[Color], ...]:
        join = self.chance.random()
        said = []
        for place, leaf in enumerate(colors):
            if place:
                last = place == len(colors) - 1
                if join < 0.6:
                    self.words.append("and" if last else ",")
                elif join < 0.75:
                    self.words.append("-")
                elif join < 0.8:
                    self._say("and")
            known = words.COLORS.get(leaf.value)
            text = leaf.value.value if known is None else self._pick(known)
            said.append(Leaf(leaf.value, self._say(text)))
        return tuple(said)

    def _place(self, entity: Entity) -> Entity:
        """A corner, an edge, a side or the centre of the board, the board, or the robot."""
        kind = entity.type.value
        if kind is Type.ROBOT:
            you = self._pick(words.YOU)
            return Entity(Leaf(kind, self._say(you)))
        self._the()
        if kind is Type.BOARD:
            return Entity(Leaf(kind, self._say(self._pick(words.NOUNS[kind]))))
        said = []
        for leaf in entity.indicators:
            if leaf.value is Indicator.CENTER:
                text = self._pick(words.CENTERS)
            else:
                text = self._pick(words.CORNER_SIDES[leaf.value])
                if kind is Type.REGION and leaf.value is Indicator.BACK:
                    text = "back" if self.chance.random() < 0.7 else "bottom"
            said.append(Leaf(leaf.value, self._say(text)))
        if kind is Type.REGION:
            center = said[0].value is Indicator.CENTER
            self._say(self._pick(words.AFTER_CENTER) if center else self._pick(words.AFTER_SIDE))
            return Entity(Leaf(kind), indicators=tuple(said))
        text = "corner" if kind is Type.CORNER else self._pick(words.NOUNS[kind])
        noun: Leaf[Any] = Leaf(kind, self._say(text))
        return Entity(noun, indicators=tuple(said))

    def _relation(self, relation: SpatialRelation) -> SpatialRelation:
        """Where a thing is that is being described."""
        kind, landmark = relation.relation.value, relation.entity
        assert landmark is not None
        where = landmark.type.value
        chance = self.chance
        linked = chance.random() < 0.25
        if kind is Relation.NEAREST:
            text = self._pick(words.NEARS)
            if linked or text == "closer":
                self._say(chance.choice(("that is", "which is")))
            said = Leaf(kind, self._say(text))
            if chance.random() < (0.15 if text in ("nearest", "near") else 1.0):
                self._say("to")
            return SpatialRelation(said, self._entity(landmark))
        placed = chance.choice(("placed ", "", "", "located ")) if not linked else ""
        if kind is Relation.ABOVE and where not in (Type.CORNER, Type.EDGE, Type.REGION):
            return SpatialRelation(Leaf(kind, self._standing()), self._entity(landmark))
        if linked:
            self._say(chance.choice(("that is", "which is")))
        if kind is Relation.WITHIN:
            text = placed + self._pick(words.WITHIN)
        elif kind is Relation.ABOVE:
            at_edge = where is Type.EDGE and chance.random() < 0.5
            text = placed + ("at" if at_edge else "on")
        else:
            text = placed + self._pick(words.BESIDES[kind])
        return SpatialRelation(Leaf(kind, self._say(text)), self._entity(landmark))

    def _standing(self) -> tuple[int, ...]:
        """Say that a thing stands on another; where a destination follows, in no blurred way."""
        style = self.chance.random()
        if self.blurred:
            style *= 0.55 if self.going else 0.75
        if style < 0.28:
            self._say(self.chance.choice(("that is", "which is", "that's")))
            return self._say(self._pick(words.THAT_IS_ABOVE))
        if style < 0.55:
            stands = self.chance.choice(("placed", "placed", "located", "sitting", "standing"))
            return self._say(f"{stands} {self._pick(words.STANDING)}")
        if style < 0.75 and not self.going:
            self._say("from")
            return self._say("the |top of") if self.chance.random() < 0.5 else ()
        return self._say(self._pick(words.ABOVE))
