"""`fusionnet detect`: boxes and layouts of pictures of every kind, and what is said of bad ones."""

import json

import cv2
import numpy as np
import pytest
from PIL import Image

from fusionnet.apps.cli import main
from fusionnet.blocks import Block, Cell, Color, Layout, Shape, layout_from_json
from fusionnet.models.look import look
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.sight import BOARD_SEEN, board_evidence
from fusionnet.policy import weights_folder
from fusionnet.simulation import SceneRenderer

TABLE = Layout(
    (
        Block(Color.RED, Shape.CUBE, Cell(2, 3, 0)),
        Block(Color.GREEN, Shape.PRISM, Cell(2, 3, 1)),
        Block(Color.BLUE, Shape.CUBE, Cell(6, 1, 0)),
    )
)


@pytest.fixture(scope="module")
def eye():
    """What the robot's left eye sees of three blocks, and of none."""
    renderer = SceneRenderer("nico", size=(960, 540))
    return {
        name: renderer.view(layout, camera="left_eye", labels=False).image
        for name, layout in (("blocks", TABLE), ("bare", Layout(())))
    }


@pytest.fixture(scope="module")
def model():
    return RetinaNet.from_folder(weights_folder("compact") / "detector")


def lines(capsys):
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def save(file, picture, **options):
    Image.fromarray(picture).save(file, **options)
    return str(file)


def test_the_layout_is_read_with_probabilities_and_drawn(eye, tmp_path, capsys):
    file, out = save(tmp_path / "eye.png", eye["blocks"]), tmp_path / "out"
    assert main(["detect", file, "--json", "--out", str(out)]) == 0
    (said,) = lines(capsys)
    assert {tuple(b["cell"]) for b in said["layout"]["blocks"]} == {(2, 3, 0), (2, 3, 1), (6, 1, 0)}
    assert layout_from_json(strip(said["layout"])).blocks == TABLE.blocks
    assert all(0.3 < b["probability"] <= 1 for b in said["layout"]["blocks"])
    assert "gripper" not in said["layout"] and said["holding"] < 0.5
    assert {b["class"] for b in said["boxes"]} == {"cube_red", "prism_green", "cube_blue"}
    assert json.loads((out / "eye.json").read_text()) == said
    drawn = cv2.imread(str(out / "eye-boxes.png"))
    assert drawn.shape == (1080, 1920, 3)
    left, top, right, _ = next(b["box"] for b in said["boxes"] if b["class"] == "cube_blue")
    line = drawn[round(2 * top) - 1 : round(2 * top) + 3, round(left + right)]
    assert (np.abs(line.astype(int) - (230, 95, 45)).sum(1) < 60).any()  # in the block's colour
    assert main(["detect", file]) == 0
    shown = capsys.readouterr().out
    assert "3 blocks found" in shown and "sure of every block" in shown and "gripper" not in shown


def strip(layout):
    blocks = [{k: v for k, v in b.items() if k != "probability"} for b in layout["blocks"]]
    return {"blocks": blocks}


def test_a_table_without_blocks_has_no_boxes_and_an_empty_layout(eye, tmp_path, capsys):
    file = save(tmp_path / "bare.png", eye["bare"])
    assert main(["detect", file, "--json", "--out", str(tmp_path / "out")]) == 0
    (said,) = lines(capsys)
    assert said["boxes"] == [] and said["layout"]["blocks"] == []
    assert main(["detect", file]) == 0
    assert "no block found" in capsys.readouterr().out


def test_of_a_picture_without_a_board_no_layout_is_invented(tmp_path, capsys):
    noise = np.random.default_rng(0).integers(0, 255, (400, 500, 3)).astype(np.uint8)
    flat = np.full((300, 700, 3), 90, np.uint8)
    files = [save(tmp_path / f"{i}.png", p) for i, p in enumerate((noise, flat))]
    assert main(["detect", *files, "--json"]) == 0
    for said in lines(capsys):
        assert said["layout"] is None and said["board_evidence"] < BOARD_SEEN
        assert said["no_layout"].startswith("no board is seen")
    assert main(["detect", files[1]]) == 0
    assert "no layout: no board is seen" in capsys.readouterr().out


def test_all_of_a_picture_without_a_board_is_seen(eye, model):
    """Also what the eye's frame crops away: there the robot has nothing to see."""
    left, top, right, bottom = model.frame.crop
    blocks = model.detect(eye["blocks"])
    red = blocks.xyxy[blocks.scores.argmax()].numpy()
    shift = int(red[0]) - 40
    assert 0 < shift and red[2] - shift < left
    picture = np.roll(eye["blocks"], -shift, axis=1)
    found = look(model, picture)
    assert found.board is not None and found.board < BOARD_SEEN and found.layout is None
    best = found.boxes.xyxy[found.boxes.scores.argmax()].numpy()
    np.testing.assert_allclose(best, red - [shift, 0, shift, 0], atol=6)


