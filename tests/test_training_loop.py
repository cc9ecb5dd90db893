import json
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch

from fusionnet.apps.cli import main
from fusionnet.errors import CheckpointError, InputError
from fusionnet.training.loop import LoopConfig, fit
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.schedules import Schedule, ScheduleConfig


def _model() -> torch.nn.Module:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(3)
        return torch.nn.Sequential(
            torch.nn.Linear(4, 8), torch.nn.Tanh(), torch.nn.Dropout(0.1), torch.nn.Linear(8, 1)
        )


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
    base = {"steps": 60, "learning_rate": 0.02, "average": 0.9, "log_every": 15, "save_every": 20}
    return LoopConfig(**(base | {"tensorboard": False} | changes))


RECIPES = {
    "one-cycle with adamw": {},
    "steps with sgd": {
        "learning_rate": 0.01,
        "schedule": ScheduleConfig(kind="steps", milestones=(30, 50)),
        "optimizer": OptimizerConfig(kind="sgd", weight_decay=1e-4),
    },
    "inverse-root with adam": {
        "learning_rate": 0.3,
        "schedule": ScheduleConfig(kind="inverse-root", warm_up_steps=20),
        "optimizer": OptimizerConfig(kind="adam", weight_decay=0.0, beta_2=0.98, epsilon=1e-9),
    },
    "plateau with adam": {
        "schedule": ScheduleConfig(kind="plateau", check_every=7, patience=1, monitor="square"),
        "optimizer": OptimizerConfig(kind="adam", weight_decay=0.0),
        "average": 0.0,
    },
}


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_killed_run_resumes_to_the_same_losses_and_weights(tmp_path, recipe):
    whole, killed, config = _model(), _model(), _config(**RECIPES[recipe])
    expected = fit(whole, _batches, _losses, config, folder=tmp_path / "whole")
    assert expected[-1]["square"] < 0.7 * expected[0]["square"]

    def stop_after_45(step, steps, line):
        if step == 45:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(killed, _batches, _losses, config, folder=tmp_path / "killed", progress=stop_after_45)
    resumed = _model()
    lines = fit(resumed, _batches, _losses, config, folder=tmp_path / "killed")
    assert [line["step"] for line in lines] == [15, 30, 45, 60]
    for line, wanted in zip(lines, expected, strict=True):
        assert line["square"] == pytest.approx(wanted["square"], rel=1e-6)
        assert line["learning_rate"] == wanted["learning_rate"]
    written = (tmp_path / "killed" / "log.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in written] == lines
    assert fit(_model(), _batches, _losses, config, folder=tmp_path / "killed") == lines
    for name, value in whole.state_dict().items():
        torch.testing.assert_close(resumed.state_dict()[name], value)


def test_training_lowers_the_loss_and_logs_json_lines(tmp_path):
    history = fit(_model(), _batches, _losses, _config(tensorboard=True), folder=tmp_path)
    assert history[-1]["square"] < 0.5 * history[0]["square"]
    assert sum(file.stat().st_size for file in (tmp_path / "tensorboard").iterdir()) > 500
    written = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert written == history


def test_a_trained_model_is_brought_back_to_the_cpu():
    class Watched(torch.nn.Linear):
        events = ()

        def forward(self, x):
            self.events += ("learns",)
            return super().forward(x)

        def _apply(self, fn, recurse=True):
            self.events += (fn(torch.empty(0)).device.type,)
            return super()._apply(fn, recurse)

    model = Watched(4, 1)
    fit(model, _batches, _losses, _config(steps=2, accelerator="auto"))
    assert model.events[-2:] == ("learns", "cpu")
    assert model.weight.device.type == "cpu"


def test_the_seed_alone_decides_what_the_network_draws():
    logged = [
        fit(_model(), _batches, _losses, _config(steps=3, log_every=1), seed=seed)[-1]["loss"]
        for seed in (0, 0, 1)
    ]
    assert logged[0] == logged[1] != logged[2]


@pytest.mark.parametrize("preset", ["compact", "end-to-end", "thesis", "thesis-small"])
def test_there_is_one_seed_to_give(preset, capsys):
    dataset = [] if preset == "compact" else ["nowhere"]
    assert main(["train", "fusion", *dataset, "--preset", preset, "--loop.seed", "3"]) == 2
    assert "loop.seed" in capsys.readouterr().err


def test_a_loss_of_weight_zero_does_not_train():
    model = _model()
    before = {n: v.clone() for n, v in model.state_dict().items()}
    config = _config(
        steps=5,
        average=0.0,
        optimizer=OptimizerConfig(weight_decay=0.0),
        loss_weights={"square": 0.0, "size": 0.0},
    )
    fit(model, _batches, _losses, config)
    for name, value in model.state_dict().items():
        torch.testing.assert_close(value, before[name])


def test_a_damaged_state_is_named(tmp_path):
    (tmp_path / "state.safetensors").write_bytes(b"not a state")
    with pytest.raises(CheckpointError, match="Cannot resume from .*state.safetensors"):
        fit(_model(), _batches, _losses, _config(), folder=tmp_path)


def _rates(steps, **schedule):
    made = Schedule(ScheduleConfig(**schedule), peak=1.0, steps=steps)
    return [made.rate(step) for step in range(steps)]


def test_one_cycle_rises_and_falls():
    rates = _rates(100, warm_up=0.1)
    assert rates.index(max(rates)) in (9, 10)
    assert rates[0] == pytest.approx(0.1) and rates[-1] < 0.02


def test_the_thesis_divides_by_ten_at_each_milestone():
    rates = _rates(12, kind="steps", milestones=(4, 8))
    assert rates == pytest.approx([1.0] * 4 + [0.1] * 4 + [0.01] * 4)


def test_equation_4_1_peaks_at_the_end_of_its_warm_up():
    rates = _rates(100, kind="inverse-root", warm_up_steps=25)
    assert rates.index(max(rates)) == 24
    assert rates[24] == pytest.approx(25**-0.5) and rates[99] == pytest.approx(100**-0.5)


def test_a_plateau_lowers_the_rate_after_two_checks_in_a_row():
    schedule = Schedule(
        ScheduleConfig(kind="plateau", check_every=2, patience=2), peak=1.0, steps=99
    )
    rates = []
    for step, loss in enumerate([5, 5, 4, 4, 4, 4, 3, 3, 3, 3, 3, 3, 3, 3]):
        schedule.observe(step, {"loss": float(loss)})
        rates.append(schedule.rate(step))
    assert rates == pytest.approx([1.0] * 11 + [0.1] * 3)
    with pytest.raises(InputError, match="watches a loss 'loss'; there are: mse"):
        schedule.observe(14, {"mse": 1.0})


def test_settings_that_cannot_train_are_refused():
    with pytest.raises(ValueError, match="steps, devices"):
        LoopConfig(steps=0)
    with pytest.raises(ValueError, match="warm_up < 1"):
        ScheduleConfig(warm_up=1.0)
    with pytest.raises(ValueError, match="weight_decay >= 0"):
        OptimizerConfig(weight_decay=-1.0)


TRAINERS = {
    "detector": ["detector", "nowhere"],
    "thesis detector": ["detector", "nowhere", "--preset", "thesis"],
    "translator": ["translator"],
    "transformer": ["translator", "--preset", "thesis"],
    "fusion": ["fusion"],
    "thesis fusion": ["fusion", "nowhere", "--preset", "thesis-small"],
}


@pytest.mark.parametrize("trainer", TRAINERS)
def test_every_trainer_refuses_a_folder_of_other_files_at_its_start(
    trainer, tmp_path, monkeypatch, capsys
):
    (tmp_path / "README.md").write_text("mine")
    monkeypatch.chdir(tmp_path)
    assert main(["train", *TRAINERS[trainer], "--out", "."]) == 2
    assert "The folder . holds other files" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["README.md"]


@pytest.mark.parametrize(
    "wrong", [{"average": 2.0}, {"learning_rate": float("nan")}, {"clip": -1.0}, {"steps": 0}]
)
def test_numbers_that_cannot_train_are_refused(wrong):
    with pytest.raises(InputError, match="0 <= average < 1"):
        LoopConfig(**{"steps": 1, **wrong})


@pytest.mark.parametrize("wrong", [{"accelerator": "banana"}, {"precision": "foo"}])
def test_devices_that_are_not_there_are_refused_in_one_line(wrong):
    model = torch.nn.Linear(1, 1)
    with pytest.raises(InputError, match="Training cannot run with the accelerator"):
        fit(model, lambda first: iter(()), lambda *_: {}, LoopConfig(steps=1, **wrong))


@dataclass(frozen=True, kw_only=True)
class _Run:
    loop: LoopConfig
    batch: int = 4
    data: Path | None = None
    work: Path = Path("here")


def test_a_state_is_not_resumed_under_other_settings(tmp_path):
    config = _config(steps=2, save_every=1)
    fit(_model(), _batches, _losses, config, folder=tmp_path, settings=_Run(loop=config))
    longer = replace(config, steps=3)
    lines = fit(
        _model(),
        _batches,
        _losses,
        longer,
        folder=tmp_path,
        settings=_Run(loop=longer, work=tmp_path),
    )
    assert [line["step"] for line in lines] == [2, 3]
    others = {
        "batch": _Run(loop=longer, batch=5),
        "data": _Run(loop=longer, data=tmp_path),
        "loop.clip": _Run(loop=replace(longer, clip=0.5)),
    }
    for name, other in others.items():
        with pytest.raises(CheckpointError, match=f"a run with {name} .*another folder"):
            fit(_model(), _batches, _losses, other.loop, folder=tmp_path, settings=other)


def test_channels_may_lie_last_beside_filters_of_three_dimensions():
    pictures, grids = torch.nn.Conv2d(2, 4, 3), torch.nn.Conv3d(4, 3, 1)

    class Both(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.pictures, self.grids = pictures, grids

        def forward(self, x):
            return self.grids(self.pictures(x)[:, :, None]).square().mean()

    fit(
        Both(),
        lambda first: iter([torch.ones(1, 2, 5, 5)]),
        lambda model, batch: {"square": model(batch)},
        LoopConfig(steps=1, channels_last=True, tensorboard=False),
    )
    assert pictures.weight.is_contiguous(memory_format=torch.channels_last)
    assert not pictures.weight.is_contiguous() and grids.weight.is_contiguous()
