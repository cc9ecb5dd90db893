"""The compact FusionNet as one graph, from a picture and a sentence to the fourteen values.

The detector reads the occupancy of the grid from the picture, the translator proposes trees
for the sentence, FusionNet carries each out on what was seen and joins the answers by how
likely the trees are. All of it is differentiable, so the error of the joints can teach the
detector's filters and the translator's preference among its readings; which trees are
proposed is found by search.

References:
    Thesis, 4.3 and figure 4.4: one network from picture and sentence to the joints.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor, nn

from fusionnet.blocks.grid import GRID
from fusionnet.errors import PlanningError
from fusionnet.models.fusionnet import FusionNet
from fusionnet.models.program_pack import pack
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.soft_layout import CELLS
from fusionnet.models.translator import Translator
from fusionnet.models.translator_network import SentenceBatch
from fusionnet.models.tree_program import TreeProgram, compile_tree


class Expected(NamedTuple):
    """What the arm is to do, as expected over readings and cells.

    Attributes:
        source: Probability of each cell to be where the block is taken from.
        target: Probability of each cell to be where it goes.
        ends_held: Probability that it stays in the hand.
        joints: The fourteen values, scaled to 0 ... 1.
        answered: Which examples have a reading that makes sense; the rows of others are 0.
    """

    source: Float[Tensor, "b 512"]
    target: Float[Tensor, "b 512"]
    ends_held: Float[Tensor, " b"]
    joints: Float[Tensor, "b k"]
    answered: Bool[Tensor, " b"]


class Taught(NamedTuple):
    """Sentences and the symbols that the translator is shown, as `TranslatorNetwork.forward`."""

    sentences: SentenceBatch
    given: Int[Tensor, "b s"]


class Outputs(NamedTuple):
    """All that the network says of a batch.

    Attributes:
        seen: Raw outputs of the detector's heads.
        written: Logits and attention scores of the symbols, where there were some to be shown.
        expected: What the arm is to do.
    """

    seen: dict[str, Any]
    written: tuple[Tensor, Tensor] | None
    expected: Expected


class EndToEnd(nn.Module):
    """Detector, translator and FusionNet as one network.

    Args:
        detector: Reads layouts from the robot's left eye.
        translator: Its network is a part of this one.
        fusion: Joins both.
        readings: Trees that are proposed for each sentence.
    """

    def __init__(
        self, detector: RetinaNet, translator: Translator, fusion: FusionNet, *, readings: int = 4
    ) -> None:
        super().__init__()
        self.detector = detector
        self.translator = translator
        self.language = translator.network
        self.fusion = fusion
        self.readings = readings

    def forward(
        self,
        images: UInt8[Tensor, "b h w 3"],
        sentences: Sequence[str],
        deviation: Float[Tensor, "b 7"] | None = None,
        taught: Taught | None = None,
    ) -> Outputs:
        """Everything at once.

        Args:
            images: The detector's inputs, 0 to 255.
            sentences: One a picture.
            deviation: Camera poses to project cells with, instead of the estimated ones.
            taught: What the translator is to be taught besides.
        """
        seen = self.detector(images, deviation)
        logits, held = seen["cells"].logits, seen["cells"].held
        cells = (logits.float() / self.detector.config.temperature).softmax(-1)
        with torch.autocast(images.device.type, enabled=False):  # logarithms need every bit
            expected = self.expect(
                cells.unflatten(1, (GRID, GRID, GRID)), held.float().sigmoid(), sentences
            )
        written = None if taught is None else self.language(*taught)
        return Outputs(seen, written, expected)

    def expect(
        self,
        occupancy: Float[Tensor, "b 8 8 8 17"],
        holding: Float[Tensor, " b"],
        sentences: Sequence[str],
    ) -> Expected:
        """What the arm is to do, from what was seen and the translator's best trees."""
        count = len(sentences)
        programs, sentence, probabilities = self._propose(sentences, (holding > 0.5).tolist())
        answered = torch.zeros(count, dtype=torch.bool, device=holding.device)
        if not programs:
            nothing = occupancy.sum() * 0
            cells, values = nothing.expand(count, CELLS), 2 * self.fusion.table.shape[1] + 2
            return Expected(cells, cells, cells[:, 0], nothing.expand(count, values), answered)
        packed, held = pack(programs), holding[sentence]
        execution, ends = self.fusion.execute(packed, occupancy[sentence], held)
        weight = self.fusion.weigh(packed, probabilities, held, execution, sentence)

        def mean(values: Float[Tensor, "k _"]) -> Float[Tensor, "b _"]:
            rows = values.new_zeros(count, values.shape[1])
            return rows.index_add(0, sentence, weight[:, None] * values)

        grasp, place, kept = execution.source.exp(), execution.target.exp(), ends.sigmoid()
        joints = self.fusion.joints(grasp, place, held, kept)
        answered[sentence] = True
        return Expected(mean(grasp), mean(place), mean(kept[:, None])[:, 0], mean(joints), answered)

    def _propose(
        self, sentences: Sequence[str], holding: Sequence[bool]
    ) -> tuple[list[TreeProgram], Int[Tensor, " k"], Float[Tensor, " k"]]:
        """Trees that can be carried out, the sentence of each, and its probability.

        The search and the probabilities are of the network without dropout, as at inference.
        """
        training = self.language.training
        self.language.eval()
        read = self.translator.read(sentences, holding, beam=self.readings + 1, count=self.readings)
        programs: list[TreeProgram] = []
        rows: list[int] = []
        runs: list[tuple[str, ...]] = []
        for row, readings in enumerate(read):
            for reading in readings:
                try:
                    programs.append(compile_tree(reading.tree))
                except PlanningError:
                    continue
                rows.append(row)
                runs.append(reading.symbols)
        probabilities = torch.zeros(0)
        if programs:
            probabilities = self.translator.log_probabilities(
                [sentences[row] for row in rows], [holding[row] for row in rows], runs
            ).exp()
        self.language.train(training)
        return programs, torch.tensor(rows, dtype=torch.long), probabilities
