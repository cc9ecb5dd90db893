"""The one training loop: steps over batches, a one-cycle schedule, a log, checkpoints, resume.

It runs on Lightning Fabric, so the same lines train on a CPU, one GPU or several.
A model brings its own losses as a named dictionary; the loop adds them up with
fixed weights, steps AdamW, and writes one JSON line every few steps.
"""

import json
import logging
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from lightning.fabric import Fabric
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from fusionnet.errors import CheckpointError, InputError

log = logging.getLogger(__name__)

Losses = Callable[[torch.nn.Module, Any], Mapping[str, torch.Tensor]]
LogLine = dict[str, float | int]
Progress = Callable[[int, int, LogLine], None]


@dataclass(frozen=True, kw_only=True)
class LoopConfig:
    """How to train.

    Attributes:
        steps: Optimiser steps in all.
        learning_rate: Peak of the schedule.
        warm_up: Share of the steps that rise linearly to the peak; a cosine falls after it.
        weight_decay: Of AdamW, on matrices only.
        clip: Greatest norm of the gradient.
        loss_weights: Fixed factor of each named loss; 1 where none is given.
        average: Decay of the exponential moving average of the weights; 0 turns it off.
        precision: Fabric's name: "32-true" or "bf16-mixed".
        accelerator: Fabric's name: "auto", "cpu", "cuda".
        devices: How many devices.
        log_every: Steps between lines of the log.
        save_every: Steps between resumable states.
    """

    steps: int
    learning_rate: float = 1e-3
    warm_up: float = 0.05
    weight_decay: float = 0.01
    clip: float = 1.0
    loss_weights: Mapping[str, float] = field(default_factory=dict)
    average: float = 0.0
    precision: str = "32-true"
    accelerator: str = "cpu"
    devices: int = 1
    log_every: int = 50
    save_every: int = 500

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        if self.steps < 1 or self.learning_rate <= 0 or not 0 <= self.warm_up < 1:
            raise InputError(f"steps >= 1, learning_rate > 0, 0 <= warm_up < 1; got {self}")

    def rate_at(self, step: int) -> float:
        """Learning rate of a step: linear warm-up, then half a cosine to a hundredth."""
        rise = max(1, int(self.warm_up * self.steps))
        if step < rise:
            return self.learning_rate * (step + 1) / rise
        share = (step - rise) / max(1, self.steps - rise)
        return self.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share)))


