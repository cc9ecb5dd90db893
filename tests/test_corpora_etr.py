"""The reader of the Extended Train Robots corpus: lenient in form, strict about harm."""

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusionnet.blocks import Block, Cell, Color, Gripper, Shape, random_layout
from fusionnet.corpora import load_corpus
from fusionnet.errors import DataError
from test_corpora import check_contract

TREE = (
    "(event: (action: take (token: 1)) (entity: (color: red (token: 2)) (type: cube (token: 3))))"
)
FILES = {
    "layouts.xml": """<?xml version="1.0" encoding="utf-8"?>
<layouts>
  <layout id="1">
    <gripper position="6 5 4" open="true"/>
    <shapes><cube color="red" position="0 0 0"/><a><prism color="blue" position="3 3 0"/></a>
    </shapes>
  </layout>
  <layout id="2"><gripper position="0 0 5" open="false"/>
    <cube color="red" position="0 0 5"/><prism color="blue" position="3 3 0"/></layout>
</layouts>""",
    "scenes.xml": """<scenes>
  <scene id="1"><before layoutId="1"/><after layoutId="2"/></scene></scenes>""",
    "commands.xml": """<commands>
  <command id="7" sceneId="1" text="lift red cube"/>
  <command id="8" sceneId="1" text="asdf"/>
  <command id="9" sceneId="1" text="take the cube &amp; hold it"/></commands>""",
    "losr.xml": f"""<losrs>
  <command id="7" losr="{TREE}"/>
  <command id="8" losr="{TREE}"/>
  <command id="9" losr=""/></losrs>""",
    "comments.xml": """<comments>
  <command id="8" comment="spam"/><command id="7" comment=""/></comments>""",
}


@pytest.fixture
def folder(tmp_path) -> Path:
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    return tmp_path


def zipped(path: Path, prefix: str = "", files: dict[str, str] = FILES) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(prefix + name, content)
    return path


def check(corpus) -> None:
    check_contract(corpus)
    assert [command.id for command in corpus.commands] == [7]
    assert corpus.left_out == {"marked as bad by a comment": 1, "without a tree": 1}
    command = corpus.commands[0]
    assert command.sentence == "lift red cube"
    assert (command.scene.id, command.scene.group) == (1, 1)
    assert command.scene.before.gripper == Gripper(Cell(6, 5, 4))
    assert command.scene.before.blocks == (
        Block(Color.RED, Shape.CUBE, Cell(0, 0, 0)),
        Block(Color.BLUE, Shape.PRISM, Cell(3, 3, 0)),
    )
    assert command.scene.after.held == Block(Color.RED, Shape.CUBE, Cell(0, 0, 5))


def test_a_folder(folder):
    check(load_corpus("etr", folder))


def test_files_in_subfolders_and_an_etr_folder(tmp_path):
    for name, content in FILES.items():
        path = tmp_path / "etr" / "data" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    check(load_corpus("etr", tmp_path))


def test_a_zip_and_a_folder_that_holds_only_a_zip(tmp_path):
    check(load_corpus("etr", zipped(tmp_path / "37.zip", "Extended Train Robots/")))
    check(load_corpus("etr", tmp_path))


def test_comments_may_be_missing(folder):
    (folder / "comments.xml").unlink()
    corpus = load_corpus("etr", folder)
    assert [command.id for command in corpus.commands] == [7, 8]
    assert corpus.left_out == {"without a tree": 1}


def test_other_ways_to_write_positions_and_colours(folder):
    text = FILES["layouts.xml"].replace('"3 3 0"', '"3, 3, 0"').replace('"blue"', '"Grey"')
    (folder / "layouts.xml").write_text(text.replace("prism", "pyramid"))
    layout = load_corpus("etr", folder).layouts[1]
    assert layout.blocks[1] == Block(Color.GRAY, Shape.PRISM, Cell(3, 3, 0))


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("layouts.xml", '"0 0 0"', '"0 0 9"', r"layouts\.xml, line 5: <cube> needs a 'color'"),
        ("layouts.xml", '"red" position="0 0 0"', '"rde" position="0 0 0"',
         r"layouts\.xml, line 5: .*'rde'"),
        ("layouts.xml", '"6 5 4"', '"6 5"', r"layouts\.xml, line 4: 'position' of <gripper>"),
        ("layouts.xml", '"true"', '"ajar"', r"line 4: 'open' of <gripper> is true or false"),
        ("layouts.xml", 'id="1"', 'id="one"', r"line 3: 'id' of <layout> is a whole number"),
        ("layouts.xml", '<gripper position="6 5 4" open="true"/>', "",
         r"layouts\.xml, line 3: layout 1 has no <gripper>"),
        ("scenes.xml", 'layoutId="2"', 'layoutId="3"',
         r"scenes\.xml, line 2: there is no layout 3"),
        ("scenes.xml", 'layoutId="2"', "", r"line 2: <after> needs the attribute 'layoutId'"),
        ("scenes.xml", '<after layoutId="2"/>', "", r"scene 1 needs <before> and <after>"),
        ("commands.xml", 'sceneId="1" text="lift', 'sceneId="4" text="lift',
         r"commands\.xml, line 2: there is no scene 4"),
        ("commands.xml", 'text="lift red cube"', "",
         r"commands\.xml, line 2: <command> needs the attribute 'text'"),
        ("losr.xml", "(event: ", "(evnt: ", r"losr\.xml, line 2: Malformed tree at character 1"),
        ("commands.xml", "</commands>", "",
         r"commands\.xml, line 4: not well-formed XML: no element found"),
    ],
)  # fmt: skip
def test_faults_are_named_with_file_and_line(folder, name, old, new, message):
    assert old in FILES[name]
    (folder / name).write_text(FILES[name].replace(old, new, 1))
    with pytest.raises(DataError, match=message):
        load_corpus("etr", folder)


