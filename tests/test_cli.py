"""The command line itself: help texts, unknown words, exit statuses, and how fast it answers."""

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass

import pytest

from fusionnet.apps import cli
from fusionnet.errors import InputError


@dataclass(frozen=True, kw_only=True)
class FakeConfig:
    """Options of a made-up command."""

    answer: int = 42
    """What to return."""


def give(config: FakeConfig) -> int:
    """Return a number."""
    return config.answer


def measure(config: FakeConfig) -> dict[str, int]:
    """Return a metric."""
    return {"answer": config.answer}


def refuse(config: FakeConfig) -> None:
    raise InputError("The answer\n  is wrong.")


def break_down(config: FakeConfig) -> None:
    raise RuntimeError("an invariant does not hold")


@pytest.fixture
def made_up(monkeypatch):
    for function in (give, measure, refuse, break_down):
        name = function.__name__.replace("_", " ")
        entry = cli.Entry("made up", f"{__name__}:{function.__name__}")
        monkeypatch.setitem(cli.COMMANDS, name, entry)


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"], ["help"]])
def test_help_is_the_golden_text(words, capsys, golden) -> None:
    assert cli.main(words) == 0
    captured = capsys.readouterr()
    golden("help.txt", captured.out)
    assert captured.err == ""


def test_version(capsys) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("fusionnet 0.")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rnu", "x"], "no command called 'rnu'; available: run, translate, simulate, doctor, "),
        (["train"], "train what?; available: policy, detector, translator, fusion."),
        (
            ["train", "detectr"],
            "cannot train 'detectr'; available: policy, detector, translator, fusion. ",
        ),
        (["evaluate", "--json"], "evaluate what?; available: policy, translator, detector."),
    ],
)
def test_unknown_commands_get_one_line(words, message, capsys) -> None:
    assert cli.main(words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"fusionnet: {message}")
    assert captured.err.count("\n") == 1


def test_a_near_miss_is_named(capsys) -> None:
    cli.main(["rnu"])
    assert capsys.readouterr().err.endswith("Did you mean 'run'?\n")


def test_a_number_is_the_exit_status(made_up, capsys) -> None:
    assert cli.main(["give", "--answer", "1"]) == 1
    assert capsys.readouterr().out == ""


def test_a_metric_is_printed_as_json(made_up, capsys) -> None:
    assert cli.main(["measure"]) == 0
    assert json.loads(capsys.readouterr().out) == {"answer": 42}


def test_a_mistake_of_the_users_gets_one_line_and_status_2(made_up, capsys) -> None:
    assert cli.main(["refuse"]) == 2
    assert capsys.readouterr().err == "fusionnet: The answer is wrong.\n"


def test_a_bug_of_ours_gets_a_traceback_and_status_3(made_up, capsys) -> None:
    assert cli.main(["break", "down"]) == 3
    error = capsys.readouterr().err
    assert "Traceback" in error and "please report it" in error


@pytest.mark.parametrize("option", ["--nonsense", "--answer=many"])
def test_an_unknown_option_is_status_2(option, made_up, capsys) -> None:
    assert cli.main(["give", option]) == 2
    assert "Traceback" not in capsys.readouterr().err


@dataclass(frozen=True, kw_only=True)
class OtherConfig(FakeConfig):
    """Options of the same command under another preset."""

    answer: int = 7


FAKE_PRESETS = {"plain": FakeConfig, "other": OtherConfig}


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ([], 42),
        (["--preset", "other"], 7),
        (["--preset=other", "--answer", "5"], 5),
        (["--answer", "5", "--preset", "plain"], 5),
    ],
)
def test_a_preset_chooses_the_options(words, status, monkeypatch) -> None:
    entry = cli.Entry("made up", f"{__name__}:give", "FAKE_PRESETS")
    monkeypatch.setitem(cli.COMMANDS, "give", entry)
    assert cli.main(["give", *words]) == status


def test_an_unknown_preset_gets_one_line(monkeypatch, capsys) -> None:
    entry = cli.Entry("made up", f"{__name__}:give", "FAKE_PRESETS")
    monkeypatch.setitem(cli.COMMANDS, "give", entry)
    assert cli.main(["give", "--preset", "othr"]) == 2
    assert "available: plain, other. Did you mean 'other'?" in capsys.readouterr().err
    assert cli.main(["give", "--preset"]) == 2


def test_every_command_exists_and_has_one_typed_configuration() -> None:
    import dataclasses
    import importlib
    import typing

    for entry in cli.COMMANDS.values():
        module, _, name = entry.function.partition(":")
        function = getattr(importlib.import_module(module), name)
        config = typing.get_type_hints(function)["config"]
        kinds = typing.get_args(config) or (config,)
        assert all(dataclasses.is_dataclass(kind) for kind in kinds), entry
        if entry.presets:
            presets = getattr(importlib.import_module(module), entry.presets)
            assert set(presets.values()) == set(kinds)
        assert function.__doc__, entry


def test_help_needs_no_torch_and_half_a_second() -> None:
    code = (
        "import sys, time; begin = time.process_time(); from fusionnet.apps.cli import main; "
        "main(['--help']); print(time.process_time() - begin, *sys.modules, file=sys.stderr)"
    )
    clean = {**os.environ, "PYTHONPATH": ""}
    begin = time.perf_counter()
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=clean)
    wall = time.perf_counter() - begin
    seconds, *modules = ran.stderr.split()
    assert ran.returncode == 0
    assert not {"torch", "mujoco", "tyro", "matplotlib"} & set(modules)
    assert float(seconds) < 0.5
    assert wall < 5.0  # generous: the machine may be busy


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("simulate --values foo bar", "--values: expected [FLOAT [FLOAT ...]], got 'foo', 'bar'."),
        ("simulate --move 1 2 x", "--move: expected INT INT INT INT INT INT, got '1', '2', 'x'."),
        ("simulate --valeus 1", "Unrecognized options: --valeus, 1. Did you mean '--values'?"),
        ("run", "Missing from fusionnet run: SENTENCE."),
        ("run hello --seed x", "--seed: expected INT, got 'x'."),
        ("run hello --seed", "Missing value for argument '--seed'. Expected 1 values."),
        ("run hello --eyes third", "Invalid choice 'third' for argument '--eyes'."),
        ("train fusion --batch 0", "batch, threads and pictures are at least 1; received 0"),
        ("train detector", "At least one data set"),
        ("corpus show one", "expected INT, got 'one'."),
    ],
)
def test_what_is_wrong_with_options_is_said_in_one_line(words, said, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    command = words.partition(" --")[0].removesuffix(" hello").removesuffix(" one")
    assert cli.main(words.split()) == cli.EXIT_BAD_INPUT
    out, err = capsys.readouterr()
    assert err.startswith("fusionnet: ") and err.count("\n") == 1 and not out
    assert said in err and err.endswith(f"See `fusionnet {command} --help`.\n")
    assert os.environ["COLUMNS"] == "40"
