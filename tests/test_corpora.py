"""Corpora: one kind of record, whatever the source; the planner proves the treebank's order."""

from dataclasses import replace

import pytest

from fusionnet.apps import doctor
from fusionnet.apps.cli import main
from fusionnet.blocks import Layout, Scene, apply, plan, validate
from fusionnet.corpora import CATALOGUE, Command, Corpus, discard, load_corpus, part_of
from fusionnet.errors import DataError, PlanningError, UnknownNameError
from fusionnet.rcl import Leaf, format, parse
from tiny_treebank import write_tiny_treebank


@pytest.fixture(scope="module")
def treebank(data_folder) -> Corpus:
    return load_corpus("treebank", data_folder)


def leaves(node):
    """All leaves of a tree."""
    if isinstance(node, Leaf):
        yield node
    elif isinstance(node, tuple):
        for child in node:
            yield from leaves(child)
    elif hasattr(node, "__dataclass_fields__"):
        for name in node.__dataclass_fields__:
            yield from leaves(getattr(node, name))


def check_contract(corpus: Corpus, sample: int = 50) -> None:
    """What holds for every corpus."""
    assert corpus.commands
    assert len({command.id for command in corpus.commands}) == len(corpus.commands)
    assert sum(len(corpus.split(part)) for part in ("train", "val", "test")) == len(corpus.commands)
    for command in corpus.commands[:sample]:
        assert command.corpus == corpus.name
        assert corpus.scenes[command.scene.id] is command.scene
        assert parse(format(command.tree)) == command.tree
        assert apply(plan(command.tree, command.scene.before), command.scene.before).same_blocks(
            command.scene.after
        )
    for layout in list(corpus.layouts.values())[:sample]:
        validate(layout)


def test_the_examples_keep_the_contract():
    corpus = load_corpus("examples")
    check_contract(corpus)
    assert corpus.commands[0].sentence == "put the red pyramid on the blue cube"
    words = corpus.commands[0].sentence.split()
    for leaf in leaves(corpus.commands[0].tree):
        assert [words[position - 1] for position in leaf.tokens]
    moves = [plan(c.tree, c.scene.before) for c in corpus.commands]
    assert any(move.ends_held for move in moves) and any(move.begins_held for move in moves)
    assert 8 <= len(corpus.scenes) <= 20
    assert corpus.split("test") == list(corpus.commands)


def test_the_treebank_keeps_the_contract(treebank):
    check_contract(treebank)
    assert (len(treebank.commands), len(treebank.scenes), len(treebank.layouts)) == (
        2500,
        1000,
        625,
    )


def test_every_tree_of_the_treebank_executes_to_the_recorded_layout(treebank):
    reached = 0
    for command in treebank.commands:
        before = command.scene.before
        reached += apply(plan(command.tree, before), before).same_blocks(command.scene.after)
    assert reached == 2500


def test_the_other_order_of_scenes_is_wrong(treebank):
    """The order of layouts is a finding, not a convention: reversed, trees lead elsewhere."""
    reached = 0
    for command in treebank.commands[:500]:
        scene = command.scene
        try:
            move = plan(command.tree, scene.after)
        except PlanningError:
            continue
        reached += apply(move, scene.after).same_blocks(scene.before)
    assert reached < 50


def test_every_layout_of_the_treebank_could_stand_on_a_table(treebank):
    for layout in treebank.layouts.values():
        validate(layout)
    assert sum(layout.held is not None for layout in treebank.layouts.values()) == 98


def test_texts_of_the_treebank_come_back_exactly(treebank, data_folder):
    lines = (data_folder / "treebank" / "annotation.txt").read_text().splitlines()
    texts = {int(line.split("\t")[0]): line.split("\t")[2] for line in lines if line}
    assert len(texts) == 2500
    for command in treebank.commands[::4]:
        assert format(command.tree) == texts[command.id]


def test_the_parts_of_the_treebank(treebank):
    groups = {part: {g for g in range(1, 126) if part_of(g) == part} for part in ("train", "val")}
    assert (len(groups["train"]), len(groups["val"])) == (100, 12)
    sizes = {part: len(treebank.split(part)) for part in ("train", "val", "test")}
    assert sizes == {"train": 2047, "val": 224, "test": 229}
    seen = {layout_id(c, "train", treebank) for c in treebank.split("train")}
    assert not seen & {layout_id(c, "test", treebank) for c in treebank.split("test")}


def layout_id(command: Command, part: str, corpus: Corpus) -> tuple[int | None, int | None]:
    assert part_of(command.scene.group) == part
    return command.scene.before.id, command.scene.after.id


def test_parts():
    assert part_of(1) == "train"
    assert part_of(None) == "test"
    with pytest.raises(UnknownNameError, match="No part called 'dev'; available: train, val, test"):
        load_corpus("examples").split("dev")


def test_unknown_corpora_are_named_with_those_there_are():
    with pytest.raises(UnknownNameError, match=r"available: .*examples.*treebank.*Did you mean"):
        load_corpus("treebnk")
    assert {"examples", "treebank"} <= set(CATALOGUE.names())


TREE = (
    "(event: (action: take (token: 1)) (entity: (color: red (token: 2)) (type: cube (token: 3))))"
)


@pytest.fixture
def small(tmp_path):
    """A treebank of one command and two layouts, in files with mixed line ends."""
    (tmp_path / "commands.txt").write_bytes(b"7\t1\tlift red cube\r\n")
    (tmp_path / "annotation.txt").write_bytes(f"7\trcl\t{TREE}\r\n".encode())
    (tmp_path / "configuration.txt").write_bytes(
        b"1\t1\r\n6\t5\t4\tO\r\n0\t0\t0\tR\t1\r\n\r\n1\t2\r\n0\t0\t5\tC\r\n0\t0\t5\tR\t1\r\n\r\n"
    )
    return tmp_path