def test_bad_records_are_left_out_and_counted_only_when_asked(folder, caplog):
    (folder / "losr.xml").write_text(FILES["losr.xml"].replace("(event: ", "(evnt: ", 1))
    corpus = load_corpus("etr", folder, skip_bad=True)
    assert not corpus.commands
    assert corpus.left_out == {
        "marked as bad by a comment": 1,
        "without a tree": 2,
        "unreadable": 1,
    }
    assert "losr.xml, line 2" in caplog.text


BOMB = """<?xml version="1.0"?>
<!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<layouts>&b;</layouts>"""
OUTSIDE = '<!DOCTYPE x SYSTEM "http://127.0.0.1/x.dtd"><layouts/>'
FILE = '<!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><layouts>&f;</layouts>'


@pytest.mark.parametrize("text", [BOMB, OUTSIDE, FILE])
def test_entities_are_never_read(folder, text):
    (folder / "layouts.xml").write_text(text)
    with pytest.raises(DataError, match=r"layouts\.xml, line \d: a document type .* is not read"):
        load_corpus("etr", folder)


def test_a_zip_of_endless_zeros_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fusionnet.corpora._xml_files.LARGEST_FILE", 10_000)
    bomb = {**FILES, "layouts.xml": "<layouts>" + " " * 1_000_000}
    with pytest.raises(DataError, match=r"layouts\.xml has more than 10000 bytes"):
        load_corpus("etr", zipped(tmp_path / "bomb.zip", files=bomb))


def test_sources_that_are_none(tmp_path):
    with pytest.raises(DataError, match="not part of this package"):
        load_corpus("etr")
    with pytest.raises(DataError, match=r"There is no layouts\.xml and no scenes\.xml"):
        load_corpus("etr", tmp_path)
    with pytest.raises(DataError, match="There is no file or folder"):
        load_corpus("etr", tmp_path / "none.zip")
    (tmp_path / "broken.zip").write_bytes(b"PK\x03\x04 not really")
    with pytest.raises(DataError, match="is not a zip that can be read"):
        load_corpus("etr", tmp_path / "broken.zip")


@pytest.mark.parametrize("packing", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_damaged_bytes_in_a_zip_are_named(tmp_path, packing):
    path = tmp_path / "etr.zip"
    with zipfile.ZipFile(path, "w", packing) as archive:
        archive.writestr("layouts.xml", FILES["layouts.xml"])
    content = path.read_bytes()
    begin = content.index(b"layouts.xml") + len("layouts.xml")
    path.write_bytes(content[:begin] + b"\xff" * 60 + content[begin + 60 :])
    with pytest.raises(DataError, match=r"etr\.zip (is not a zip that can|cannot) be read: "):
        load_corpus("etr", path)


@pytest.mark.parametrize("encoding", ["latin-99", "shift_jis", "punycode"])
def test_an_encoding_that_cannot_be_read_is_named(folder, encoding):
    (folder / "scenes.xml").write_text(f'<?xml version="1.0" encoding="{encoding}"?><scenes/>')
    with pytest.raises(DataError, match=r"scenes\.xml, line 1: .*; save the file as UTF-8"):
        load_corpus("etr", folder)


def test_any_layout_comes_back(tmp_path):
    rng = np.random.default_rng(0)
    layouts = [replace(random_layout(rng), id=number) for number in range(1, 21)]
    text = "".join(
        f'<layout id="{layout.id}"><gripper position="{" ".join(map(str, layout.gripper.cell))}" '
        f'open="{str(not layout.gripper.closed).lower()}"/>'
        + "".join(
            f'<{block.shape} color="{block.color}" position="{" ".join(map(str, block.cell))}"/>'
            for block in layout.blocks
        )
        + "</layout>\n"
        for layout in layouts
    )
    files = {**FILES, "layouts.xml": f"<layouts>{text}</layouts>"}
    corpus = load_corpus("etr", zipped(tmp_path / "etr.zip", files=files))
    assert list(corpus.layouts.values()) == layouts
