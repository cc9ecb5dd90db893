"""`fusionnet run` as a person uses it, with the shipped networks, physics and pictures."""

import contextlib
import io
import json
import os
import re
import resource
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib import resources
from pathlib import Path
from unittest.mock import Mock

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from fusionnet.apps.cli import main
from fusionnet.apps.page_evidence import answered
from fusionnet.apps.run_folder import FILES
from fusionnet.apps.run_record import RunRecord
from fusionnet.corpora import load_corpus
from fusionnet.policy import Answer, Policy, Pose

WEIGHTS = Path(str(resources.files("fusionnet"))) / "weights" / "compact"
SENTENCE = "put the red pyramid on the blue cube"
"""The first sentence of the examples' first scene."""

LAYOUT = {
    "blocks": [
        {"color": "red", "shape": "cube", "cell": [2, 2, 0]},
        {"color": "red", "shape": "cube", "cell": [5, 5, 0]},
        {"color": "green", "shape": "prism", "cell": [3, 4, 0]},
    ]
}


@pytest.fixture
def layout(tmp_path) -> Path:
    """A layout's file with two red cubes and a green pyramid."""
    file = tmp_path / "layout.json"
    file.write_text(json.dumps(LAYOUT))
    return file


@pytest.fixture(scope="module")
def printed() -> io.StringIO:
    """What the run of `shown` prints."""
    return io.StringIO()


@pytest.fixture(scope="module")
def shown(tmp_path_factory, printed) -> Path:
    """The folder of one successful run on the first example."""
    out = tmp_path_factory.mktemp("run") / "out"
    with contextlib.redirect_stdout(printed):
        assert main(["run", SENTENCE, "--policy", "symbolic", "--out", str(out)]) == 0
    return out


def test_the_example_has_this_sentence() -> None:
    assert any(c.sentence == SENTENCE and c.scene.id == 1 for c in load_corpus("examples").commands)


def test_a_run_leaves_everything(shown) -> None:
    assert sorted(f.name for f in shown.iterdir()) == sorted([*FILES, "result.json"])
    assert [f.name for f in shown.parent.iterdir()] == ["out"]
    for name in ("picture.png", "boxes.png", "tree.png"):
        with Image.open(shown / name) as picture:
            picture.load()
            assert picture.width >= 900
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(shown / "episode.mp4"))
    assert frames > 50 and seconds > 2
    tree = (shown / "tree.txt").read_text()
    assert SENTENCE in tree and "(event: (action: move (token: 1))" in tree
    joints = json.loads((shown / "joint_angles.json").read_text())
    assert len(joints["grasp"]) == len(joints["place"]) == len(joints["joints"]) == 6
    assert joints["units"] == ["rad"] * 6


def test_its_result_tells_what_happened(shown) -> None:
    result = json.loads((shown / "result.json").read_text())
    assert result["success"] is True and result["reference"] == "recorded"
    assert result["exit_status"] == 0 and result["verdict"].startswith("Reached")
    assert result["words"] == SENTENCE.split()
    assert len(result["layout_before"]["blocks"]) == len(result["layout_expected"]["blocks"]) == 7
    assert result["answer"]["symbolic_move"]["target"] == [4, 3, 1]
    assert set(result["files"]) == set(FILES)


def test_its_page_stands_alone(shown) -> None:
    html = (shown / "index.html").read_text(encoding="utf-8")
    references = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert references and all(r.startswith(("data:", "#")) for r in references)
    assert (
        "<script" not in html
        and "@import" not in html
        and "url(" not in re.sub(r"url\(#\w+\)", "", html)
    )
    assert SENTENCE in html and "data:video/mp4;base64," in html and "data:image/webp" in html
    for heading in ("saw", "did", "understood", "board", "looked", "answered"):
        assert re.search(rf"<h2>[^<]*{heading}[^<]*</h2>", html)
    marked = set(re.findall(r"<mark [^>]*>(\w+)</mark>", html))
    assert marked == {"put", "red", "pyramid", "on", "blue", "cube"}
    assert "prefers-color-scheme: dark" in html


def test_the_summary_says_what_it_saw_understood_and_did(shown, printed) -> None:
    text = printed.getvalue()
    for word in ("saw", "understood", "planned", "answered", "grasp", "place", "did", "index.html"):
        assert word in text
    assert "red pyramid" in text and "Reached" in text


def test_values_of_sliding_joints_are_no_angles() -> None:
    poses = {"grasp": Pose(np.full(3, 0.0125), 0.0), "place": Pose(np.zeros(3), 0.0)}
    page = answered(Mock(spec=RunRecord, robot="gantry", answer=Mock(spec=Answer, **poses)))
    assert page.count("12.5 mm") == 3 and "\N{DEGREE SIGN}" not in page


