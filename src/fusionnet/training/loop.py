"""The one training loop: steps over batches, a schedule, a journal, checkpoints, resume.

It runs on Lightning Fabric, so the same lines train on a CPU, one GPU or several.
A model brings its own losses as a named dictionary; a weighting makes one gradient of
them, the loop steps the optimiser, and writes one JSON line every few steps.
"""

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning.fabric import Fabric
from lightning.fabric.utilities.exceptions import MisconfigurationException

from fusionnet.errors import InputError
from fusionnet.randomness import derived_seed
from fusionnet.training import weightings
from fusionnet.training.journal import Journal, LogLine, read_lines
from fusionnet.training.optimizers import OptimizerConfig, new_optimizer
from fusionnet.training.schedules import Schedule, ScheduleConfig
from fusionnet.training.state import check_settings, load_state, save_state, settings_of
from fusionnet.training.weightings import GradientWeighting, Weighting

log = logging.getLogger(__name__)

Losses = Callable[[torch.nn.Module, Any], Mapping[str, torch.Tensor]]
Progress = Callable[[int, int, LogLine], None]


@dataclass(frozen=True, kw_only=True)
class LoopConfig:
    """How to train.

    Attributes:
        steps: Optimiser steps in all.
        learning_rate: Peak of the schedule.
        schedule: How the learning rate rises and falls.
        optimizer: Which optimiser, and its own numbers.
        clip: Greatest norm of the gradient; 0 turns it off.
        loss_weights: Fixed factor of each named loss; 1 where none is given. A loss with the
            factor 0 is not learnt from.
        weighting: Name in `training.weightings`: how one gradient is made of the losses. Those
            that look at gradients train on one device, in full precision.
        primary: The loss that a weighting with priorities ("primary") puts first.
        average: Decay of the exponential moving average of the weights; 0 turns it off.
        precision: Fabric's name, "32-true" or "bf16-mixed"; "auto" is the second on a GPU that
            computes with it, and else the first.
        channels_last: Whether pictures and filters lie with their channels side by side, which
            is faster for convolutions on most machines.
        accelerator: Fabric's name: "auto", "cpu", "cuda".
        devices: How many devices; each takes its own batches.
        log_every: Steps between lines of the log.
        save_every: Steps between resumable states.
        tensorboard: Whether to write the log for TensorBoard as well.
    """

    steps: int
    learning_rate: float = 1e-3
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)
    clip: float = 1.0
    loss_weights: Mapping[str, float] = field(default_factory=dict)
    weighting: str = "fixed"
    primary: str = ""
    average: float = 0.0
    precision: str = "32-true"
    channels_last: bool = False
    accelerator: str = "cpu"
    devices: int = 1
    log_every: int = 50
    save_every: int = 500
    tensorboard: bool = True

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        counts = (self.steps, self.devices, self.log_every, self.save_every)
        rates = (self.learning_rate, self.clip, self.average)
        fits = np.isfinite(rates).all() and self.learning_rate > 0 and 0 <= self.average < 1
        factors = list(self.loss_weights.values())
        fits = fits and np.isfinite(factors).all() and min(factors, default=0.0) >= 0.0
        if min(counts) < 1 or not fits or self.clip < 0:
            raise InputError(
                "steps, devices, log_every and save_every >= 1, learning_rate > 0, clip >= 0, "
                f"0 <= average < 1, loss_weights of at least 0; got {self}"
            )