def test_a_folder_with_few_records(small):
    corpus = load_corpus("treebank", str(small))
    check_contract(corpus)
    scene = corpus.commands[0].scene
    assert isinstance(scene, Scene) and isinstance(scene.before, Layout)
    assert (scene.id, scene.group, scene.before.id, scene.after.id) == (1, 1, 1, 2)
    assert corpus.commands[0].sentence == "lift red cube"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("commands.txt", None, r"There is no commands\.txt in"),
        ("commands.txt", b"7\tlift red cube\n", r"commands\.txt, line 1: expected 'id', 'scene'"),
        ("commands.txt", b"8\t1\tlift\n", r"commands\.txt, line 1: command 8 has no tree"),
        ("commands.txt", b"7\t9\tlift\n", r"commands\.txt, line 1: scene 9 has no layouts"),
        ("commands.txt", b"\xff\xfe", r"commands\.txt cannot be read: .*utf-8"),
        ("annotation.txt", b"7\tcfg\t()\n", r"annotation\.txt, line 1: expected 'id', 'rcl'"),
        ("annotation.txt", b"7\trcl\t(event:)\n",
         r"annotation\.txt, line 1: Malformed tree at character 1: an event needs an action"),
        ("configuration.txt", b"1\t1\n6\t5\tO\n",
         r"configuration\.txt, line 2: expected the gripper"),
        ("configuration.txt", b"1\t1\n6\t5\t4\tO\n0\t0\t0\tR\t3\n",
         r"configuration\.txt, line 3: expected a block"),
        ("configuration.txt", b"1\t6\n", r"configuration\.txt, line 1: expected 'group layout'"),
        ("configuration.txt", b"1\t1\n", r"configuration\.txt, line 1: expected the gripper"),
        ("configuration.txt", b"9" * 5000 + b"\t1\n",
         r"configuration\.txt, line 1: expected 'group"),
        ("configuration.txt", b"1\t1\n6\t5\t4\tO\n\n1\t1\n6\t5\t4\tO\n",
         r"configuration\.txt, line 4: layout '1\\t1' is there already"),
        ("commands.txt", "²\t1\tlift\n".encode(), r"commands\.txt, line 1: expected 'id'"),
        ("commands.txt", b"7\t1\tlift\n\n7\t1\tlift\n",
         r"commands\.txt, line 3: command 7 is there already"),
    ],
)  # fmt: skip
def test_faults_are_named_with_file_and_line(small, name, content, message):
    if content is None:
        (small / name).unlink()
    else:
        (small / name).write_bytes(content)
    with pytest.raises(DataError, match=message):
        load_corpus("treebank", small)


def test_groups_may_have_any_numbers_and_files_a_byte_order_mark(small):
    """A folder of somebody else's: its size in memory follows its records, not their numbers."""
    far = 1 + 8 * 99_999_998
    (small / "commands.txt").write_text(f"2501\t{far}\tlift red cube\n", "utf-8-sig")
    (small / "annotation.txt").write_text(f"2501\trcl\t{TREE}", "utf-8-sig")
    layouts = (small / "configuration.txt").read_text().replace("1\t1\n", "99999999\t1\n")
    layouts = layouts.replace("1\t2\n", "99999999\t2\n")
    (small / "configuration.txt").write_text("\n\n" + layouts, "utf-8-sig")
    corpus = load_corpus("treebank", small)
    check_contract(corpus)
    assert corpus.commands[0].scene.group == 99_999_999 and len(corpus.scenes) == 2


def test_bad_records_are_left_out_only_when_asked(small, caplog):
    (small / "commands.txt").write_bytes(b"7\t1\tlift red cube\nnonsense\n8\t1\tlift\n")
    with pytest.raises(DataError, match="--skip-bad"):
        load_corpus("treebank", small)
    corpus = load_corpus("treebank", small, skip_bad=True)
    assert [command.id for command in corpus.commands] == [7]
    assert corpus.left_out == {"unreadable": 1, "without a tree": 1}
    assert [record.getMessage().split(":")[0] for record in caplog.records] == [
        "commands.txt, line 2",
        "commands.txt, line 3",
    ]


def test_discarding_by_the_rules_of_the_thesis():
    examples = load_corpus("examples")
    assert discard(examples) == examples
    first, second, *others = examples.commands
    lift = parse(TREE)
    bad = [
        replace(first, sentence="put"),
        replace(second, tree=lift),
        replace(first, scene=replace(first.scene, after=others[0].scene.after)),
    ]
    corpus = discard(replace(examples, commands=(*bad, *others)))
    assert corpus.commands == tuple(others)
    assert corpus.left_out == {
        "incomplete sentence": 1,
        "tree cannot be executed in its scene": 1,
        "tree leads to another layout": 1,
    }


def test_the_environment_may_name_the_data_of_all_commands(tmp_path, monkeypatch, capsys):
    write_tiny_treebank(tmp_path / "treebank")
    for named, found in ((tmp_path, True), (tmp_path / "treebank", True), (tmp_path.parent, False)):
        monkeypatch.setenv("FUSIONNET_DATA", str(named))
        assert doctor._treebank().found == f"{'found in' if found else 'not in'} {named}"
        assert main(["corpus", "stats", "--corpus", "treebank"]) == (0 if found else 2)
    assert len(load_corpus("treebank", tmp_path).commands) == 40
    monkeypatch.setenv("FUSIONNET_DATA", "")
    assert doctor._treebank().found.startswith("not named")


def test_the_treebank_is_not_in_the_package():
    with pytest.raises(DataError, match="--data DIR"):
        load_corpus("treebank")