def test_the_evidence_for_a_board(eye, model):
    corners = model.see(eye["blocks"]).corners
    assert board_evidence(eye["blocks"], corners) > 0.8
    assert board_evidence(255 - eye["blocks"], corners) > 0.8  # dark and bright exchanged
    assert board_evidence(eye["blocks"], corners + 4000) == 0.0
    assert board_evidence(np.full((540, 960, 3), 128, np.uint8), corners) == 0.0
    middle, turn = corners.mean(axis=0), np.array([[0.8, -0.6], [0.6, 0.8]])
    assert board_evidence(eye["blocks"], (corners - middle) @ turn + middle) < BOARD_SEEN
    assert board_evidence(eye["blocks"], (corners - middle) * 0.7 + middle) < BOARD_SEEN


@pytest.mark.parametrize("shape", [(270, 480), (1080, 1920), (540, 1200), (900, 960), (64, 2000)])
def test_boxes_are_in_pixels_of_pictures_of_any_size(eye, model, shape):
    image = cv2.resize(eye["blocks"], (shape[1], round(shape[1] * 9 / 16)))[: shape[0]]
    if len(image) < shape[0]:
        image = np.pad(image, ((0, shape[0] - len(image)), (0, 0), (0, 0)))
    seen = look(model, image)
    inside = np.tile([shape[1], shape[0]], 2)
    assert (seen.boxes.xyxy.numpy() >= 0).all() and (seen.boxes.xyxy.numpy() <= inside).all()
    if shape in ((270, 480), (1080, 1920)):
        wanted = look(model, eye["blocks"]).boxes.xyxy.numpy() * shape[1] / 960
        surest = seen.boxes.xyxy[: len(wanted)].numpy()
        assert np.abs(np.sort(surest[:3], 0) - np.sort(wanted[:3], 0)).max() < 0.015 * shape[1]
        assert seen.layout is not None and len(seen.layout.blocks) == 3


def test_pictures_of_every_kind_are_seen_alike(eye, tmp_path, capsys):
    picture = eye["blocks"]
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    clear = np.dstack([picture, np.zeros_like(grey)])
    cv2.imwrite(str(tmp_path / "grey16.png"), grey.astype(np.uint16) * 257)
    cv2.imwrite(str(tmp_path / "sixteen.png"), picture[..., ::-1].astype(np.uint16) * 257)
    exif = Image.Exif()
    exif[0x0112] = 6  # held on its side
    side = np.ascontiguousarray(np.rot90(picture))
    files = {
        "plain": save(tmp_path / "plain.png", picture),
        "grey": save(tmp_path / "grey.png", grey),
        "grey16": str(tmp_path / "grey16.png"),
        "sixteen": str(tmp_path / "sixteen.png"),
        "clear": save(tmp_path / "clear.png", clear),
        "turned": save(tmp_path / "turned.png", side, exif=exif),
    }
    assert main(["detect", *files.values(), "--json"]) == 0
    said = dict(zip(files, lines(capsys), strict=True))
    for name, seen in said.items():
        assert seen["layout"] is not None and (seen["width"], seen["height"]) == (960, 540), name
    for same in ("sixteen", "clear", "turned"):
        assert said[same]["boxes"] == said["plain"]["boxes"]
    assert said["grey16"]["boxes"] == said["grey"]["boxes"]


def test_bad_files_are_named_and_the_others_seen(eye, tmp_path, capsys):
    good = save(tmp_path / "good.png", eye["bare"])
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "cut.png").write_bytes((tmp_path / "good.png").read_bytes()[:5000])
    Image.new("L", (9000, 9000)).save(tmp_path / "huge.png")
    bad = {name: str(tmp_path / f"{name}.png") for name in ("empty", "text", "cut", "huge", "none")}
    assert main(["detect", *bad.values(), good, str(tmp_path), "--json"]) == 2
    said = capsys.readouterr()
    documents = [json.loads(line) for line in said.out.splitlines()]
    assert [("error" in document) for document in documents] == [True] * 5 + [False, True]
    for words in ("not a picture", "damaged", "too large", "There is no picture", "not a file"):
        assert words in said.err
    assert "Traceback" not in said.err
    assert main(["detect", bad["text"]]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--score", "2"], "A score goes from 0 to 1"),
        (["--checkpoint", "nothing"], "No policy called 'nothing'"),
        (["--out", "FILE"], "is a file"),
    ],
)
def test_bad_options_are_named(eye, tmp_path, capsys, options, said):
    file = save(tmp_path / "eye.png", eye["bare"])
    options = [file if word == "FILE" else word for word in options]
    assert main(["detect", file, *options]) == 2
    shown = capsys.readouterr()
    assert said in " ".join((shown.err + shown.out).split())


def test_pictures_of_one_name_have_files_of_their_own(eye, tmp_path, capsys):
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    files = [save(tmp_path / folder / "eye.png", eye["bare"]) for folder in "ab"]
    assert main(["detect", *files, "--out", str(tmp_path / "out"), "--json"]) == 0
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {"eye-boxes.png", "eye.json", "eye-2-boxes.png", "eye-2.json"}


def test_a_detector_of_boxes_alone_says_so(eye, tmp_path, capsys):
    from test_retinanet import tiny

    tiny().save(tmp_path / "detector", {}, half=False)
    file = save(tmp_path / "eye.png", eye["bare"])
    for checkpoint in (tmp_path, tmp_path / "detector"):
        assert main(["detect", file, "--checkpoint", str(checkpoint), "--json"]) == 0
        (said,) = lines(capsys)
        assert said["layout"] is None and said["no_layout"] == "this detector finds boxes only"
