"""The thesis's FusionNet: RetinaNet's nodes and the Transformer's, fused to fourteen values.

Two networks with a branch each: the fusion subnet gives a few nodes for every anchor of a
picture, the fusion sublayer as many for every token that is written. A fuser joins them
(the thesis: concatenated and flattened) and the joints are read off by one sigmoid layer. Every
output is a head of `models.heads`; those that are left out are neither computed nor learnt.

References:
    Thesis, 4.3 and chapter 7.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor, nn

from fusionnet.errors import CheckpointError, InputError
from fusionnet.models import fusers, heads
from fusionnet.models.checkpoint import load_checkpoint, restore, save_checkpoint
from fusionnet.models.convolutional_nodes import ConvolutionalNodes
from fusionnet.models.heads import Example, Features, Head, Shapes
from fusionnet.models.heads.boxes import BoxOutputs
from fusionnet.models.hub import check_robot, checkpoint_folder
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.target_text import END, START, source_tokens
from fusionnet.models.thesis_fusion_config import JOINTS, ThesisFusionNetConfig
from fusionnet.models.transformer_network import TransformerNetwork, number_rows
from fusionnet.sentences import PADDING, UNKNOWN, Vocabulary

KIND = "thesis-fusionnet"


@dataclass
class FusionBatch:
    """Examples as tensors; `targets` holds one entry an example for every head."""

    images: UInt8[Tensor, "b h w 3"]
    source: Int[Tensor, "b t"]
    given: Int[Tensor, "b s"]
    targets: dict[str, list[Any]]


class TwoStageAnswer(NamedTuple):
    """What a FusionNet answers to pictures and sentences (4.3.3).

    Attributes:
        joints: The fourteen values of each example [rad; gripper 0 to 1].
        written: The tokens that it wrote, without marks.
        found: What every head predicts, one entry an example.
    """

    joints: Float[np.ndarray, "b k"]
    written: list[tuple[str, ...]]
    found: dict[str, list[Any]]


class ThesisFusionNet(nn.Module):
    """Vision, language, fuser and heads; the same class for training and for inference."""

    def __init__(self, config: ThesisFusionNetConfig) -> None:
        super().__init__()
        self.config = config
        self.source = Vocabulary(config.source)
        self.target = Vocabulary(config.target)
        self.transformer = TransformerNetwork(config.transformer)
        longest, nodes = config.transformer.longest, config.transformer.fusion_nodes
        self.detector: RetinaNet | None = None
        if config.vision == "cnn":
            self.plain = ConvolutionalNodes(config.detector.frame.input_size, nodes)
            places, channels = self.plain.places, 0
        else:
            self.detector = RetinaNet(config.detector)
            places, channels = self._anchors(self.detector), config.detector.width
        self.fuser = fusers.load(config.fuser)((places, nodes), (longest, nodes))
        shapes = Shapes(
            channels=channels,
            strides=config.detector.boxes.strides,
            fused=self.fuser.width,
            joints=len(config.joint_limits),
        )
        self.heads = nn.ModuleDict({name: heads.load(name)(shapes) for name in config.heads})

    def _anchors(self, detector: RetinaNet) -> int:
        width, height = self.config.detector.frame.input_size
        places = 0
        for stride in self.config.detector.boxes.strides:
            places += -(-width // stride) * -(-height // stride)
        return places * detector.config.boxes.anchors_a_place

    def features(
        self,
        images: UInt8[Tensor, "b h w 3"],
        source: Int[Tensor, "b t"],
        given: Int[Tensor, "b s"],
    ) -> Features:
        """Everything below the heads.

        Args:
            images: Network inputs, 0 to 255.
            source: Tokens of the sentences.
            given: Tokens of the targets, from the first mark on.
        """
        decoded = self.transformer.decode(self.transformer.encode(source), given)
        said = self.transformer.nodes(decoded, given)
        levels: list[Tensor] = []
        anchors: BoxOutputs | None = None
        if self.detector is None:
            seen = self.plain(images)
        else:
            levels = self.detector.levels(images)
            assert self.detector.fusion_head is not None
            seen = self.detector.fusion_head(levels)
            if any(self.head(name).needs_anchors for name in self.config.heads):
                size = (images.shape[1], images.shape[2])
                anchors = self.detector.box_head(levels, size)
        known: dict[str, Tensor] = {}

        def anchor_losses(truth: Sequence[Any]) -> Mapping[str, Tensor]:
            assert self.detector is not None and anchors is not None
            if not known:
                known.update(self.detector.box_head.losses(anchors, list(truth)))
            return known

        tokens = self.transformer.output(decoded)
        return Features(levels, anchors, anchor_losses, tokens, self.fuser(seen, said))

    def forward(
        self,
        images: UInt8[Tensor, "b h w 3"],
        source: Int[Tensor, "b t"],
        given: Int[Tensor, "b s"],
    ) -> dict[str, Any]:
        """The raw output of every head."""
        features = self.features(images, source, given)
        return {name: head(features) for name, head in self.heads.items()}

    def losses(self, batch: FusionBatch) -> dict[str, Tensor]:
        """One named loss a head."""
        features = self.features(batch.images, batch.source, batch.given)
        return {
            name: self.head(name).loss(head(features), batch.targets[name], features)
            for name, head in self.heads.items()
        }

    def head(self, name: str) -> Head:
        """The head of a name, typed."""
        head = self.heads[name]
        assert isinstance(head, Head)
        return head

    def batch_of(self, examples: Sequence[Example]) -> FusionBatch:
        """Examples as tensors."""
        return FusionBatch(
            torch.from_numpy(np.stack([e.picture for e in examples])),
            number_rows([e.source for e in examples]),
            number_rows([e.target[:-1] for e in examples]),
            {name: [self.head(name).target(e) for e in examples] for name in self.heads},
        )

    def numbers(self, sentence: str) -> tuple[int, ...]:
        """Numbers of a sentence's tokens, cut to what is read; one unknown if it has none."""
        tokens = source_tokens(sentence)[: self.config.transformer.longest]
        return tuple(self.source.number(token) for token in tokens) or (UNKNOWN,)

    @torch.inference_mode()
    def write(self, source: Int[Tensor, "b t"]) -> Int[Tensor, "b s"]:
        """The first stage: the targets written greedily, from the first mark on (4.3.3)."""
        start, end = self.target.number(START), self.target.number(END)
        return self.transformer.write(self.transformer.encode(source), start, end)

    @torch.inference_mode()
    def answer(self, images: UInt8[Tensor, "b h w 3"], sentences: Sequence[str]) -> TwoStageAnswer:
        """Both stages: write the target, then everything with it (thesis 4.3.3)."""
        source = number_rows([self.numbers(s) for s in sentences]).to(images.device)
        given = self.write(source)
        outputs = self(images, source, given)
        found = {name: self.head(name).predict(output) for name, output in outputs.items()}
        joints = self.unscale(torch.stack(found[JOINTS]).double().numpy())
        return TwoStageAnswer(joints, [self._tokens(row) for row in given.tolist()], found)

    def _tokens(self, row: Sequence[int]) -> tuple[str, ...]:
        """Written numbers, the first mark before them, as tokens."""
        names = ("", "<unknown>", *self.config.target)
        return tuple(names[number] for number in row[1:] if number != PADDING)

    def scale(self, joints: Float[np.ndarray, "*b k"]) -> Float[np.ndarray, "*b k"]:
        """Values brought to 0 ... 1 (equation 4.2); one that never varies becomes 0."""
        low, extent = self._extents()
        return np.where(extent > 0, (joints - low) / np.where(extent > 0, extent, 1.0), 0.0)

    def unscale(self, scaled: Float[np.ndarray, "*b k"]) -> Float[np.ndarray, "*b k"]:
        """The inverse of `scale`."""
        low, extent = self._extents()
        return low + np.asarray(scaled) * extent

    def _extents(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        limits = np.array(self.config.joint_limits)
        return limits[:, 0], limits[:, 1] - limits[:, 0]

    def save(self, folder: Path, metadata: Mapping[str, Any] | None = None) -> None:
        """Write a checkpoint folder with its model card.

        Raises:
            OutputError: If it cannot be written.
        """
        save_checkpoint(
            folder,
            kind=KIND,
            config=self.config.as_json(),
            tensors=self.state_dict(),
            metadata=metadata,
        )

    save_pretrained = save

    @classmethod
    def from_pretrained(cls, name: Path | str, *, robot: str | None = None) -> "ThesisFusionNet":
        """Read a checkpoint from a folder or, by `owner/name`, from the hub.

        Args:
            name: Folder or hub name.
            robot: Robot whose values are wanted; by default whichever it was trained for.

        Raises:
            CheckpointError: If it cannot be had, is damaged, or is of another kind, schema
                version or robot.
        """
        folder = checkpoint_folder(name)
        checkpoint = load_checkpoint(folder, KIND)
        config = ThesisFusionNetConfig.from_json(checkpoint.config)
        check_robot(str(name), config.robot, config.joint_names, robot)
        try:
            model = cls(config)
        except (InputError, LookupError) as error:
            raise CheckpointError(f"The FusionNet in {folder} cannot be built: {error}") from error
        restore(model, checkpoint.tensors, folder)
        return model.eval()