def fit(
    model: torch.nn.Module,
    batches: Callable[[int], Iterator[Any]],
    losses: Losses,
    config: LoopConfig,
    *,
    folder: Path | None = None,
    settings: Any = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[LogLine]:
    """Train a model in place and return the lines of its log; the model is on the CPU after it.

    Args:
        model: What to train; holds the averaged weights at the end if averaging is on.
        batches: Given a first step, the batches from that step on (so that a resumed
            run sees the data that the killed one would have seen).
        losses: The model and a batch to named scalar losses.
        config: How to train.
        folder: Where the log and the resumable state go; a state found there is resumed.
        settings: The run's configuration, a dataclass, so that a state is not resumed under
            another; how long it goes on, where and what it logs may change.
        seed: Source of what the network itself draws while it trains (dropout).
        progress: Called after every step with step, steps and the latest log line.

    Returns:
        One dictionary a log line: step, seconds, learning rate, mean of every loss; those of
        the resumed run come first, as if it had never been killed.

    Raises:
        InputError: If there is no such device or precision here, if the weighting does not go
            with it or with the losses, or if a loss is no number any more.
        CheckpointError: If the state in `folder` is damaged, or of another model or run.
    """
    # A parameter need not take part in every batch: a relation that no sentence speaks of.
    precision: Any = precision_of(config)  # Fabric itself knows which names there are
    try:
        fabric = Fabric(
            accelerator=config.accelerator,
            strategy="ddp_find_unused_parameters_true" if config.devices > 1 else "auto",
            devices=config.devices,
            precision=precision,
        )
    except (ValueError, RuntimeError, MisconfigurationException) as error:
        raise InputError(
            f"Training cannot run with the accelerator {config.accelerator!r}, {config.devices} "
            f"devices and the precision {config.precision!r}: {error}"
        ) from None
    fabric.launch()
    if config.channels_last:  # of filters of pictures, not of those of three dimensions
        for parameter in model.parameters():
            if parameter.dim() == 4:
                parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)
    model.to(fabric.device)
    weighting = _new_weighting(config).to(fabric.device)
    optimizer = new_optimizer(config.optimizer, model, config.learning_rate)
    if own := list(weighting.parameters()):
        optimizer.add_param_group({"params": own, "weight_decay": 0.0})
    schedule = Schedule(config.schedule, peak=config.learning_rate, steps=config.steps)
    average = {n: p.detach().clone() for n, p in model.named_parameters()} if config.average else {}
    first, memory = load_state(folder, model, optimizer, average)
    told = settings_of(settings)
    check_settings(folder, told, memory.get("settings", told))
    if first:
        log.info("resumed from step %d", first)
    if "schedule" in memory:
        schedule.restore(memory["schedule"])
        state = {name: torch.tensor(v) for name, v in memory["weighting"].items()}
        weighting.load_state_dict(state, strict=False)
    sums: dict[str, float] = memory.get("sums", {})
    counted, spent = int(memory.get("counted", 0)), float(memory.get("seconds", 0.0))
    wrapped, optimizer = fabric.setup(model, optimizer)
    if hasattr(model, "losses"):
        wrapped.mark_forward_method("losses")
    rank, world = fabric.global_rank, fabric.world_size
    mine = islice(batches(first * world + rank), 0, None, world)
    history = read_lines(folder, first)
    began = time.monotonic() - spent
    model.train()
    written = folder if fabric.is_global_zero else None
    with (
        Journal(written, first=first, tensorboard=config.tensorboard) as journal,
        torch.random.fork_rng(),
    ):
        for step, batch in zip(range(first, config.steps), mine, strict=False):
            torch.manual_seed(derived_seed(seed, "step", step, rank))
            rate = schedule.rate(step)
            for group in optimizer.param_groups:
                group["lr"] = rate
            named = losses(wrapped, fabric.to_device(batch))
            learnt = _learnt(named, config, weighting)
            _check_finite(named, step, rate)
            optimizer.zero_grad()
            weighting.differentiate(learnt, list(model.parameters()), fabric.backward)
            for parameter in own if world > 1 else ():  # the model's own are averaged by Fabric
                if parameter.grad is not None:
                    parameter.grad = _mean(fabric, parameter.grad)
            if config.clip:
                fabric.clip_gradients(wrapped, optimizer, max_norm=config.clip)
            optimizer.step()
            if config.average:
                _update(average, model, min(config.average, (step + 1) / (step + 10)))
            values = _values(fabric, {**named, "loss": learnt.sum()})
            schedule.observe(step, values)
            for name, value in values.items():
                sums[name] = sums.get(name, 0.0) + value
            counted += 1
            if (step + 1) % config.log_every == 0 or step + 1 == config.steps:
                line: LogLine = {
                    "step": step + 1,
                    "seconds": round(time.monotonic() - began, 2),
                    "learning_rate": rate,
                    **{k: v / counted for k, v in sums.items()},
                }
                history.append(line)
                sums, counted = {}, 0
                journal.write(line)
            if written is not None and (step + 1) % config.save_every == 0:
                seconds = round(time.monotonic() - began, 2)
                memory = {"sums": sums, "counted": counted, "seconds": seconds}
                memory["settings"] = told
                memory["schedule"] = schedule.state()
                memory["weighting"] = {n: t.tolist() for n, t in weighting.state_dict().items()}
                save_state(written, step + 1, model, optimizer, average, memory)
            if progress is not None and fabric.is_global_zero:
                progress(step + 1, config.steps, history[-1] if history else {})
    if config.average:
        model.load_state_dict(average, strict=False)
    model.cpu().eval()
    return history


