"""FusionNet: what is seen and what is said become the arm's fourteen values.

`compact()`, the model that we ship, takes two intermediate representations: the
occupancy of the grid, read from a picture, and Robot Command Language trees, translated
from the sentence. A tree executor fuses them into a distribution over cells for the
grasp and one for the place, from which the joint values follow by the robot's
cell-to-joint table: as an expectation in training, from the likeliest cell and its
neighbours at inference.

References:
    Thesis, sections 4.2 (scaling), 4.3 and chapter 8 (attention between the modalities).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, mse_loss, nll_loss

from fusionnet.blocks.grid import GRID
from fusionnet.errors import CheckpointError, InputError, PlanningError
from fusionnet.models.checkpoint import load_checkpoint, restore, save_checkpoint
from fusionnet.models.fusers.tree_executor import Execution, TreeExecutor
from fusionnet.models.hub import check_robot, checkpoint_folder
from fusionnet.models.program_pack import PackedPrograms, pack
from fusionnet.models.program_values import Goal, Held
from fusionnet.models.soft_layout import CELLS, soft_layout
from fusionnet.models.tree_program import TreeProgram, compile_tree
from fusionnet.rcl import Entity, Tree

KIND = "fusionnet"
MICRO = 1e-6
"""Joint tables are stored as whole micro-radians, which no half precision touches."""


UNUSUAL = 0.1
"""Share of what is spoken of that is found less surely than usual."""


@dataclass(frozen=True)
class FusionAnswer:
    """What the network answers to a picture's reading and a sentence's trees.

    Attributes:
        targets: Grasp joints [rad], gripper, place joints [rad], gripper (1 closed).
        source: Probability of each cell to be where the block is taken from.
        target: Probability of each cell to be where it goes.
        source_cell: Index of the cell of the grasp.
        target_cell: Index of the cell of the place.
        confidence: Probability of the two cells together.
        ends_held: Probability that the block stays in the hand.
        evidence: How surely the layout has what the reading speaks of, against the usual, 0 to 1.
        weights: Probability of each reading that makes sense, after looking at the layout.
        reading: Index, among the given readings, of the one that decided.
        attention: Each entity of the reading that decided, and how strongly each cell
            belongs to it; landmarks come before what is related to them.
    """

    targets: Float[np.ndarray, " targets"]
    source: Float[np.ndarray, "512"]
    target: Float[np.ndarray, "512"]
    source_cell: int
    target_cell: int
    confidence: float
    ends_held: float
    evidence: float
    weights: tuple[float, ...]
    reading: int
    attention: list[tuple[Entity, Float[np.ndarray, "512"]]]


class FusionNet(nn.Module):
    """Fuse occupancy probabilities with trees into joint values.

    Args:
        robot: Name of the robot that the joint table belongs to.
        joint_names: Its arm's joints.
        joint_limits: Lowest and highest value of each [rad], for scaling to 0 ... 1.
        joint_table: Values of the joints for each of the 512 cells [rad]; may be left
            out when the weights are filled in afterwards.
    """

    def __init__(
        self,
        *,
        robot: str,
        joint_names: Sequence[str],
        joint_limits: Sequence[Sequence[float]],
        joint_table: Float[np.ndarray, "512 n"] | None = None,
    ) -> None:
        super().__init__()
        joints = len(joint_names)
        if np.shape(joint_limits) != (joints, 2):
            raise CheckpointError(f"{joints} joints need as many pairs of limits.")
        self.config: dict[str, Any] = {
            "robot": robot,
            "joint_names": list(joint_names),
            "joint_limits": [[float(v) for v in pair] for pair in joint_limits],
        }
        table = np.zeros((CELLS, joints)) if joint_table is None else joint_table
        micro = torch.from_numpy(np.rint(np.asarray(table) / MICRO).astype(np.int32))
        self.register_buffer("table", micro)
        limits = torch.tensor(self.config["joint_limits"], dtype=torch.float32)
        self.register_buffer("limits", limits, persistent=False)
        self.executor = TreeExecutor()
        self.ends = nn.Parameter(torch.zeros(len(Goal)))
        place = torch.arange(CELLS)
        cells = torch.stack([place // GRID**2, place // GRID % GRID, place % GRID], dim=1)
        near = (cells[:, None] - cells[None]).abs().amax(2) <= 1
        self.register_buffer("near", near, persistent=False)

    table: Tensor
    limits: Tensor
    near: Tensor

    @property
    def scaled_table(self) -> Float[Tensor, "512 n"]:
        """The joint table scaled to 0 ... 1 by the joint limits (thesis 4.2)."""
        low, high = self.limits.T
        return (self.table * MICRO - low) / (high - low)

    def execute(
        self,
        programs: PackedPrograms,
        occupancy: Float[Tensor, "b 8 8 8 17"],
        holding: Float[Tensor, " b"],
    ) -> tuple[Execution, Float[Tensor, " b"]]:
        """Log distributions over cells, and the logit of the block ending held."""
        execution = self.executor(programs, soft_layout(occupancy, holding))
        return execution, self.ends[programs.goal]

    def joints(
        self,
        source: Float[Tensor, "b 512"],
        target: Float[Tensor, "b 512"],
        holding: Float[Tensor, " b"],
        ends_held: Float[Tensor, " b"],
    ) -> Float[Tensor, "b _"]:
        """The fourteen scaled values that are expected under two distributions over cells."""
        table = self.scaled_table
        parts = [source @ table, holding[:, None], target @ table, ends_held[:, None]]
        return torch.cat(parts, dim=1)

    def weigh(
        self,
        programs: PackedPrograms,
        probabilities: Float[Tensor, " k"],
        holding: Float[Tensor, " k"],
        execution: Execution,
        sentence: Int[Tensor, " k"],
    ) -> Float[Tensor, " k"]:
        """The share of each reading in the answer to its sentence; they sum to 1 a sentence.

        A reading counts by its probability, by whether the gripper holds a block where it has
        to, and by how well the layout has what it speaks of.

        Args:
            programs: The readings.
            probabilities: Of each, as the translator sees it.
            holding: Probability that the gripper holds a block, for each.
            execution: Of the readings, on what was seen.
            sentence: Number of the sentence that each is a reading of.
        """
        possible = torch.where(programs.held == Held.YES, holding, 1 - holding)
        possible = torch.where(programs.held == Held.IF_ANY, 1.0, possible).clamp(min=1e-3)
        weight = probabilities * possible * execution.evidence + 1e-12
        total = weight.new_zeros(int(sentence.max()) + 1).index_add(0, sentence, weight)
        return weight / total[sentence]

    def losses(
        self,
        programs: PackedPrograms,
        occupancy: Float[Tensor, "b 8 8 8 17"],
        holding: Float[Tensor, " b"],
        source: Tensor,
        target: Tensor,
        begins: Float[Tensor, " b"],
    ) -> dict[str, Tensor]:
        """Named losses of a batch.

        - `grasp`, `place`: cross-entropy of the cells with the indices `source`, `target`
        - `holds`: binary cross-entropy of the block ending held
        - `joints`: mean squared error of the fourteen scaled values (thesis 4.3.2)
        - `evidence`: quantile loss of how surely what is spoken of is usually found;
          it moves nothing else
        """
        execution, ends = self.execute(programs, occupancy, holding)
        wanted = programs.ends_held.float()
        expected = self.joints(
            execution.source.exp(), execution.target.exp(), holding, ends.sigmoid()
        )
        table = self.scaled_table
        truth = torch.cat([table[source], begins[:, None], table[target], wanted[:, None]], dim=1)
        return {
            "grasp": nll_loss(execution.source, source),
            "place": nll_loss(execution.target, target),
            "holds": binary_cross_entropy_with_logits(ends, wanted),
            "joints": mse_loss(expected, truth),
            "evidence": _quantile_loss(execution.found.detach() - execution.usual),
        }

    @torch.inference_mode()
    def forward(
        self,
        occupancy: Float[np.ndarray, "8 8 8 17"],
        holding: float,
        readings: Sequence[tuple[Tree, float]],
    ) -> FusionAnswer:
        """The answer to one picture and the k best readings of one sentence.

        A reading counts by its probability and by how well the layout has what it
        speaks of; the pair of cells with the greatest sum over readings is chosen.

        Args:
            occupancy: Probabilities of the 16 classes and of emptiness for each cell.
            holding: Probability that the gripper holds a block.
            readings: Trees and their probabilities, the likeliest first.

        Raises:
            InputError: If an array has the wrong shape, or there is no reading.
            PlanningError: If no reading makes sense, whatever the layout.
        """
        if not readings:
            raise InputError("There is no reading of the sentence; give at least one.")
        programs, weights, kept = _programs_of(readings)
        cells = torch.from_numpy(np.array(occupancy, dtype=np.float32))
        if cells.shape != (GRID, GRID, GRID, 17):
            raise InputError(f"The occupancy must have shape (8, 8, 8, 17), not {cells.shape}.")
        packed = pack(programs)
        held = torch.full((len(programs),), float(holding))
        expanded = cells.expand(len(programs), -1, -1, -1, -1)
        execution, ends = self.execute(packed, expanded, held)
        one_sentence = torch.zeros(len(programs), dtype=torch.long)
        weight = self.weigh(packed, weights, held, execution, one_sentence)
        source, target = execution.source.exp(), execution.target.exp()
        pair = torch.einsum("k,ki,kj->ij", weight, source, target)
        best = int(pair.argmax())
        source_cell, target_cell = best // CELLS, best % CELLS
        chosen = weight * source[:, source_cell] * target[:, target_cell]
        ends_held = (chosen @ ends.sigmoid()) / chosen.sum()
        grasp = self._sharpened(pair[:, target_cell], source_cell)
        place = self._sharpened(pair[source_cell], target_cell)
        scaled = self.joints(grasp, place, held[:1].round(), ends_held[None].round())[0]
        likeliest = int(chosen.argmax())
        attention = [
            (programs[likeliest].steps[step].entity, execution.steps[row].exp().numpy())
            for row, (example, step) in enumerate(packed.order)
            if example == likeliest
        ]
        return FusionAnswer(
            targets=self.unscale(scaled.double().numpy()),
            source=(weight @ source).numpy(),
            target=(weight @ target).numpy(),
            source_cell=source_cell,
            target_cell=target_cell,
            confidence=float(pair[source_cell, target_cell]),
            ends_held=float(ends_held),
            evidence=float(execution.evidence[likeliest]),
            weights=tuple(weight.tolist()),
            reading=kept[likeliest],
            attention=attention,
        )

    def _sharpened(self, mass: Float[Tensor, "512"], cell: int) -> Float[Tensor, "1 512"]:
        """A distribution on a cell and its neighbours, its weights raised to the eighth power."""
        local = torch.where(self.near[cell], mass / mass[cell], 0.0) ** 8
        return (local / local.sum())[None]

    def unscale(self, scaled: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Fourteen values from 0 ... 1 to radians; gripper values stay as they are."""
        low, high = np.asarray(self.config["joint_limits"]).T
        low = np.concatenate([low, [0.0], low, [0.0]])
        high = np.concatenate([high, [1.0], high, [1.0]])
        return np.asarray(scaled) * (high - low) + low

    def save(self, folder: Path | str, metadata: dict[str, Any] | None = None) -> None:
        """Write a checkpoint folder with its model card, in half precision but for the joint table.

        Raises:
            OutputError: If it cannot be written.
        """
        save_checkpoint(
            Path(folder),
            kind=KIND,
            config=self.config,
            tensors=self.state_dict(),
            metadata=metadata,
            half=True,
        )

    save_pretrained = save

    @classmethod
    def from_pretrained(cls, name: Path | str, *, robot: str | None = None) -> "FusionNet":
        """Read a checkpoint from a folder or, by `owner/name`, from the hub.

        Args:
            name: Folder or hub name.
            robot: Robot whose values are wanted; by default whichever it was trained for.

        Raises:
            CheckpointError: If it cannot be had, is damaged, or is of another kind, schema
                version or robot.
        """
        model = cls.from_folder(checkpoint_folder(name))
        check_robot(str(name), model.config["robot"], model.config["joint_names"], robot)
        return model

    @classmethod
    def from_folder(cls, folder: Path | str) -> "FusionNet":
        """Read a checkpoint folder.

        Raises:
            CheckpointError: If it is missing, damaged, or of another kind or version.
        """
        checkpoint = load_checkpoint(Path(folder), KIND)
        try:
            model = cls(**checkpoint.config)
        except (TypeError, ValueError) as error:
            raise CheckpointError(f"The configuration in {folder} is not valid: {error}") from error
        restore(model, checkpoint.tensors, Path(folder))
        return model.eval()


