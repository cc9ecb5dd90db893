"""`fusionnet simulate`: a scene's move, given values, a recorded episode, and what is refused."""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from fusionnet import robots
from fusionnet.apps.cli import main
from fusionnet.blocks import layout_from_json
from fusionnet.simulation import make_world, viewer

NICO = robots.load("nico")
LAYOUT = {
    "blocks": [
        {"color": "red", "shape": "cube", "cell": [2, 2, 0]},
        {"color": "green", "shape": "prism", "cell": [3, 4, 0]},
    ]
}


@pytest.fixture
def layout(tmp_path) -> str:
    file = tmp_path / "layout.json"
    file.write_text(json.dumps(LAYOUT))
    return str(file)


def simulated(capsys, *words: str) -> tuple[int, dict]:
    status = main(["simulate", *words, "--json"])
    return status, json.loads(capsys.readouterr().out)


def test_a_recorded_episode_replays_to_the_same_end(capsys, tmp_path) -> None:
    status, first = simulated(capsys, "--scene", "2")
    assert (status, first["success"], first["same_end_as_recorded"]) == (0, True, None)
    assert len(first["episode"]["targets"]) == 14
    file = tmp_path / "result.json"
    file.write_text(json.dumps(first))
    for path in (file, tmp_path):  # the file, or a run's folder
        status, again = simulated(capsys, str(path))
        assert (status, again["same_end_as_recorded"]) == (0, True)
        assert again["episode"] == first["episode"]
    first["episode"]["errors_mm"][0] += 5.0
    file.write_text(json.dumps(first))
    status, other = simulated(capsys, str(file))
    assert (status, other["success"], other["same_end_as_recorded"]) == (1, True, False)


def test_an_episode_that_looked_again_replays_to_the_same_end(capsys, tmp_path) -> None:
    _, first = simulated(capsys, "--scene", "2")
    shifts = {"grasp": np.array([0.002, 0.0, 0.0]), "place": np.array([0.0, -0.003, 0.0])}
    layouts = [layout_from_json(first[f"layout_{name}"]) for name in ("before", "expected")]
    episode = make_world(layout=layouts[0]).execute(
        first["episode"]["targets"], layouts[1], look_again=lambda phase, *_: shifts[phase]
    )
    assert "look" in [phase.name for phase in episode.phases] and episode.errors.max() > 2.0
    file = tmp_path / "result.json"
    file.write_text(json.dumps(first | {"episode": episode.as_json()}))
    _, again = simulated(capsys, str(file))
    assert again["same_end_as_recorded"] is True
    assert again["episode"] == episode.as_json()
    file.write_text(json.dumps(again | {"episode": episode.as_json() | {"corrections_m": [1]}}))
    assert main(["simulate", str(file)]) == 2
    assert "is no result of" in capsys.readouterr().err


def test_blocks_beside_their_cells_replay_to_the_same_end(capsys, tmp_path) -> None:
    _, first = simulated(capsys, "--scene", "2")
    assert first["episode"]["shifts_m"] == []
    layouts = [layout_from_json(first[f"layout_{name}"]) for name in ("before", "expected")]
    shifts = np.zeros((len(layouts[0].blocks), 2))
    covered = {block.cell[:2] for block in layouts[0].blocks if block.cell.z}
    alone = next(i for i, b in enumerate(layouts[0].blocks) if b.cell[:2] not in covered)
    shifts[alone] = 0.004, -0.007
    episode = make_world(layout=layouts[0], shifts=shifts).execute(
        first["episode"]["targets"], layouts[1]
    )
    np.testing.assert_allclose(episode.shifts, shifts, atol=1e-9)
    assert episode.errors[alone] == pytest.approx(1000 * np.hypot(*shifts[alone]), abs=0.1)
    file = tmp_path / "result.json"
    file.write_text(json.dumps(first | {"episode": episode.as_json()}))
    _, again = simulated(capsys, str(file))
    assert again["same_end_as_recorded"] is True
    assert again["episode"] == episode.as_json()
    for wrong, said in (([[1.0, 0.0]] * len(shifts), "out of its cell"), ([[0.0]], "is no result")):
        file.write_text(json.dumps(first | {"episode": episode.as_json() | {"shifts_m": wrong}}))
        assert main(["simulate", str(file)]) == 2
        assert said in capsys.readouterr().err


def test_given_cells_and_the_same_move_as_values_end_alike(capsys, layout) -> None:
    cells = ["--move", "2", "2", "0", "5", "6", "0", "--layout", layout]
    status, by_cells = simulated(capsys, *cells)
    assert (status, by_cells["success"]) == (0, True)
    angles = by_cells["episode"]["targets"]
    status, by_radians = simulated(capsys, "--values", *map(str, angles), "--layout", layout)
    assert (status, by_radians["success"]) == (0, None)  # nothing is known to be expected
    assert by_radians["episode"]["layout_after"] == by_cells["episode"]["layout_after"]
    degrees = [*np.degrees(angles[:6]), 0.0, *np.degrees(angles[7:13]), 0.0]
    assert main(["simulate", "--values", *map(str, degrees), "--degrees", "--layout", layout]) == 0
    text = capsys.readouterr().out
    assert f"{degrees[0]:.1f}\N{DEGREE SIGN}" in text and "by a point constraint" in text