def fit(
    model: torch.nn.Module,
    batches: Callable[[int], Iterator[Any]],
    losses: Losses,
    config: LoopConfig,
    *,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> list[LogLine]:
    """Train a model in place and return the lines of its log.

    Args:
        model: What to train; holds the averaged weights at the end if averaging is on.
        batches: Given a first step, the batches from that step on (so that a resumed
            run sees the data that the killed one would have seen).
        losses: The model and a batch to named scalar losses.
        config: How to train.
        folder: Where the log and the resumable state go; a state found there is resumed.
        progress: Called after every step with step, steps and the latest log line.

    Returns:
        One dictionary a log line: step, seconds, learning rate, mean of every loss.
    """
    fabric = Fabric(
        accelerator=config.accelerator,
        devices=config.devices,
        precision=config.precision,  # type: ignore[arg-type]
    )
    fabric.launch()
    optimizer = torch.optim.AdamW(_groups(model, config), lr=config.learning_rate, fused=True)
    average = {n: p.detach().clone() for n, p in model.named_parameters()}
    first = _resume(folder, model, optimizer, average)
    wrapped, optimizer = fabric.setup(model, optimizer)
    wrapped.mark_forward_method("losses") if hasattr(model, "losses") else None
    history: list[LogLine] = []
    sums: dict[str, float] = {}
    counted, began = 0, time.monotonic()
    model.train()
    for step, batch in zip(range(first, config.steps), batches(first), strict=False):
        for group in optimizer.param_groups:
            group["lr"] = config.rate_at(step)
        named = losses(wrapped, fabric.to_device(batch))
        total = torch.stack([v * config.loss_weights.get(k, 1.0) for k, v in named.items()]).sum()
        optimizer.zero_grad()
        fabric.backward(total)
        fabric.clip_gradients(wrapped, optimizer, max_norm=config.clip)
        optimizer.step()
        if config.average:
            _update(average, model, min(config.average, (step + 1) / (step + 10)))
        for name, value in (*named.items(), ("loss", total)):
            sums[name] = sums.get(name, 0.0) + float(value.detach())
        counted += 1
        if (step + 1) % config.log_every == 0 or step + 1 == config.steps:
            line: LogLine = {
                "step": step + 1,
                "seconds": round(time.monotonic() - began, 2),
                "learning_rate": config.rate_at(step),
                **{k: v / counted for k, v in sums.items()},
            }
            history.append(line)
            sums, counted = {}, 0
            if folder is not None and fabric.is_global_zero:
                _append(folder / "log.jsonl", line)
        if progress is not None and fabric.is_global_zero:
            progress(step + 1, config.steps, history[-1] if history else {})
        if folder is not None and fabric.is_global_zero and (step + 1) % config.save_every == 0:
            _save(folder, step + 1, model, optimizer, average)
    if config.average:
        model.load_state_dict(average, strict=False)
    model.eval()
    return history


def _groups(model: torch.nn.Module, config: LoopConfig) -> list[dict[str, Any]]:
    matrices = [p for p in model.parameters() if p.requires_grad and p.ndim > 1]
    vectors = [p for p in model.parameters() if p.requires_grad and p.ndim <= 1]
    return [
        {"params": matrices, "weight_decay": config.weight_decay},
        {"params": vectors, "weight_decay": 0.0},
    ]


@torch.no_grad()
def _update(average: dict[str, torch.Tensor], model: torch.nn.Module, decay: float) -> None:
    for name, parameter in model.named_parameters():
        average[name].lerp_(parameter.detach(), 1 - decay)


def _append(file: Path, line: LogLine) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(line) + "\n")


def _save(
    folder: Path,
    step: int,
    model: torch.nn.Module,
    optimizer: torch.optim.Optimizer,
    average: Mapping[str, torch.Tensor],
) -> None:
    """Write model, moving average and Adam's moments as one safetensors file."""
    tensors = {f"model.{n}": t for n, t in model.state_dict().items()}
    tensors |= {f"average.{n}": t for n, t in average.items()}
    for index, parameter in enumerate(_parameters(optimizer)):
        for key, value in optimizer.state.get(parameter, {}).items():
            tensors[f"optimizer.{index}.{key}"] = torch.as_tensor(value)
    folder.mkdir(parents=True, exist_ok=True)
    aside = folder / ".state.safetensors.part"
    state = {n: t.detach().cpu().clone().contiguous() for n, t in tensors.items()}
    save_file(state, aside, metadata={"step": str(step)})
    os.replace(aside, folder / "state.safetensors")


def _resume(
    folder: Path | None,
    model: torch.nn.Module,
    optimizer: torch.optim.Optimizer,
    average: dict[str, torch.Tensor],
) -> int:
    """Fill everything from a saved state, if there is one, and return its step."""
    file = folder / "state.safetensors" if folder is not None else None
    if file is None or not file.is_file():
        return 0
    try:
        with safe_open(file, framework="pt") as stored:
            step = int(stored.metadata()["step"])
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        model.load_state_dict(
            {n.removeprefix("model."): t for n, t in tensors.items() if n.startswith("model.")}
        )
    except (SafetensorError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"Cannot resume from {file}: {error}. Remove it to start again."
        ) from error
    average.update(
        {n.removeprefix("average."): t for n, t in tensors.items() if n.startswith("average.")}
    )
    for index, parameter in enumerate(_parameters(optimizer)):
        prefix = f"optimizer.{index}."
        moments = {n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)}
        if moments:
            optimizer.state[parameter] = moments
    log.info("resumed from step %d", step)
    return step


def _parameters(optimizer: torch.optim.Optimizer) -> list[torch.nn.Parameter]:
    return [p for group in optimizer.param_groups for p in group["params"]]
