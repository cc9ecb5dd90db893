"""The resumable state of a run: one safetensors file, written aside and renamed.

It holds the model, its moving average, the optimiser's moments, and (as JSON in the
file's header) the step and the few numbers that the loop remembers between steps.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from fusionnet.errors import CheckpointError, OutputError

STATE_FILE = "state.safetensors"

_FREE = {
    *("out", "work", "workers", "steps", "log_every", "save_every", "tensorboard"),
    *("accelerator", "threads"),
}
"""Settings that a run may be gone on with differently."""


def save_state(
    folder: Path,
    step: int,
    model: torch.nn.Module,
    optimizer: torch.optim.Optimizer,
    average: Mapping[str, torch.Tensor],
    memory: Mapping[str, Any],
) -> None:
    """Write everything that a resumed run needs.

    Args:
        folder: Where to.
        step: Steps done.
        model: Its parameters and buffers.
        optimizer: Its moments.
        average: Moving average of the parameters, by name.
        memory: What else the loop remembers, as JSON values.

    Raises:
        OutputError: If it cannot be written; what was there before is still there.
    """
    tensors = {f"model.{n}": t for n, t in model.state_dict().items()}
    tensors |= {f"average.{n}": t for n, t in average.items()}
    for index, parameter in enumerate(_parameters(optimizer)):
        for key, value in optimizer.state.get(parameter, {}).items():
            if value is not None:
                tensors[f"optimizer.{index}.{key}"] = torch.as_tensor(value)
    state = {n: t.detach().cpu().clone().contiguous() for n, t in tensors.items()}
    aside = folder / f".{STATE_FILE}.part"  # straight to disk, without the bytes in memory besides
    try:
        folder.mkdir(parents=True, exist_ok=True)
        save_file(state, aside, metadata={"step": str(step), "memory": json.dumps(memory)})
        os.replace(aside, folder / STATE_FILE)
    except (OSError, SafetensorError) as error:
        raise OutputError(f"Cannot write the state of a run to {folder}: {error}.") from error


def load_state(
    folder: Path | None,
    model: torch.nn.Module,
    optimizer: torch.optim.Optimizer,
    average: dict[str, torch.Tensor],
) -> tuple[int, dict[str, Any]]:
    """Fill everything from a saved state, if there is one; returns its step and memory.

    Raises:
        CheckpointError: If the state is damaged, or of another model.
    """
    file = folder / STATE_FILE if folder is not None else None
    if file is None or not file.is_file():
        return 0, {}
    try:
        with safe_open(file, framework="pt") as stored:
            header = stored.metadata()
            step, memory = int(header["step"]), json.loads(header.get("memory", "{}"))
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        model.load_state_dict(
            {n.removeprefix("model."): t for n, t in tensors.items() if n.startswith("model.")}
        )
    except (SafetensorError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"Cannot resume from {file}: {error}. Remove it to start again."
        ) from error
    for name, parameter in model.named_parameters():
        if name in average:
            stored_average = tensors.get(f"average.{name}", parameter.detach())
            average[name] = stored_average.to(parameter.device, copy=True)
    for index, parameter in enumerate(_parameters(optimizer)):
        prefix = f"optimizer.{index}."
        moments = {
            n.removeprefix(prefix): t.to(parameter.device)
            for n, t in tensors.items()
            if n.startswith(prefix)
        }
        if moments:
            optimizer.state[parameter] = moments
    return step, memory


def settings_of(config: Any) -> dict[str, Any]:
    """What a run must share with the one that it goes on with, as JSON values by dotted names.

    What may change is left out: how long it goes on, where it is kept, and what it logs.

    Args:
        config: A dataclass; None for nothing.
    """
    if config is None:
        return {}
    found: dict[str, Any] = {}
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            found |= {f"{field.name}.{name}": v for name, v in settings_of(value).items()}
        elif field.name not in _FREE:
            found[field.name] = json.loads(json.dumps(value, default=_absolute))
    return found


def check_settings(
    folder: Path | None, settings: Mapping[str, Any], stored: Mapping[str, Any]
) -> None:
    """Refuse to go on with a run of other settings.

    Raises:
        CheckpointError: If one differs; the message names it.
    """
    for name in sorted(settings.keys() | stored.keys()):
        if settings.get(name) != stored.get(name):
            raise CheckpointError(
                f"{folder} holds a run with {name} {stored.get(name)!r}, not "
                f"{settings.get(name)!r}. Go on with the same, name another folder (--work), or "
                f"remove its {STATE_FILE}."
            )


def _absolute(path: Path) -> str:
    return str(path.resolve())


def _parameters(optimizer: torch.optim.Optimizer) -> list[torch.nn.Parameter]:
    return [p for group in optimizer.param_groups for p in group["params"]]
