"""Options that cannot be meant, and folders that cannot be written: one line, before any work."""

import pytest

from fusionnet.apps.cli import main

TRAIN = ["train", "translator", "--corpus", "synthetic"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([*TRAIN, "--batch", "0"], "batch is at least 1"),
        ([*TRAIN, "--invented", "-1"], "invented at least 0; received 64 and -1"),
        ([*TRAIN, "--invented-share", "2"], "go from 0 to 1; received 2.0"),
        ([*TRAIN, "--augmentation.slips", "-0.1"], "augmentation.slips goes from 0 to 1"),
        (["evaluate", "translator", "--beam", "0"], "beam goes from 1 to 100"),
        (["evaluate", "translator", "--perturbations", "9"], "received 10, 9 and 0"),
        (["translate", "take the red cube", "--beam", "0"], "A beam is 1 to 100 wide"),
        (["robot", "table", "--check", "--rounds", "9"], "--rounds would do nothing"),
        (
            ["robot", "look", "--out", "O", "--layout", "L", "--seed", "1"],
            "--layout and --seed name two worlds",
        ),
        (["train", "fusion", "--pictures", "0"], "pictures are at least 1; received 64, 1 and 0"),
    ],
)
def test_an_option_out_of_range_is_one_line(arguments, said, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        TRAIN,
        ["train", "fusion", "--corpus", "examples"],
        ["train", "policy", "--corpus", "examples"],
        ["train", "detector", "SET"],
        ["train", "detector", "SET", "--preset", "thesis"],
        ["train", "translator", "--preset", "thesis", "--corpus", "synthetic"],
        ["train", "fusion", "SET", "--preset", "thesis-small"],
        ["train", "fusion", "SET", "--preset", "end-to-end"],
        ["reproduce", "anchors", "--scale", "smoke"],
    ],
)
def test_a_work_folder_that_is_a_file_is_one_line(arguments, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    options = ["--work", str(tmp_path / "file" / "work")]
    options += (
        ["--results", str(tmp_path / "results")]
        if arguments[0] == "reproduce"
        else ["--out", str(tmp_path / "out")]
    )
    assert main([*arguments, *options]) == 2
    error = capsys.readouterr().err
    assert f"{tmp_path / 'file'} is a file" in error and error.count("\n") == 1
    assert (tmp_path / "file").read_text() == "mine" and not (tmp_path / "out").exists()