def test_json_is_one_object_and_nothing_else(capfd, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    status = main(["run", SENTENCE, "--json"])
    captured = capfd.readouterr()
    result = json.loads(captured.out)
    assert result["policy"] == "fusion" and result["exit_status"] == status
    assert status == (0 if result["success"] else 1)
    assert captured.err == "" and list(tmp_path.iterdir()) == []


def test_a_random_scene_depends_on_its_seed(capsys) -> None:
    assert main(["run", SENTENCE, "--seed", "24", "--policy", "symbolic", "--json"]) in (0, 1)
    result = json.loads(capsys.readouterr().out)
    assert result["origin"] == "random, seed 24" and result["reference"] == "understood"


def test_a_layout_of_ones_own(layout, capsys) -> None:
    words = ["run", "take the green pyramid", "--layout", str(layout), "--policy", "symbolic"]
    assert main([*words, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["reference"] == "understood" and result["success"] is True
    assert result["answer"]["symbolic_move"]["source"] == [3, 4, 0]


def test_a_picture_has_no_truth_to_compare_with(shown, capsys) -> None:
    words = ["run", SENTENCE, "--image", str(shown / "picture.png"), "--policy", "symbolic"]
    assert main([*words, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["success"] is None and result["reference"] is None
    assert result["layout_before_is_read_from_the_picture"] is True
    assert result["verdict"].startswith("Done, with nothing to compare it with")


def test_a_picture_of_another_aspect_is_not_stretched(shown, tmp_path, capsys) -> None:
    with Image.open(shown / "picture.png") as picture:
        width, height = picture.size
        square = Image.new("RGB", (width, width), (90, 90, 90))
        square.paste(picture.convert("RGB"), (0, 0))
    square.save(tmp_path / "square.png")
    words = ["run", SENTENCE, "--image", str(tmp_path / "square.png"), "--json"]
    assert height < width and main(words) == 2
    assert "shows no board" in capsys.readouterr().err  # the eye sees the table elsewhere
    square.crop((0, 0, int(0.9 * width), height)).save(tmp_path / "cropped.png")
    words[3] = str(tmp_path / "cropped.png")
    assert main(words) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["verdict"].startswith("Done, with nothing to compare it with")


def test_a_miss_is_status_1(monkeypatch, capsys) -> None:
    answer_as_trained = Policy.__call__

    def astray(self, image, sentence):
        answer = answer_as_trained(self, image, sentence)
        place = replace(answer.place, joint_angles=self.robot.joint_angles((7, 7, 0)))
        return replace(answer, place=place)

    monkeypatch.setattr(Policy, "__call__", astray)
    assert main(["run", SENTENCE, "--policy", "symbolic", "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["success"] is False and result["verdict"].startswith("Missed: ")


def test_a_refusal_of_what_is_known_to_be_possible_is_status_1(monkeypatch, capsys) -> None:
    from fusionnet.errors import PlanningError

    def refuse(self, image, sentence):
        raise PlanningError("There is no red pyramid here.")

    monkeypatch.setattr(Policy, "__call__", refuse)
    assert main(["run", SENTENCE, "--json"]) == 1
    assert main(["run", "take the red pyramid which is not recorded", "--json"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("fusionnet: Missed: the arm did not move. There is no red")


def written(tmp_path: Path, name: str, content: str | bytes) -> str:
    file = tmp_path / name
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return str(file)


def with_block(**changes) -> str:
    return json.dumps({"blocks": [{"color": "red", "shape": "cube", "cell": [2, 2, 0]} | changes]})


def picture_of(side: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((side, side, 3), np.uint8)).save(buffer, "png")
    return buffer.getvalue()


BAD_INPUTS = {
    "empty sentence": lambda t: [""],
    "blank sentence": lambda t: [" \n "],
    "endless sentence": lambda t: ["put the red cube on " * 50],
    "German": lambda t: ["Stelle die rote Pyramide auf den blauen Würfel"],
    "Chinese": lambda t: ["把红色的方块放在蓝色的方块上"],
    "no command": lambda t: ["the weather is nice today"],
    "no such block": lambda t: ["take the cyan pyramid", "--layout", layout_in(t)],
    "several blocks": lambda t: ["take the red cube", "--layout", layout_in(t)],
    "layout is missing": lambda t: [SENTENCE, "--layout", str(t / "nowhere.json")],
    "layout is not JSON": lambda t: [SENTENCE, "--layout", written(t, "a.json", "{blocks: 3")],
    "layout off the grid": lambda t: [
        SENTENCE, "--layout", written(t, "a.json", with_block(cell=[2, 8, 0]))
    ],
    "layout overlaps": lambda t: [
        SENTENCE, "--layout", written(t, "a.json", json.dumps({"blocks": LAYOUT["blocks"][:1] * 2}))
    ],
    "layout floats": lambda t: [
        SENTENCE, "--layout", written(t, "a.json", with_block(cell=[2, 2, 3]))
    ],
    "layout of unknown color": lambda t: [
        SENTENCE, "--layout", written(t, "a.json", with_block(color="rod"))
    ],
    "picture is missing": lambda t: [SENTENCE, "--image", str(t / "nowhere.png")],
    "picture is none": lambda t: [SENTENCE, "--image", written(t, "a.png", "hello")],
    "picture of 1x1": lambda t: [SENTENCE, "--image", written(t, "a.png", picture_of(1))],
    "picture without a board": lambda t: [
        SENTENCE, "--image", written(t, "a.png", picture_of(200))
    ],
    "picture for two eyes": lambda t: [
        SENTENCE, "--image", written(t, "a.png", picture_of(200)), "--eyes", "both"
    ],
    "two worlds": lambda t: [SENTENCE, "--scene", "1", "--layout", layout_in(t)],
    "unknown scene": lambda t: [SENTENCE, "--scene", "1000"],
    "which scene": lambda t: [SENTENCE, "--corpus", "treebank"],
    "corpus without a scene": lambda t: [
        SENTENCE, "--corpus", "treebonk", "--data", "here", "--seed", "3"
    ],
    "unknown corpus": lambda t: [SENTENCE, "--scene", "1", "--corpus", "treebonk"],
    "corpus without data": lambda t: [SENTENCE, "--scene", "1", "--corpus", "treebank"],
    "corpus elsewhere": lambda t: [
        SENTENCE, "--scene", "1", "--corpus", "treebank", "--data", str(t)
    ],
    "unknown policy": lambda t: [SENTENCE, "--policy", "fusoin"],
    "unknown checkpoint": lambda t: [SENTENCE, "--checkpoint", "compat"],
    "checkpoint is missing": lambda t: [SENTENCE, "--checkpoint", str(t / "nowhere")],
    "checkpoint is empty": lambda t: [SENTENCE, "--checkpoint", str(t)],
    "checkpoint is cut short": lambda t: [SENTENCE, "--checkpoint", cut_short(t)],
    "checkpoint of another version": lambda t: [SENTENCE, "--checkpoint", of_version_0(t)],
    "output is a file": lambda t: [SENTENCE, "--out", written(t, "out", "mine")],
    "output holds other files": lambda t: [SENTENCE, "--out", str(Path(layout_in(t)).parent)],
    "output cannot be made": lambda t: [SENTENCE, "--out", "/dev/null/out"],
}  # fmt: skip


def layout_in(folder: Path) -> str:
    return written(folder, "layout.json", json.dumps(LAYOUT))


def cut_short(folder: Path) -> str:
    copy = folder / "policy"
    shutil.copytree(WEIGHTS, copy)
    weights = copy / "detector" / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:5000])
    return str(copy)


def of_version_0(folder: Path) -> str:
    copy = folder / "policy"
    shutil.copytree(WEIGHTS, copy)
    config = copy / "translator" / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"schema_version": 0}))
    return str(copy)


def test_every_bad_input_gets_one_clear_line_and_status_2(tmp_path, capsys, golden) -> None:
    lines = []
    for number, (name, arguments) in enumerate(BAD_INPUTS.items()):
        folder = tmp_path / f"case{number}"
        folder.mkdir()
        words = arguments(folder)
        if "--out" not in words:
            words = [*words, "--out", str(folder / "out")]
        before = sorted(folder.rglob("*"))
        status = main(["run", *words])
        captured = capsys.readouterr()
        assert status == 2, f"{name}: {captured.err}"
        assert captured.out == "", name
        assert captured.err.startswith("fusionnet: "), name
        assert captured.err.count("\n") == 1 and "Traceback" not in captured.err, name
        assert sorted(folder.rglob("*")) == before, f"{name}: something was written"
        lines.append(f"{name}: {captured.err.strip()}".replace(str(folder), "FOLDER"))
    golden("bad_inputs.txt", "\n".join(lines) + "\n")


def fusionnet(*words: str, **options) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    code = "import sys; from fusionnet.apps.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=200, **options)


def test_no_egl_is_one_line_with_a_remedy(tmp_path) -> None:
    nowhere = {"__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path), "MUJOCO_GL": "egl"}
    ran = fusionnet("run", SENTENCE, "--json", env={**os.environ, **nowhere})
    assert ran.returncode == 2 and ran.stdout == ""
    assert ran.stderr.count("\n") == 1 and "apt install" in ran.stderr


def test_a_missing_backend_is_one_line_with_a_remedy() -> None:
    nowhere = {"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "osmesa"}
    ran = fusionnet("run", SENTENCE, "--json", env={**os.environ, **nowhere})
    if ran.returncode == 0:
        pytest.skip("OSMesa is installed on this machine")
    assert ran.returncode == 2 and ran.stdout == ""
    assert ran.stderr.count("\n") == 1 and "apt install" in ran.stderr


def test_a_full_disk_leaves_nothing(tmp_path) -> None:
    def at_most_30_kilobytes_a_file() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))

    ran = fusionnet(
        "run", SENTENCE, "--policy", "symbolic", "--out", str(tmp_path / "out"),
        preexec_fn=at_most_30_kilobytes_a_file,
    )  # fmt: skip
    assert ran.returncode == 2 and ran.stdout == ""
    assert ran.stderr.startswith("fusionnet: Cannot write") and ran.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
