"""A detector that begins with what another one has learnt, also with that of a narrower one.

References:
    Chen, Goodfellow and Shlens (2016), Net2Net: accelerating learning via knowledge transfer. There
    new channels are copies of old ones; here they begin anew, and nothing old listens to them yet.
"""

import logging
from pathlib import Path

from torch import Tensor

from fusionnet.errors import CheckpointError
from fusionnet.models.checkpoint import load_checkpoint
from fusionnet.models.retinanet import KIND, RetinaNet

log = logging.getLogger(__name__)

WIDENED = ("backbone.", "lateral.", "smooth.", "box_head.")
"""Parts whose layers follow one another, so that the first channels of one meet those of the next;
the layout's heads join maps of several origins."""

SHOWN = 5
"""Tensors that a warning names."""


def start_from(model: RetinaNet, folder: Path) -> list[str]:
    """Take over another detector's weights where names and shapes agree; returns the others.

    Of a narrower detector the first channels are taken over; they compute what they did.

    Raises:
        CheckpointError: If it is missing or damaged, or no detector, or if nothing agrees.
    """
    given, own = load_checkpoint(folder, KIND).tensors, model.state_dict()
    fits = {n: t for n, t in given.items() if n in own and own[n].shape == t.shape}
    narrow = {n: t for n, t in given.items() if n in own and _is_narrower(model, n, t, own[n])}
    fits |= {n: _widened(t, own[n]) for n, t in narrow.items()}
    if not fits.keys() & dict(model.named_parameters()).keys():
        raise CheckpointError(
            f"Nothing of the detector in {folder} can be taken over: none of its {len(given)} "
            "tensors has the name and the shape of one here. Begin with a detector of the same "
            "preset, or without --start."
        )
    model.load_state_dict(fits, strict=False)
    left = sorted(own.keys() - fits.keys())
    log.info("%d tensors taken over from %s", len(fits), folder)
    if narrow:
        log.info("%d of them are of a narrower detector", len(narrow))
    if left:
        shown = ", ".join(left[:SHOWN]) + (", ..." if len(left) > SHOWN else "")
        log.warning("%d of %d tensors begin anew: %s", len(left), len(own), shown)
    return left


def _is_narrower(model: RetinaNet, name: str, given: Tensor, own: Tensor) -> bool:
    """Whether a tensor has fewer channels; the outputs of a subnet are no channels."""
    if not name.startswith(WIDENED) or given.dim() != own.dim() or given.shape == own.shape:
        return False
    layer, _, _ = name.rpartition(".")
    subnets = {"classify": model.box_head.classify, "regress": model.box_head.regress}
    outputs = [f"box_head.{part}.{len(layers) - 1}" for part, layers in subnets.items()]
    if layer in outputs and len(given) != len(own):
        return False
    same_kernel = given.shape[2:] == own.shape[2:]
    return same_kernel and all(a <= b for a, b in zip(given.shape, own.shape, strict=True))


def _widened(given: Tensor, own: Tensor) -> Tensor:
    """The given channels first, deaf to the new ones behind them."""
    wide = own.clone()
    wide[: len(given)] = 0.0
    wide[tuple(slice(n) for n in given.shape)] = given.to(own.dtype)
    return wide
