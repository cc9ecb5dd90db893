"""Where a policy's checkpoints come from, and which are refused."""

import json
import shutil
from pathlib import Path

import huggingface_hub
import numpy as np
import pytest

from fusionnet import load_policy, make_world
from fusionnet.corpora import load_corpus
from fusionnet.errors import CheckpointError, UnknownNameError
from fusionnet.policy import detector_folder, weights_folder

SENTENCE = "put the red pyramid on the blue cube"


@pytest.fixture
def copy(tmp_path):
    """The shipped policy in a folder that may be spoilt."""
    return Path(shutil.copytree(weights_folder("compact"), tmp_path / "mine"))


@pytest.fixture
def hub(copy, monkeypatch):
    """A hub that has one repository, `someone/arm`; remembers what it was asked for."""
    asked = []

    def snapshot_download(name, *, revision, allow_patterns):
        asked.append((name, sorted(allow_patterns)))
        if name != "someone/arm":
            raise OSError("404 Client Error\nrepository not found")
        return str(copy)

    monkeypatch.setattr(huggingface_hub, "snapshot_download", snapshot_download)
    return asked


def changed(folder: Path, part: str, **changes) -> None:
    """Overwrites what the configuration of a checkpoint says."""
    file = folder / part / "config.json"
    document = json.loads(file.read_text())
    inner = changes.pop("config", {})
    file.write_text(
        json.dumps(document | changes | {"config": document["config"] | inner}, indent=1)
    )


def test_a_policy_is_loaded_by_its_name_on_the_hub(hub):
    picture = make_world(layout=load_corpus("examples").commands[0].scene.before).image()
    answer = load_policy("someone/arm")(picture, SENTENCE)
    np.testing.assert_array_equal(answer.targets, load_policy("compact")(picture, SENTENCE).targets)
    (name, files), *_ = hub
    assert name == "someone/arm" and "fusion/model.safetensors" in files
    assert {Path(file).suffix for file in files} == {".json", ".safetensors", ".md"}
    assert (detector_folder("someone/arm") / "config.json").is_file()


def test_what_the_hub_does_not_have_is_said_in_one_line(hub):
    with pytest.raises(CheckpointError, match=r"someone/leg is no folder here.*404") as caught:
        load_policy("someone/leg")
    assert "\n" not in str(caught.value)
    with pytest.raises(UnknownNameError, match="hub name like owner/name"):
        load_policy("someone/arm/left")
    with pytest.raises(UnknownNameError, match="a folder that holds"):
        load_policy(Path("someone/arm"))


def test_a_policy_of_another_robot_is_refused_with_the_reason(copy):
    assert load_policy(copy, robot="nico").robot.name == "nico"
    with pytest.raises(CheckpointError, match=r"trained for the robot 'nico'.*to 'gantry'"):
        load_policy(copy, robot="gantry")
    changed(copy, "fusion", config={"robot": "pepper"})
    with pytest.raises(CheckpointError, match=r"'pepper', which is not here.*available: .*nico"):
        load_policy(copy)


def test_a_policy_of_other_joints_is_refused_with_the_reason(copy):
    joints = [f"r_joint_{number}" for number in range(6)]
    changed(copy, "fusion", config={"joint_names": joints})
    with pytest.raises(CheckpointError, match=r"knows the joints r_joint_0.*of another release"):
        load_policy(copy)


@pytest.mark.parametrize("part", ["detector", "translator", "fusion"])
def test_a_part_of_another_schema_is_refused_with_the_reason(copy, part):
    changed(copy, part, schema_version=2)
    with pytest.raises(CheckpointError, match=rf"{part} has schema version 2; this release reads"):
        load_policy(copy)


def test_a_part_of_another_kind_is_refused_with_the_reason(copy):
    shutil.rmtree(copy / "fusion")
    shutil.copytree(copy / "translator", copy / "fusion")
    with pytest.raises(CheckpointError, match=r"holds a 'translator', expected a 'fusionnet'"):
        load_policy(copy)