def precision_of(config: LoopConfig) -> str:
    """Fabric's name of the precision that a configuration trains with."""
    if config.precision != "auto":
        return config.precision
    on_gpu = config.accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available()
    return "bf16-mixed" if on_gpu and torch.cuda.is_bf16_supported() else "32-true"


def is_first_process() -> bool:
    """Whether this process is the one that measures and saves, of those that train together."""
    distributed = torch.distributed.is_available() and torch.distributed.is_initialized()
    return not distributed or torch.distributed.get_rank() == 0


def _new_weighting(config: LoopConfig) -> Weighting:
    """The weighting that a configuration names, with the primary loss first.

    On resuming it gets its parameters back, but moving averages of gradients begin anew.
    """
    names = sorted(config.loss_weights, key=lambda name: name != config.primary)
    weighting: Weighting = weightings.load(config.weighting)(names)
    if isinstance(weighting, GradientWeighting) and config.devices > 1:
        raise InputError(
            f"The weighting {config.weighting!r} looks at gradients and trains on one device, "
            f"not {config.devices}; fixed and uncertainty train on several."
        )
    if isinstance(weighting, GradientWeighting) and precision_of(config) != "32-true":
        raise InputError(
            f"The weighting {config.weighting!r} looks at gradients and trains in full precision, "
            f"not {precision_of(config)!r}: add --loop.precision 32-true, or take fixed or "
            "uncertainty."
        )
    if config.weighting != "fixed" and len(names) < 2:
        raise InputError(
            f"The weighting {config.weighting!r} needs to know its losses: name at least two in "
            "loss_weights, with the factor 1 each if nothing speaks against it."
        )
    if weighting.ordered != bool(config.primary):
        raise InputError(
            f"The weighting {config.weighting!r} "
            + (
                "needs to know which loss is first: give --loop.primary with one of "
                f"{', '.join(names)}."
                if weighting.ordered
                else f"puts no loss first; received --loop.primary {config.primary}."
            )
        )
    if config.primary and config.primary not in names:
        raise InputError(
            f"The primary loss {config.primary!r} is not one of loss_weights: {', '.join(names)}."
        )
    return weighting


def _learnt(
    losses: Mapping[str, torch.Tensor], config: LoopConfig, weighting: Weighting
) -> torch.Tensor:
    """The losses to learn from, times their factors, in the order of the weighting's names."""
    factors = {name: config.loss_weights.get(name, 1.0) for name in losses}
    if config.weighting == "fixed":
        kept = [v * factors[k] for k, v in losses.items() if factors[k]]
        return torch.stack(kept or [0.0 * v for v in losses.values()])
    if unknown := losses.keys() - set(weighting.names):
        raise InputError(f"loss_weights lacks {', '.join(sorted(unknown))}.")
    if absent := [name for name in weighting.names if name not in losses]:
        raise InputError(
            f"loss_weights names {', '.join(absent)}, which this network does not give; the "
            f"weighting {config.weighting!r} takes {', '.join(losses)}."
        )
    return torch.stack([losses[name] * factors[name] for name in weighting.names])


def _values(fabric: Fabric, losses: Mapping[str, torch.Tensor]) -> dict[str, float]:
    """The losses as numbers, averaged over all devices."""
    stacked = torch.stack([loss.detach().float() for loss in losses.values()])
    return dict(zip(losses, _mean(fabric, stacked).tolist(), strict=True))


def _mean(fabric: Fabric, values: torch.Tensor) -> torch.Tensor:
    """Over all devices."""
    mean = fabric.all_reduce(values)
    assert isinstance(mean, torch.Tensor)
    return mean


def _check_finite(losses: Mapping[str, torch.Tensor], step: int, rate: float) -> None:
    """Refuse to go on with a loss that is no number."""
    lost = [name for name, loss in losses.items() if not torch.isfinite(loss.detach()).all()]
    if lost:
        raise InputError(
            f"Training diverged at step {step + 1}: {', '.join(lost)} is no finite number any "
            f"more, at the learning rate {rate:.3g}. Take a smaller learning rate; the same "
            "command with it needs a new folder to work in."
        )


@torch.no_grad()
def _update(average: dict[str, torch.Tensor], model: torch.nn.Module, decay: float) -> None:
    for name, parameter in model.named_parameters():
        average[name].lerp_(parameter.detach(), 1 - decay)
