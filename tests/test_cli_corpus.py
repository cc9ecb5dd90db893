"""`fusionnet corpus`: show, stats, export and vectors, and what is refused."""

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusionnet.apps import cli
from fusionnet.apps.board_drawing import boards_svg
from fusionnet.apps.board_text import LETTERS, board_text
from fusionnet.blocks import GRID, Shape, layout_from_json, random_layout
from fusionnet.corpora import discard, load_corpus, synthetic, treebank_files
from fusionnet.randomness import generator
from fusionnet.rcl import format, parse
from fusionnet.sentences import Perturbation
from fusionnet.sentences.corpus_statistics import leaves, parts, statistics
from fusionnet.sentences.word_vectors import WordVectors


def as_json(capsys, *words: str) -> dict:
    assert cli.main([*words, "--json"] if words[1] in ("show", "stats") else [*words]) == 0
    return json.loads(capsys.readouterr().out)


def test_show_draws_sentence_tree_layouts_and_move(capsys, tmp_path) -> None:
    picture = tmp_path / "scene.svg"
    assert cli.main(["corpus", "show", "--picture", str(picture)]) == 0
    out = capsys.readouterr().out
    first = load_corpus("examples").commands[0]
    for said in (first.sentence, format(first.tree), 'color red  "red"', "The block at (2, 5, 0)"):
        assert said in out
    assert re.search(r"4  ·  ·  ·  ·  B  ·  ·  ·  +4  ·  ·  ·  ·  Br ·", out)
    assert picture.read_text().count("<svg") == 3
    assert boards_svg(first.scene.before, first.scene.after, None) != picture.read_text()


def test_show_labels_three_perturbed_variants(capsys) -> None:
    document = as_json(capsys, "corpus", "show", "2", "--perturbed")
    assert len(document["perturbed"]) == 3
    for variant in document["perturbed"]:
        assert 1 <= len(variant["applied"]) <= 4
        assert set(variant["applied"]) <= set(Perturbation)
        assert variant["sentence"] != document["sentence"]
        assert parse(variant["rcl"]) == parse(document["rcl"])
    again = as_json(capsys, "corpus", "show", "2", "--perturbed")
    assert again == document
    assert cli.main(["corpus", "show", "2", "--perturbed"]) == 0
    out = capsys.readouterr().out
    assert all(", ".join(v["applied"]) in out for v in document["perturbed"])
    assert layout_from_json(document["scene"]["before"]).blocks


def test_stats_count_what_is_there(capsys) -> None:
    document = as_json(capsys, "corpus", "stats", "--corpus", "synthetic", "--size", "60")
    assert {name: part["commands"] for name, part in document["parts"].items()} == {
        part: len(synthetic.read(size=60).split(part)) for part in ("train", "val", "test")
    } | {"all": 60}
    commands = synthetic.read(size=60).commands
    counted = document["parts"]["all"]
    assert counted == json.loads(json.dumps(statistics(commands)))
    assert counted["values"]["color"]["red"] == sum(
        format(c.tree).count("(color: red") for c in commands
    )
    assert sum(counted["actions"].values()) == 60
    assert cli.main(["corpus", "stats", "--discard"]) == 0
    out = capsys.readouterr().out
    assert "words a sentence" in out and "nothing" in out


def test_every_leaf_of_a_tree_is_met_once() -> None:
    for command in load_corpus("examples").commands:
        met = [(name, str(leaf.value)) for name, leaf in leaves(command.tree)]
        written = re.findall(r"\(([\w-]+): ([\w-]+)", format(command.tree))
        assert sorted(met) == sorted(pair for pair in written if pair[0] != "token")
        assert sum(1 for _ in parts(command.tree)) > len(met)


