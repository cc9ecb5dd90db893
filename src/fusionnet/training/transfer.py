"""Weights that the thesis's FusionNet begins with: a trained RetinaNet and Transformer (7.5)."""

import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from fusionnet.errors import CheckpointError
from fusionnet.models.checkpoint import load_checkpoint
from fusionnet.models.thesis_fusionnet import ThesisFusionNet

log = logging.getLogger(__name__)

NEW = ("fusion", "fusion_head")
"""Parts that may differ: the nodes for FusionNet, whose number is FusionNet's to choose."""

NODES = "fusion_nodes"
"""Name of that number in both configurations."""


def transfer_detector(folder: Path, model: ThesisFusionNet) -> None:
    """Fill a FusionNet's detector with a RetinaNet's weights; the fusion subnet if it fits.

    Raises:
        CheckpointError: If there is no detector in the FusionNet, or the weights are of another.
    """
    if model.detector is None:
        raise CheckpointError("A FusionNet with the plain vision takes no detector's weights.")
    checkpoint = load_checkpoint(folder, "retinanet")
    wanted = _detector_sizes(model.config.detector.as_json())
    _fill(model.detector, checkpoint.tensors, folder, _detector_sizes(checkpoint.config), wanted)


@dataclass(frozen=True)
class TrainedTransformer:
    """A Transformer's weights and vocabularies.

    Attributes:
        folder: Where they were read.
        vocabularies: Tokens that it reads and tokens that it writes.
        writes: What it was trained to write.
        sizes: Of its network, as JSON.
        tensors: Its weights.
    """

    folder: Path
    vocabularies: tuple[tuple[str, ...], tuple[str, ...]]
    writes: str
    sizes: Mapping[str, Any]
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
        wanted = asdict(model.config.transformer)
        _fill(model.transformer, self.tensors, self.folder, self.sizes, wanted)


def transfer_transformer(folder: Path) -> TrainedTransformer:
    """Read a Transformer's checkpoint.

    Raises:
        CheckpointError: If it is missing, damaged, or of another kind.
    """
    checkpoint = load_checkpoint(folder, "transformer")
    try:
        words = [tuple(map(str, checkpoint.config[name])) for name in ("source", "target")]
        sizes = dict(checkpoint.config["network"])
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"The checkpoint {folder} has no vocabularies or sizes.") from error
    writes = str(checkpoint.config.get("writes"))
    return TrainedTransformer(folder, (words[0], words[1]), writes, sizes, checkpoint.tensors)


def _detector_sizes(config: Mapping[str, Any]) -> dict[str, Any]:
    """What the shapes of a detector's weights depend on, of its configuration as JSON."""
    own = ("backbone", "pyramid", "width", NODES)
    return {name: config.get(name) for name in own} | {
        "depth": config.get("boxes", {}).get("depth")
    }


def _fill(
    part: nn.Module,
    tensors: Mapping[str, Tensor],
    folder: Path,
    trained: Mapping[str, Any],
    wanted: Mapping[str, Any],
) -> None:
    """Fill a network; its nodes for FusionNet stay as they are where their number differs.

    Args:
        part: To be filled.
        tensors: The weights.
        folder: Where they were read.
        trained: Sizes that they were trained with.
        wanted: Sizes of the network.

    Raises:
        CheckpointError: If any other tensor is missing, superfluous, or of another shape.
    """
    own = part.state_dict()
    misfits = [
        name
        for name in sorted(own.keys() | tensors.keys())
        if name not in own or name not in tensors or own[name].shape != tensors[name].shape
    ]
    wrong = [name for name in misfits if name.split(".")[0] not in NEW]
    if wrong:
        differ = [
            f"{name} is {trained.get(name)} there, {value} here"
            for name, value in wanted.items()
            if trained.get(name) != value and name not in (NODES, "dropout")
        ]
        shapes = [tuple(t[wrong[0]].shape) if wrong[0] in t else "missing" for t in (tensors, own)]
        differ.append(f"{wrong[0]} is {shapes[0]} there, {shapes[1]} here ({len(wrong)} differ)")
        raise CheckpointError(
            f"The weights in {folder} are of another network: {'; '.join(differ)}. Choose the same "
            "sizes as it was trained with."
        )
    if misfits:
        log.warning(
            "the nodes for FusionNet begin anew: %s was trained with %s, and here are %s",
            folder,
            trained.get(NODES),
            wanted[NODES],
        )
    part.load_state_dict({**own, **{n: t for n, t in tensors.items() if n not in misfits}})
