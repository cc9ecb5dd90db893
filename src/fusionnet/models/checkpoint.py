"""Checkpoints: a folder with `model.safetensors`, `config.json` and a card, never a pickle.

Loading one executes nothing: tensors are read by safetensors, everything else is
JSON of bounded size. The JSON carries the kind of model, the schema version, the
constructor's configuration and whatever the model needs beside its weights
(vocabulary, joint limits, preprocessing, metrics, provenance).
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from fusionnet.errors import CheckpointError, OutputError
from fusionnet.files import check_folder, check_new_folder, folder_whole
from fusionnet.models.card import CARD_FILE, model_card

SCHEMA_VERSION = 1
"""Raised when a change makes older checkpoints unreadable."""

WEIGHTS_FILE = "model.safetensors"
CONFIG_FILE = "config.json"
MAX_CONFIG_BYTES = 16 * 2**20
MAX_WEIGHTS_BYTES = 4 * 2**30


@dataclass(frozen=True)
class Checkpoint:
    """What a checkpoint folder holds.

    Attributes:
        kind: Name of the model class that wrote it.
        config: Arguments that rebuild the model.
        tensors: The state, by parameter name.
        metadata: Metrics and provenance; nothing that inference needs.
    """

    kind: str
    config: dict[str, Any]
    tensors: dict[str, torch.Tensor]
    metadata: dict[str, Any]


def save_checkpoint(
    folder: Path,
    *,
    kind: str,
    config: Mapping[str, Any],
    tensors: Mapping[str, torch.Tensor],
    metadata: Mapping[str, Any] | None = None,
    half: bool = False,
) -> None:
    """Write a checkpoint folder with its model card, whole or not at all.

    Args:
        folder: Where to; a checkpoint there is replaced, other files never.
        kind: Name of the model class, checked when it is read again.
        config: Arguments that rebuild the model, as JSON values.
        tensors: The state, by parameter name.
        metadata: Metrics and provenance, as JSON values.
        half: Store floating-point tensors in 16 bits, for shipping.

    Raises:
        OutputError: If the folder cannot be written, or holds other files.
    """
    document = {
        "kind": kind,
        "schema_version": SCHEMA_VERSION,
        "config": dict(config),
        "metadata": dict(metadata or {}),
    }
    state = {
        name: (t.half() if half and t.is_floating_point() else t).detach().cpu().contiguous()
        for name, t in tensors.items()
    }
    try:
        with folder_whole(folder, _is_ours) as aside:
            save_file(state, aside / WEIGHTS_FILE)
            (aside / CONFIG_FILE).write_text(json.dumps(document, indent=1) + "\n")
            (aside / CARD_FILE).write_text(model_card(document))
            for file in aside.iterdir():
                file.chmod(0o644)
    except SafetensorError as error:
        raise OutputError(f"Cannot write the checkpoint {folder}: {error}") from error


def check_checkpoint_folder(folder: Path, work: Path | None = None) -> None:
    """Fail before any training is done, if `folder` cannot become a checkpoint.

    Args:
        folder: Where a checkpoint shall be written; an earlier one may be there.
        work: Where the training keeps other files.

    Raises:
        OutputError: If it is a file, holds files that are no checkpoint of ours, cannot be made,
            or would hold `work`, or if nothing can be written into `work`.
    """
    check_new_folder(folder, _is_ours)
    if work is None:
        return
    check_folder(work)
    if work.resolve().is_relative_to(folder.resolve()):
        raise OutputError(
            f"The checkpoint's folder {folder} would hold the files of {work}; name another one."
        )


def _is_ours(folder: Path) -> bool:
    """Whether a folder holds a checkpoint of ours and nothing else."""
    try:
        document = read_document(folder)
    except CheckpointError:
        return False
    files = {WEIGHTS_FILE, CONFIG_FILE, CARD_FILE}
    return {"kind", "schema_version"} <= document.keys() and {
        file.name for file in folder.iterdir()
    } <= files


def load_checkpoint(folder: Path, kind: str) -> Checkpoint:
    """Read a checkpoint folder.

    Raises:
        CheckpointError: If it is missing, damaged, of another kind or schema version.
    """
    document = read_document(folder)
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise CheckpointError(
            f"The checkpoint {folder} has schema version {version!r}; this release reads "
            f"version {SCHEMA_VERSION}. Train it again or use the release that wrote it."
        )
    if document.get("kind") != kind:
        raise CheckpointError(
            f"The checkpoint {folder} holds a {document.get('kind')!r}, expected a {kind!r}."
        )
    config, metadata = document.get("config"), document.get("metadata", {})
    if not isinstance(config, dict) or not isinstance(metadata, dict):
        raise CheckpointError(f"The checkpoint {folder} has no configuration in {CONFIG_FILE}.")
    weights = folder / WEIGHTS_FILE
    if not weights.is_file():
        raise CheckpointError(f"The checkpoint {folder} has no {WEIGHTS_FILE}.")
    if weights.stat().st_size > MAX_WEIGHTS_BYTES:
        raise CheckpointError(f"{weights} is larger than {MAX_WEIGHTS_BYTES // 2**30} GiB.")
    try:
        tensors = load_file(weights)
    except (SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(f"{weights} is damaged or cut short: {error}") from error
    tensors = {n: t.float() if t.dtype == torch.float16 else t for n, t in tensors.items()}
    return Checkpoint(kind=kind, config=config, tensors=tensors, metadata=metadata)


def checkpoint_kind(folder: Path) -> str:
    """The kind of model that a checkpoint folder holds.

    Raises:
        CheckpointError: If there is no readable checkpoint.
    """
    return str(read_document(folder).get("kind"))


def restore(model: torch.nn.Module, tensors: Mapping[str, torch.Tensor], folder: Path) -> None:
    """Fill a model from a checkpoint's tensors.

    Raises:
        CheckpointError: If names or shapes do not fit the model.
    """
    try:
        model.load_state_dict(dict(tensors))
    except RuntimeError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = lines[1] if len(lines) > 1 else lines[0]
        raise CheckpointError(
            f"The weights in {folder} do not fit their configuration: {reason}"
        ) from error


def read_document(folder: Path) -> dict[str, Any]:
    """What a checkpoint's `config.json` holds.

    Raises:
        CheckpointError: If it is missing, too large, or no JSON object.
    """
    file = folder / CONFIG_FILE
    if not file.is_file():
        raise CheckpointError(
            f"No checkpoint at {folder}: expected a folder with {CONFIG_FILE} and {WEIGHTS_FILE}."
        )
    if file.stat().st_size > MAX_CONFIG_BYTES:
        raise CheckpointError(f"{file} is larger than {MAX_CONFIG_BYTES // 2**20} MiB.")
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise CheckpointError(f"{file} is not valid JSON: {error}") from error
    if not isinstance(document, dict):
        raise CheckpointError(f"{file} must hold a JSON object.")
    return document