def treebank_of(folder, most_scenes: int, out):
    """The first scenes of the treebank and their commands, as a folder of their own."""
    scenes = range(1, most_scenes + 1)
    lines = (folder / "commands.txt").read_text().splitlines()
    commands = [line for line in lines if line and int(line.split("\t")[1]) in scenes]
    numbers = {line.split("\t")[0] for line in commands}
    trees = (folder / "annotation.txt").read_text().splitlines()
    records = (folder / "configuration.txt").read_text().split("\n\n")[: most_scenes // 8 * 5]
    (out / "commands.txt").write_text("\n".join(commands))
    (out / "annotation.txt").write_text(
        "\n".join(tree for tree in trees if tree.split("\t")[0] in numbers)
    )
    (out / "configuration.txt").write_text("\n\n".join(records))
    return load_corpus("treebank", out)


@pytest.mark.parametrize("name", ["examples", "synthetic", "treebank"])
def test_what_is_exported_in_the_treebank_s_form_reads_back(name, tmp_path, request) -> None:
    if name == "treebank":
        folder = request.getfixturevalue("data_folder") / "treebank"
        corpus = treebank_of(folder, 40, tmp_path)
        assert len(corpus.commands) > 50 and len(corpus.layouts) == 25
    else:
        corpus = synthetic.read(size=20) if name == "synthetic" else load_corpus(name)
    for file, text in treebank_files(corpus).items():
        (tmp_path / file).write_text(text, newline="\n")
    again = load_corpus("treebank", tmp_path)
    assert len(again.commands) == len(corpus.commands)
    for ours, its in zip(corpus.commands, again.commands, strict=True):
        assert (ours.id, ours.sentence.strip()) == (its.id, its.sentence)
        assert format(ours.tree) == format(its.tree)
        for mine, read in (
            (ours.scene.before, its.scene.before),
            (ours.scene.after, its.scene.after),
        ):
            assert (mine.blocks, mine.gripper) == (read.blocks, read.gripper)
    if name == "treebank":
        assert again == corpus


def test_export_writes_json_lines_and_a_folder_that_can_be_evaluated(capsys, tmp_path) -> None:
    lines, folder = tmp_path / "all.jsonl", tmp_path / "copy"
    source = ["--corpus", "synthetic", "--size", "9", "--seed", "4"]
    assert as_json(capsys, "corpus", "export", "--out", str(lines), *source)["commands"] == 9
    commands = synthetic.read(size=9, seed=4).commands
    for line, command in zip(lines.read_text().splitlines(), commands, strict=True):
        record = json.loads(line)
        assert parse(record["rcl"]) == command.tree
        assert layout_from_json(record["scene"]["before"]) == command.scene.before
    words = ["corpus", "export", "--out", str(folder), "--form", "treebank", *source]
    assert cli.main(words) == 0
    assert sorted(f.name for f in folder.iterdir()) == [
        "annotation.txt",
        "commands.txt",
        "configuration.txt",
    ]
    assert {f.name for f in tmp_path.iterdir()} == {"all.jsonl", "copy"}
    capsys.readouterr()
    assert cli.main(words) == 2
    assert "is there already" in capsys.readouterr().err


def test_discarding_is_an_option(capsys, tmp_path) -> None:
    folder = tmp_path / "treebank"
    folder.mkdir()
    corpus = synthetic.read(size=3)
    texts = treebank_files(corpus)
    texts["commands.txt"] = texts["commands.txt"].replace(corpus.commands[1].sentence, "go")
    for file, text in texts.items():
        (folder / file).write_text(text)
    document = as_json(
        capsys, "corpus", "stats", "--corpus", "treebank", "--data", str(tmp_path), "--discard"
    )
    assert document["left_out"] == {"incomplete sentence": 1}
    assert document["parts"]["all"]["commands"] == 2
    assert len(discard(corpus).commands) == 3


def test_vectors_are_trained_and_written(capsys, tmp_path) -> None:
    file = tmp_path / "new" / "words.safetensors"
    words = ["corpus", "vectors", "--out", str(file), "--of", "trees", "--how.epochs", "2"]
    document = as_json(capsys, *words, "--corpus", "synthetic", "--size", "30", "--how.size", "8")
    assert document["size"] == 8 and "cube" in WordVectors.load(file).words


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["show", "999"], "No command 999 here; the"),
        (["show", "--corpus", "treebnk"], "Did you mean 'treebank'"),
        (["show", "--corpus", "treebank"], "--data DIR"),
        (["show", "--picture", "a.png"], "is an .svg file"),
        (["show", "--picture", "/dev/null/a.svg"], "Cannot write"),
        (["stats", "--size", "3"], "--size is for the corpus 'synthetic'"),
        (["stats", "--corpus", "synthetic", "--size", "0"], "--size is 1 to"),
        (["export", "--out", "/dev/null/all.jsonl"], "Cannot write"),
        (["export", "--out", "/dev/null/all", "--form", "treebank"], "Cannot make"),
        (["vectors", "--out", "/dev/null/w.bin", "--how.least", "9999"], "has to be a folder"),
        (["vectors", "--out", "/tmp", "--how.least", "9999"], "name a file in it"),
        (["vectors", "--out", "w.safetensors", "--how.least", "9999"], "No word occurs 9999 times"),
    ],
)
def test_bad_input_gets_one_line_and_status_two(words, reason, capsys) -> None:
    assert cli.main(["corpus", *words]) == 2
    captured = capsys.readouterr()
    assert reason in captured.err and captured.err.count("\n") == 1


@given(st.integers(0, 10_000))
def test_the_board_as_text_loses_no_block(seed) -> None:
    layout = random_layout(generator(seed, "board text"))
    lines = board_text(layout, "before").plain.splitlines()
    names = {(name if shape is Shape.CUBE else name.lower()): (color, shape)
             for color, name in LETTERS.items() for shape in Shape}  # fmt: skip
    found = set()
    for x in range(GRID):
        squares = re.findall(r"·|[A-Za-z]+", lines[2 + GRID - 1 - x])
        for y, square in zip(reversed(range(GRID)), squares, strict=True):
            found |= {(x, y, z, *names[n]) for z, n in enumerate(square) if n != "·"}
    assert found == {(*b.cell, b.color, b.shape) for b in layout.resting}
    assert lines[-1].startswith("gripper at") and ("holds" in lines[-1]) == bool(layout.held)
