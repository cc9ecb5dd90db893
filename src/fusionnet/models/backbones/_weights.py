"""ImageNet weights for a backbone: from a file, or from torchvision where a network offers them."""

import hashlib
import logging
from collections.abc import Mapping
from pathlib import Path

import torch
import torchvision.models
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import nn

from fusionnet.errors import CheckpointError, InputError

log = logging.getLogger(__name__)

RANDOM = "random"
IMAGENET = "imagenet"
MAX_BYTES = 2 * 2**30


def fill_backbone(backbone: nn.Module, source: str) -> str:
    """Give a backbone its first weights, and say in words where they came from.

    Args:
        backbone: To be filled in place.
        source: "random" leaves it as it is; "imagenet" asks torchvision, and leaves it random,
            with a warning, where no network answers; else a safetensors file with torchvision's
            names.

    Returns:
        "random", "random: ..." with the reason, "imagenet: ..." or "file: ...".

    Raises:
        CheckpointError: If the file is missing, damaged, or of another network.
        InputError: If torchvision has no ImageNet weights for this backbone.
    """
    if source == RANDOM:
        log.info("the backbone begins with random weights")
        return RANDOM
    if source == IMAGENET:
        return _from_torchvision(backbone)
    file = Path(source)
    if not file.is_file():
        raise CheckpointError(
            f"There are no weights {file} for the backbone; give a safetensors file, "
            f"{IMAGENET!r} or {RANDOM!r}."
        )
    if file.stat().st_size > MAX_BYTES:
        raise CheckpointError(f"{file} is larger than {MAX_BYTES // 2**30} GiB.")
    try:
        tensors = load_file(file)
    except (SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(f"{file} is damaged or no safetensors file: {error}") from error
    _load(backbone, tensors, str(file))
    with file.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return f"file: {file.name}, sha256 {digest}"


def freeze_normalisation(backbone: nn.Module) -> None:
    """Keep the statistics and factors of batch normalisation: one picture has none of its own."""
    for module in backbone.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()
            for parameter in module.parameters():
                parameter.requires_grad_(False)


def _from_torchvision(backbone: nn.Module) -> str:
    name = getattr(backbone, "imagenet", None)
    if name is None:
        raise InputError(
            f"Torchvision has no ImageNet weights for this backbone; choose {RANDOM!r}, a file, "
            "or one of the backbones resnet50, resnet101, resnet152."
        )
    weights = torchvision.models.get_model_weights(name).DEFAULT
    try:
        # weights_only: tensors and nothing that could be executed; the hash is checked.
        tensors = weights.get_state_dict(progress=False, check_hash=True, weights_only=True)
    except (OSError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:120]
        log.warning("no ImageNet weights (%s): the backbone begins with RANDOM weights", reason)
        return f"{RANDOM}: ImageNet weights could not be had ({reason})"
    _load(backbone, tensors, "torchvision")
    return f"imagenet: {weights}"


def _load(backbone: nn.Module, tensors: Mapping[str, torch.Tensor], where: str) -> None:
    """Fill the backbone; the classifier, which it does not have, is left out."""
    kept = {n: t for n, t in tensors.items() if not n.startswith("fc.")}
    try:
        backbone.load_state_dict(kept)
    except RuntimeError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = lines[1] if len(lines) > 1 else lines[0]
        raise CheckpointError(
            f"The weights of {where} are of another network: {reason[:200]}"
        ) from error