def test_another_robot_does_it_too(capsys) -> None:
    status, result = simulated(capsys, "--robot", "gantry")
    assert (status, result["success"], len(result["episode"]["targets"])) == (0, True, 8)


def test_a_film_is_made_of_the_recorded_states(capsys, tmp_path, monkeypatch) -> None:
    films = []
    monkeypatch.setattr("fusionnet.simulation.video.film", lambda *words: films.append(words))
    status, result = simulated(capsys, "--video", str(tmp_path / "film.mp4"))
    assert status == 0 and result["video"] == str(tmp_path / "film.mp4")
    ((recording, path, camera),) = films
    assert path == tmp_path / "film.mp4" and camera == "external"
    assert len(recording) == pytest.approx(25 * result["episode"]["seconds"], abs=2)


def values(count: int = 14, **changes: str) -> list[str]:
    angles = [f"{a:.4f}" for a in NICO.poses["ready"]]
    numbers = [*angles, "0", *angles, "0"][:count]
    for place, value in changes.items():
        numbers[int(place.removeprefix("v"))] = value
    return ["--values", *numbers]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (values(13), "needs 14 numbers"),
        (values(v3="nan"), "Joint 'l_elbow_y' was given nan; a finite number is needed"),
        (
            values(v10="2.0"),
            "Joint 'l_elbow_y' cannot go to 114.59\N{DEGREE SIGN}; its limits are -99.98",
        ),
        (values(v6="inf"), "gripper value is not finite"),
        ("--move 0 0 0 8 0 0".split(), "cannot reach (8, 0, 0)"),
        ("--move 0 0 7 1 0 0".split(), "no block at (0, 0, 7)"),
        (["nowhere.json"], "There is no file nowhere.json"),
        (["bad.json"], "bad.json is not JSON: Expecting"),
        (["other.json"], "other.json is no result of `fusionnet run`"),
        (["floats.json"], "floats"),
        (["nowhere.json", *values()], "RESULT and --values say two things"),
        (["bad.json", "--scene", "1"], "has its own scene; leave out --scene"),
        (["bad.json", "--corpus", "etr", "--data", "d"], "leave out --corpus, --data"),
        (["--degrees"], "Without --values --degrees would do nothing"),
        (["--scene", "1", "--seed", "1"], "--scene and --seed name two worlds"),
        (["--layout", "bad.json", "--seed", "1"], "--layout and --seed name two worlds"),
        (["--seed", "1"], "What is to be done there?"),
        (["--scene", "1000"], "No scene 1000"),
        (["--video", "film.gif"], "The film film.gif is an mp4; give it a name that ends in .mp4"),
        (["--robot", "nyco"], "No robot called 'nyco'"),
        (["--viewer"], "no display"),
    ],
)
def test_bad_input_gets_one_line_and_status_2(words, reason, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "bad.json").write_text("{,")
    (tmp_path / "other.json").write_text('{"robot": "nico"}')
    floating = {"blocks": [{"color": "red", "shape": "cube", "cell": [2, 2, 3]}]}
    document = {"robot": "nico", "episode": {}, "layout_before": floating}
    (tmp_path / "floats.json").write_text(json.dumps(document))
    assert main(["simulate", *words]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("fusionnet: ") and captured.err.count("\n") == 1
    assert reason in captured.err


def test_without_opengl_it_runs_and_only_films_are_refused(tmp_path) -> None:
    code = (
        "import sys; from fusionnet.apps.cli import main;"
        "sys.exit(10 * main(['simulate']) + main(['simulate', '--video', 'film.mp4']))"
    )
    environment = {**os.environ, "MUJOCO_GL": "disabled"}
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=tmp_path
    )
    assert ran.returncode == 2, ran.stderr
    assert "Reached" in ran.stdout and "MUJOCO_GL" in ran.stderr
    assert not list(tmp_path.iterdir())


def test_the_window_shows_the_world_until_the_end(monkeypatch, capsys) -> None:
    """With a stand-in for MuJoCo's window, which needs a display."""
    events = []

    class Lock:
        def __enter__(self):
            events.append("lock")

        def __exit__(self, *_):
            events.append("unlock")

    class Window:
        def __init__(self, model, data):
            import mujoco

            self.cam = mujoco.MjvCamera()
            self.user_scn = mujoco.MjvScene(model, maxgeom=1000)

        def lock(self):
            return Lock()

        def is_running(self):
            return True

        def sync(self):
            events.append("sync")

        def close(self):
            events.append("close")

    monkeypatch.setattr(viewer, "_open_window", Window)
    clock = SimpleNamespace(perf_counter=lambda: 1e9, sleep=lambda _: None)
    monkeypatch.setattr(viewer, "time", clock)
    status, result = simulated(capsys, "--viewer")
    assert status == 0
    assert events[-1] == "close"
    assert events.count("sync") == pytest.approx(25 * result["episode"]["seconds"], abs=2)
