"""The smaller commands: doctor, train, evaluate, robot. Their work is the library's."""

import json
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fusionnet.apps import doctor, evaluate, progress, train
from fusionnet.apps.cli import main
from fusionnet.errors import CheckpointError
from fusionnet.simulation import make_world
from fusionnet.views.picture_file import read_picture


@pytest.fixture
def commands(monkeypatch) -> list[list[str]]:
    """Commands that would have been run, instead of running them; sudo asks for a password."""
    issued: list[list[str]] = []

    def run(command, **_):
        issued.append(command)
        return SimpleNamespace(returncode=1 if command[0] == "sudo" and "true" in command else 0)

    monkeypatch.setattr(subprocess, "run", run)
    return issued


def test_the_doctor_finds_everything_in_order(capsys) -> None:
    assert main(["doctor", "--json"]) == 0
    checks = {check["name"]: check for check in json.loads(capsys.readouterr().out)["checks"]}
    assert {"Python", "packages", "rendering", "PyTorch", "weights", "disk"} <= set(checks)
    assert all(check["works"] is not False for check in checks.values())


def test_the_doctor_names_the_remedy_for_missing_egl(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", str(tmp_path))
    monkeypatch.setenv("MUJOCO_GL", "egl")
    check = doctor._rendering()
    assert check.works is False and "egl" in check.found
    assert check.remedy.count("\n") == 0 and "libegl1" in check.remedy


def test_the_doctor_finds_damaged_weights(monkeypatch, capsys) -> None:
    def damaged(name):
        raise CheckpointError("The weights are cut short.")

    monkeypatch.setattr("fusionnet.policy.load_policy", damaged)
    assert main(["doctor"]) == 1
    assert "cut short" in capsys.readouterr().out


def test_it_installs_as_root(commands, monkeypatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    doctor._install_renderer()
    assert [command[:2] for command in commands] == [["apt-get", "update"], ["apt-get", "install"]]
    assert set(doctor.EGL_PACKAGES) <= set(commands[1])


@pytest.mark.parametrize("present", [("apt-get",), ("sudo",), ("apt-get", "sudo")])
def test_it_installs_nothing_where_it_may_not(present, commands, monkeypatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setattr("shutil.which", lambda name: f"/bin/{name}" if name in present else None)
    doctor._install_renderer()
    assert not any("install" in command for command in commands)


def test_it_mends_only_what_is_broken(monkeypatch, capsys) -> None:
    monkeypatch.setattr(doctor, "_install_renderer", lambda: pytest.fail("nothing was broken"))
    monkeypatch.setattr(doctor, "_rendering", lambda: doctor.Check("rendering", True, "fake"))
    assert main(["doctor", "--mend"]) in (0, 1)
    assert "fake" in capsys.readouterr().out


@pytest.mark.parametrize("what", ["detector", "translator", "fusion"])
def test_training_prints_its_metrics(what, monkeypatch, capsys) -> None:
    def fake(config, *, progress, rendering=None):
        for callback in filter(None, (progress, rendering)):
            callback(1, 2)
        progress(2, 2, {"loss": 0.5})
        return {"seed": config.seed, "accuracy": 0.9}

    monkeypatch.setattr(train, f"train_{what}", fake)
    datasets = ["SET"] if what == "detector" else []
    assert main(["train", what, *datasets, "--seed", "3"]) == 0
    assert json.loads(capsys.readouterr().out) == {"seed": 3, "accuracy": 0.9}


def test_bars_are_silent_without_a_terminal(capfd) -> None:
    with progress.bars() as bar:
        bar("training")(1, 2, {"loss": 1.0})
    captured = capfd.readouterr()
    assert captured.out == "" and captured.err == ""


NUMBERS = {
    "n": 3,
    "executed_success": 2 / 3,
    "executed_success_95": [0.2, 0.94],
    "failures": [1] * 3,
}


@pytest.mark.parametrize("what", ["policy", "translator", "detector"])
def test_measurements_are_json_or_a_table(what, monkeypatch, capsys) -> None:
    def fake(config, **_):
        numbers = NUMBERS | ({"classes": {}} if what == "detector" else {})
        return numbers if what != "policy" else SimpleNamespace(as_json=lambda: numbers)

    name = {"policy": "policy", "translator": "translation", "detector": "detection"}[what]
    monkeypatch.setattr(evaluate, f"evaluate_{name}", fake)
    assert main(["evaluate", what, "--split", "val", "--json"]) == 0
    assert json.loads(capsys.readouterr().out).items() >= NUMBERS.items()
    assert main(["evaluate", what]) == 0
    table = capsys.readouterr().out
    assert "executed success" in table and "0.6667" in table and "0.2 to 0.94" in table


def test_measuring_without_the_corpus_is_one_line(capsys) -> None:
    assert main(["evaluate", "policy", "--episodes", "1"]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("fusionnet: The treebank is not part of this package")
    assert captured.err.count("\n") == 1 and captured.out == ""


def test_a_robot_looks_at_blocks(capsys, tmp_path) -> None:
    options = ["--out", str(tmp_path / "seen"), "--seed", "3", "--size", "128", "72"]
    assert main(["robot", "look", *options]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    pictures = {name: read_picture(Path(file)) for name, file in files.items()}
    assert set(pictures) == {"left_eye", "right_eye", "external"}
    world = make_world(seed=3)
    for name, picture in pictures.items():
        assert np.array_equal(picture, world.image(name, (128, 72)))


def test_a_picture_too_large_to_draw_is_one_line(capsys, tmp_path) -> None:
    assert main(["robot", "look", "--out", str(tmp_path), "--size", "9", "99999"]) == 2
    assert "1 to 4096 pixels; received 9 x 99999" in capsys.readouterr().err


def test_a_robots_table_is_measured(capsys) -> None:
    assert main(["robot", "table", "--check"]) == 0
    measured = json.loads(capsys.readouterr().out)
    assert measured["written"] is False and measured["largest_position_error_m"] < 1e-4
    assert len(measured["joints"]) == len(measured["largest_distance_to_a_cubic"]) == 6
