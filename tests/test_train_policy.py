"""One command trains a whole policy, and goes on where it was stopped."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fusionnet.errors import CheckpointError, DataError, InputError, OutputError
from fusionnet.models import policy_folder
from fusionnet.policy import load_policy
from fusionnet.training import fusion, policy
from fusionnet.training.loop import LoopConfig
from fusionnet.training.policy import PolicyConfig, train
from fusionnet.training.translator import TranslatorConfig
from tiny_treebank import write_tiny_treebank

ONE_STEP = LoopConfig(steps=1, learning_rate=1e-4, tensorboard=False)


def quiet(stage: str):  # type: ignore[no-untyped-def]
    return lambda *_: None


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PolicyConfig:
    monkeypatch.setattr(policy, "TranslatorConfig", partial(TranslatorConfig, invented=40))
    return PolicyConfig(
        out=tmp_path / "policy",
        work=tmp_path / "work",
        data=write_tiny_treebank(tmp_path / "corpus"),
        eye=4,
        right=2,
        drawn=2,
        views=2,
        rooms=2,
        read=2,
        batch=2,
        detector=ONE_STEP,
        detector_right=ONE_STEP,
        detector_views=ONE_STEP,
        translator=replace(ONE_STEP, loss_weights={"symbols": 1.0}),
        fusion=replace(ONE_STEP, loss_weights={"grasp": 1.0}),
    )


def test_every_part_is_trained_kept_and_joined(
    config: PolicyConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(fusion, "train", stopped)
        with pytest.raises(KeyboardInterrupt):
            train(config, quiet)
    assert not config.out.exists()
    kept = config.work / "detector/checkpoint/model.safetensors"
    written = kept.stat().st_mtime_ns
    metrics = train(config, quiet)
    assert kept.stat().st_mtime_ns == written
    eyes = {"detector", "detector-right", "detector-views"}
    assert set(metrics) == eyes | {"translator", "fusion"}
    assert policy_folder.view_detector_folder(config.out).name == "detector-views"
    loaded = load_policy(config.out)
    assert loaded.right is not None
    assert loaded.detector.see(np.zeros((540, 960, 3), np.uint8)).cells.shape == (8, 8, 8, 17)
    card = (config.out / "README.md").read_text()
    assert "detector-right" in card and "detector-views/README.md" in card
    assert json.loads((config.work / policy.SETTINGS_FILE).read_text())["eye"] == 4


def test_a_run_of_other_settings_is_not_gone_on_with(config: PolicyConfig) -> None:
    policy._same_settings(config)
    policy._same_settings(replace(config, workers=2, out=config.out / "other"))
    with pytest.raises(CheckpointError, match="a run with eye 4, not 5"):
        train(replace(config, eye=5), quiet)
    (config.work / policy.SETTINGS_FILE).write_text("{")
    with pytest.raises(CheckpointError, match="is damaged"):
        train(config, quiet)


def test_a_part_that_was_finished_with_other_steps_is_not_taken(config: PolicyConfig) -> None:
    part = config.work / "detector-right/checkpoint/config.json"
    part.parent.mkdir(parents=True)
    part.write_text(json.dumps({"metadata": {"training": {"loop": {"steps": 9}}}}))
    with pytest.raises(CheckpointError, match="with 9 steps, not 1. Give --detector-right.steps 9"):
        train(config, quiet)
    assert not (config.work / "pictures-eye").exists()


def test_bad_numbers_and_folders_are_refused(config: PolicyConfig) -> None:
    with pytest.raises(InputError, match="at least 1"):
        replace(config, eye=0)
    with pytest.raises(DataError, match="--data DIR"):
        train(replace(config, data=None), quiet)
    with pytest.raises(InputError, match="no training groups"):
        train(replace(config, corpus="examples"), quiet)
    assert not config.work.exists()
    with pytest.raises(InputError, match="0 for none"):
        replace(config, right=-1)
    with pytest.raises(InputError, match="on one device"):
        replace(config, detector=replace(ONE_STEP, devices=2))
    config.out.mkdir()
    (config.out / "mine").write_text("")
    with pytest.raises(OutputError, match="holds files already"):
        train(config, quiet)
