"""`fusionnet translate`: one sentence, many from standard input, and what is refused."""

import io
import json

import pytest

from fusionnet.apps import cli
from fusionnet.models.translator import Translator
from fusionnet.models.translators import translator_folder
from fusionnet.rcl import parse

SENTENCE = "pick up the red cube and put it on the white-gray tower"
TREE = (
    "(sequence: (event: (action: take (token: 1 2)) (entity: (id: 1) (color: red (token: 4)) "
    "(type: cube (token: 5)))) (event: (action: drop (token: 7)) (entity: (type: reference "
    "(token: 8)) (reference-id: 1)) (destination: (spatial-relation: (relation: above (token: 9)) "
    "(entity: (color: white (token: 11)) (color: gray (token: 13)) (type: stack (token: 14)))))))"
)


@pytest.fixture(scope="module", autouse=True)
def translator_read_once():
    """The shipped translator, read from its folder once for all tests."""
    folder = translator_folder("compact")
    shipped = Translator.from_folder(folder)
    read = Translator.from_folder
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Translator, "from_folder", lambda f: shipped if f == folder else read(f))
        yield


def test_one_sentence_gives_tree_words_and_plain_english(capsys) -> None:
    assert cli.main(["translate", SENTENCE]) == 0
    out = capsys.readouterr().out
    assert "Pick up the red cube, then put it onto the white and gray stack." in out
    assert TREE in out
    assert 'type stack  "tower"' in out
    assert "(no word)" in out  # the id


def test_json_holds_the_readings(capsys, tmp_path) -> None:
    picture = tmp_path / "tree.svg"
    words = ["translate", SENTENCE, "--json", "--count", "2", "--picture", str(picture)]
    assert cli.main(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["rcl"] == TREE
    assert document["tokens"][13] == "tower"
    assert len(document["readings"]) == 2
    assert 0 < document["readings"][1]["probability"] < document["probability"] <= 1
    assert "tower" in picture.read_text()


def test_attention_is_drawn_with_the_words_down_and_the_symbols_across(capsys, tmp_path) -> None:
    svg, png = tmp_path / "new" / "attention.svg", tmp_path / "attention.png"
    assert cli.main(["translate", "grab the yellow pyramid", "--attention", str(svg)]) == 0
    drawn = svg.read_text()
    assert ">pyramid<" in drawn and ">color:yellow<" in drawn
    assert cli.main(["translate", "grab the yellow pyramid", "--attention", str(png)]) == 0
    assert png.read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    aside = tmp_path / "file" / "attention.png"
    aside.parent.write_text("")
    assert cli.main(["translate", "grab the yellow pyramid", "--attention", str(aside)]) == 2
    assert "file is a file" in capsys.readouterr().err


def test_a_scene_says_what_would_happen(capsys, tmp_path) -> None:
    layout = tmp_path / "layout.json"
    block = {"color": "cyan", "shape": "cube", "cell": [2, 3, 0]}
    layout.write_text(json.dumps({"blocks": [block]}))
    words = ["translate", "pick up the blue cube", "--layout", str(layout)]
    assert cli.main([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["move"]["source"] == [2, 3, 0] and document["move"]["ends_held"]
    assert "cyan" in document["remark"]
    assert cli.main(words) == 0
    assert "would move the block at (2, 3, 0)" in capsys.readouterr().out
    words[1] = "pick up the green cube"
    assert cli.main(words) == 1
    assert "cannot be done in this scene" in capsys.readouterr().out


def test_standard_input_is_translated_line_by_line(capsys, monkeypatch) -> None:
    lines = [SENTENCE, "xyzzy", "", "pick up the red cube"] + ["drop the green block"] * 62
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(lines) + "\n"))
    assert cli.main(["translate", "--beam", "1"]) == 1
    captured = capsys.readouterr()
    trees = captured.out.split("\n")[:-1]
    assert len(trees) == len(lines)
    assert trees[0] == TREE and trees[1] == trees[2] == ""
    assert trees[-1] == trees[4]
    assert parse(trees[3]) == parse("(event: (action: take) (entity: (color: red) (type: cube)))")
    errors = captured.err.splitlines()
    assert len(errors) == 2 and "line 2:" in errors[0] and "'xyzzy'" in errors[0]
    monkeypatch.setattr("sys.stdin", io.StringIO("pick up the red cube\nxyzzy\n"))
    assert cli.main(["translate", "--json", "--beam", "2"]) == 1
    good, bad = map(json.loads, capsys.readouterr().out.splitlines())
    assert good["english"] == "Pick up the red cube." and "'xyzzy'" in bad["error"]


def test_standard_input_may_hold_any_bytes_and_speak_of_a_scene(capsys, monkeypatch) -> None:
    lines = b"put the red pyramid on the blue cube\n\xff\xfe\x00\ntake the green pyramid\n"
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(lines)))
    assert cli.main(["translate", "--json", "--scene", "1"]) == 1
    captured = capsys.readouterr()
    move, noise, refused = map(json.loads, captured.out.splitlines())
    assert move["move"]["target"] == [4, 3, 1] and move["remark"] == ""
    assert "There is no word" in noise["error"]
    assert refused["refused"] == "There is no green pyramid here."
    assert [line.split(":")[0] for line in captured.err.splitlines()] == ["line 2", "line 3"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([""], "empty"),
        (["pick up the xyzzy"], "'xyzzy'"),
        (["pick up the cube", "--beam", "0"], "beam"),
        (["pick up the cube", "--count", "0"], "At least 1 reading is shown"),
        (["pick up the cube", "--scene", "99999"], "No scene 99999"),
        (["pick up the cube", "--corpus", "treebank"], "Without a scene --corpus treebank would"),
        (["pick up the cube", "--data", "here"], "Without a scene --data here would"),
        (["--picture", "tree.svg"], "--picture can be had of one sentence only"),
        (["--attention", "a.png", "--count", "5"], "--attention and --count can be had of one"),
        (["pick up the cube", "--checkpoint", "nowhere"], "No checkpoint"),
        (["pick up the cube", "--picture", "tree.bmp"], ".png or .svg"),
        (["pick up the cube", "--attention", "map"], ".png or .svg"),
        (["pick up the cube", "--picture", "/dev/null/tree.png"], "/dev/null is a file"),
    ],
)
def test_bad_input_gets_one_line_and_status_two(words, reason, capsys) -> None:
    assert cli.main(["translate", *words]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert reason in captured.err and captured.err.count("\n") == 1
