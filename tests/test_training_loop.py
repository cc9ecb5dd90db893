import json

import pytest
import torch

from fusionnet.errors import CheckpointError
from fusionnet.training.loop import LoopConfig, fit


def _model() -> torch.nn.Module:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(3)
        return torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1))


def _batches(first):
    step = first
    while True:
        generator = torch.Generator().manual_seed(step)
        x = torch.randn(16, 4, generator=generator)
        yield x, x.sum(dim=1, keepdim=True)
        step += 1


def _losses(model, batch):
    x, y = batch
    error = model(x) - y
    return {"square": (error**2).mean(), "size": 0.01 * error.abs().mean()}


def _config(**changes) -> LoopConfig:
    base = {"steps": 60, "learning_rate": 0.02, "average": 0.9, "log_every": 10, "save_every": 20}
    return LoopConfig(**(base | changes))


def test_a_killed_run_resumes_to_the_same_losses_and_weights(tmp_path):
    whole, killed = _model(), _model()
    expected = fit(whole, _batches, _losses, _config(), folder=tmp_path / "whole")

    def stop_after_45(step, steps, line):
        if step == 45:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(
            killed, _batches, _losses, _config(), folder=tmp_path / "killed", progress=stop_after_45
        )
    resumed = _model()
    lines = fit(resumed, _batches, _losses, _config(), folder=tmp_path / "killed")
    assert [line["step"] for line in lines] == [50, 60]
    for line, wanted in zip(lines, expected[-2:], strict=True):
        assert line["square"] == pytest.approx(wanted["square"], rel=1e-6)
    for name, value in whole.state_dict().items():
        torch.testing.assert_close(resumed.state_dict()[name], value)


def test_training_lowers_the_loss_and_logs_json_lines(tmp_path):
    history = fit(_model(), _batches, _losses, _config(), folder=tmp_path)
    assert history[-1]["square"] < 0.3 * history[0]["square"]
    written = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert written == history


def test_a_loss_of_weight_zero_does_not_train():
    model = _model()
    before = {n: v.clone() for n, v in model.state_dict().items()}
    config = _config(
        steps=5, average=0.0, weight_decay=0.0, loss_weights={"square": 0.0, "size": 0.0}
    )
    fit(model, _batches, _losses, config)
    for name, value in model.state_dict().items():
        torch.testing.assert_close(value, before[name])


def test_a_damaged_state_is_named(tmp_path):
    (tmp_path / "state.safetensors").write_bytes(b"not a state")
    with pytest.raises(CheckpointError, match="Cannot resume from .*state.safetensors"):
        fit(_model(), _batches, _losses, _config(), folder=tmp_path)


def test_the_schedule_rises_and_falls():
    config = LoopConfig(steps=100, learning_rate=1.0, warm_up=0.1)
    rates = [config.rate_at(step) for step in range(100)]
    assert rates.index(max(rates)) in (9, 10)
    assert rates[0] == pytest.approx(0.1) and rates[-1] < 0.02


def test_settings_that_cannot_train_are_refused():
    with pytest.raises(ValueError, match="steps >= 1"):
        LoopConfig(steps=0)
