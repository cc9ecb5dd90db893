"""The synthetic corpus: seeded, without end, executable, and its words say what its trees say."""

import re
from itertools import islice

import pytest

from fusionnet.blocks import apply, plan, validate
from fusionnet.corpora import Command, load_corpus, synthetic
from fusionnet.models.tree_symbols import symbols_of
from fusionnet.rcl import Action, Color, Event, Indicator, Relation, Sequence, Type, events
from test_corpora import check_contract, leaves

COUNT = 250
BLOCKS = frozenset({"type:cube", "type:prism", "type:stack", "type:cube-group"})


@pytest.fixture(scope="module")
def made() -> list[Command]:
    return list(islice(synthetic.commands(seed=7), COUNT))


def words_of(sentence: str) -> list[str]:
    return re.findall(r"[\w']+|[^\w\s]", sentence.lower())


def test_it_keeps_the_contract_of_a_corpus(monkeypatch):
    corpus = synthetic.read(size=125)
    check_contract(corpus)
    assert {part: len(corpus.split(part)) for part in ("train", "val", "test")} == {
        "train": 100,
        "val": 12,
        "test": 13,
    }
    monkeypatch.setattr(synthetic, "CORPUS_SIZE", 9)
    assert load_corpus("synthetic").commands == corpus.commands[:9]


def test_every_command_executes_in_a_layout_that_could_stand(made):
    for command in made:
        scene = command.scene
        validate(scene.before)
        validate(scene.after)
        assert apply(plan(command.tree, scene.before), scene.before).same_blocks(scene.after)


def test_a_command_depends_on_seed_and_number_alone(made):
    assert synthetic.command(7, 31) == made[30]
    assert list(islice(synthetic.commands(7, start=31), 2)) == made[30:32]
    assert synthetic.command(8, 31) != made[30]


NAMES = [
    (Type.CUBE, {"cube", "block", "brick", "box"}),
    (Type.PRISM, {"pyramid", "prism", "tetrahedron", "triangle"}),
    (Type.CORNER, {"corner"}),
    (Type.TYPE_REFERENCE, {"one"}),
    (Color.CYAN, {"cyan", "turquoise", "sky blue", "light blue"}),
    (Color.GRAY, {"grey", "gray"}),
    (Color.MAGENTA, {"magenta", "pink", "purple"}),
    (Relation.NEAREST, {"nearest", "closest", "near", "closer"}),
    (Indicator.FRONT, {"top", "far", "upper"}),
    (Indicator.BACK, {"bottom", "back", "lower"}),
    *((color, {color.value}) for color in (Color.RED, Color.BLUE, Color.GREEN, Color.YELLOW)),
]
# By their names: as strings, Relation.FRONT and Indicator.FRONT are one.
SAID = {repr(value): words for value, words in NAMES}


def test_alignments_point_at_the_words_that_say_it(made):
    checked = 0
    for command in made:
        words = words_of(command.sentence)
        seen: list[int] = []
        for leaf in leaves(command.tree):
            said = " ".join(words[position - 1] for position in leaf.tokens)
            seen += leaf.tokens
            if (allowed := SAID.get(repr(leaf.value))) is not None:
                assert said in allowed, command.sentence
                checked += 1
        assert len(seen) == len(set(seen)), f"a word says two things in {command.sentence!r}"
    assert checked > 3 * COUNT


def test_every_color_and_type_is_said(made):
    for command in made:
        for leaf in leaves(command.tree):
            if isinstance(leaf.value, (Color, Indicator, Action)):
                assert leaf.tokens, f"{leaf.value} is not said in {command.sentence!r}"


def test_sentences_and_trees_are_varied(made):
    assert len({command.sentence.lower() for command in made}) > 0.95 * COUNT
    assert len({command.tree for command in made}) > 0.85 * COUNT
    values = {repr(leaf.value) for command in made for leaf in leaves(command.tree)}
    missing = {repr(v) for v in (*Action, *Color, *Relation, *Indicator, *Type)} - values
    assert repr(Type.TYPE_REFERENCE_GROUP) in missing
    assert len(missing) <= 2, missing  # some are rare
    vocabulary = {word for command in made for word in words_of(command.sentence)}
    assert len(vocabulary) > 100
    kinds = [type(command.tree) for command in made]
    assert 0.25 < kinds.count(Sequence) / COUNT < 0.5
    actions = [events(c.tree)[0].action.value for c in made if isinstance(c.tree, Event)]
    assert min(actions.count(action) for action in Action) > 0.06 * COUNT


def test_the_sentences_are_the_same_everywhere(golden):
    said = [synthetic.command(0, number).sentence for number in range(1, 31)]
    golden("synthetic_sentences.txt", "\n".join(said) + "\n")


def test_one_is_of_the_kind_that_was_spoken_of_last():
    """As in the treebank: what stands between has the name, if there is something between."""
    between = 0
    for command in islice(synthetic.commands(3), 1500):
        names = [symbol.name for symbol in symbols_of(command.tree)]
        if "type:type-reference" in names and len(events(command.tree)) == 1:
            subject = names[: names.index("destination")]
            blocks = [at for at, n in enumerate(subject) if n in BLOCKS]
            assert subject.count("id") == 1
            assert (subject.index("id") > blocks[0]) == (len(blocks) > 1), command.sentence
            between += len(blocks) > 1
    assert between > 2