def _quantile_loss(above: Float[Tensor, " m"]) -> Float[Tensor, ""]:
    """Least where a share of `UNUSUAL` is below zero."""
    return torch.where(above > 0, UNUSUAL * above, (UNUSUAL - 1) * above).mean()


def _programs_of(
    readings: Sequence[tuple[Tree, float]],
) -> tuple[list[TreeProgram], Float[Tensor, " k"], list[int]]:
    """Programs of the readings that make sense, their weights and indices."""
    programs: list[TreeProgram] = []
    weights: list[float] = []
    kept: list[int] = []
    refusal = PlanningError("The sentence was not understood.")
    for index, (tree, probability) in enumerate(readings):
        try:
            programs.append(compile_tree(tree))
        except PlanningError as error:
            refusal = error if tree is readings[0][0] else refusal
            continue
        weights.append(max(float(probability), 1e-9))
        kept.append(index)
    if not programs:
        raise refusal
    return programs, torch.tensor(weights), kept


def compact(robot: str = "nico") -> FusionNet:
    """The untrained network that we ship, for one robot of the catalogue."""
    from fusionnet import robots

    body = robots.load(robot)
    return FusionNet(
        robot=body.name,
        joint_names=body.joint_names,
        joint_limits=body.joint_limits.tolist(),
        joint_table=body.joint_table.reshape(CELLS, -1),
    )
