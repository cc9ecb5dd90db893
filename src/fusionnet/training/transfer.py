"""Weights that the thesis's FusionNet begins with: a trained RetinaNet and Transformer (7.5)."""

from dataclasses import dataclass
from pathlib import Path

from torch import Tensor, nn

from fusionnet.errors import CheckpointError
from fusionnet.models.checkpoint import load_checkpoint
from fusionnet.models.thesis_fusionnet import ThesisFusionNet

NEW = ("fusion", "fusion_head")
"""Parts that may differ: the nodes for FusionNet, whose number is FusionNet's to choose."""


def transfer_detector(folder: Path, model: ThesisFusionNet) -> None:
    """Fill a FusionNet's detector with a RetinaNet's weights; the fusion subnet if it fits.

    Raises:
        CheckpointError: If there is no detector in the FusionNet, or the weights are of another.
    """
    if model.detector is None:
        raise CheckpointError("A FusionNet with the plain vision takes no detector's weights.")
    tensors = load_checkpoint(folder, "retinanet").tensors
    _fill(model.detector, tensors, folder)


@dataclass(frozen=True)
class TrainedTransformer:
    """A Transformer's weights and vocabularies.

    Attributes:
        folder: Where they were read.
        vocabularies: Tokens that it reads and tokens that it writes.
        writes: What it was trained to write.
        tensors: Its weights.
    """

    folder: Path
    vocabularies: tuple[tuple[str, ...], tuple[str, ...]]
    writes: str
    tensors: dict[str, Tensor]

    def fill(self, model: ThesisFusionNet) -> None:
        """Fill a FusionNet's language module; the fusion sublayer if it fits.

        Raises:
            CheckpointError: If it writes something else, or the sizes differ.
        """
        if self.writes != model.config.writes:
            raise CheckpointError(
                f"The Transformer in {self.folder} was trained to write {self.writes!r}, this "
                f"FusionNet is to write {model.config.writes!r}; give --writes {self.writes}, or "
                "another Transformer."
            )
        _fill(model.transformer, self.tensors, self.folder)


def transfer_transformer(folder: Path) -> TrainedTransformer:
    """Read a Transformer's checkpoint.

    Raises:
        CheckpointError: If it is missing, damaged, or of another kind.
    """
    checkpoint = load_checkpoint(folder, "transformer")
    try:
        words = [tuple(map(str, checkpoint.config[name])) for name in ("source", "target")]
    except (KeyError, TypeError) as error:
        raise CheckpointError(f"The checkpoint {folder} has no vocabularies.") from error
    writes = str(checkpoint.config.get("writes"))
    return TrainedTransformer(folder, (words[0], words[1]), writes, checkpoint.tensors)


def _fill(part: nn.Module, tensors: dict[str, Tensor], folder: Path) -> None:
    own = part.state_dict()
    misfits = [
        name
        for name in sorted(own.keys() | tensors.keys())
        if name not in own or name not in tensors or own[name].shape != tensors[name].shape
    ]
    wrong = [name for name in misfits if name.split(".")[0] not in NEW]
    if wrong:
        name = wrong[0]
        here = tuple(own[name].shape) if name in own else "missing"
        there = tuple(tensors[name].shape) if name in tensors else "missing"
        raise CheckpointError(
            f"The weights in {folder} are of another network: {name} is {there} there, {here} "
            f"here ({len(wrong)} differ). Choose the same sizes as it was trained with."
        )
    part.load_state_dict({**own, **{n: t for n, t in tensors.items() if n not in misfits}})
