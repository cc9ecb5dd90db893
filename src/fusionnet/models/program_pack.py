"""Programs of several trees side by side, so that one tensor operation serves a level of all."""

from collections.abc import Sequence as Run
from typing import NamedTuple

import torch
from jaxtyping import Int
from torch import Tensor

from fusionnet.models.program_values import MOST_COLORS
from fusionnet.models.tree_program import Related, Step, TreeProgram


class PackedRelations(NamedTuple):
    """Relations of the steps (or targets) numbered `subject` to the steps `landmark`."""

    subject: Int[Tensor, " m"]
    number: Int[Tensor, " m"]
    landmark: Int[Tensor, " m"]
    ranks: Tensor


class PackedLevel(NamedTuple):
    """The steps of one level of several trees; numbers of steps count over the whole pack."""

    example: Int[Tensor, " n"]
    attributes: Int[Tensor, " a"]
    attribute_offsets: Int[Tensor, " n"]
    colors: Int[Tensor, "n 3"]
    kind: Int[Tensor, " n"]
    held: Int[Tensor, " n"]
    moved: Int[Tensor, " n"]
    ranks: Tensor
    relations: PackedRelations


class PackedPrograms(NamedTuple):
    """Several programs side by side.

    Attributes:
        levels: The steps, level by level.
        order: For each step of the pack: its example and its place in that program.
        source: Step of the moved block of each example.
        goal: Goal of each example.
        destination: Relations of the examples' targets.
        held: Whether the block must be in the hand already, for each example.
        ends_held: Whether it stays in the hand.
    """

    levels: tuple[PackedLevel, ...]
    order: tuple[tuple[int, int], ...]
    source: Int[Tensor, " b"]
    goal: Int[Tensor, " b"]
    destination: PackedRelations
    held: Int[Tensor, " b"]
    ends_held: Tensor


NOTHING = -1
"""Stands for no colour and for no moved block."""


def pack(programs: Run[TreeProgram]) -> PackedPrograms:
    """Lay programs side by side, ordered by level."""
    entries = [(e, i, s) for e, p in enumerate(programs) for i, s in enumerate(p.steps)]
    entries.sort(key=lambda entry: entry[2].level)
    place = {(e, i): n for n, (e, i, _) in enumerate(entries)}
    levels = []
    for level in range(1 + max(s.level for _, _, s in entries)):
        found = [(e, s) for e, _, s in entries if s.level == level]
        levels.append(_pack_level(found, place))
    destinations = [(e, e, p.destination) for e, p in enumerate(programs) if p.destination]
    return PackedPrograms(
        levels=tuple(levels),
        order=tuple((e, i) for e, i, _ in entries),
        source=torch.tensor([place[e, p.source] for e, p in enumerate(programs)]),
        goal=torch.tensor([int(p.goal) for p in programs]),
        destination=_pack_relations(destinations, place),
        held=torch.tensor([int(p.held) for p in programs]),
        ends_held=torch.tensor([p.ends_held for p in programs]),
    )


def _pack_level(found: list[tuple[int, Step]], place: dict[tuple[int, int], int]) -> PackedLevel:
    steps = [step for _, step in found]
    lengths = torch.tensor([len(step.attributes) for step in steps])
    colors = [(*s.colors, *[NOTHING] * (MOST_COLORS - len(s.colors))) for s in steps]
    moved = [NOTHING if s.moved is None else place[e, s.moved] for e, s in found]
    relations = [(row, e, r) for row, (e, s) in enumerate(found) for r in s.related]
    return PackedLevel(
        example=torch.tensor([e for e, _ in found]),
        attributes=torch.tensor([a for s in steps for a in s.attributes]),
        attribute_offsets=lengths.cumsum(0) - lengths,
        colors=torch.tensor(colors),
        kind=torch.tensor([int(s.kind) for s in steps]),
        held=torch.tensor([int(s.held) for s in steps]),
        moved=torch.tensor(moved),
        ranks=torch.tensor([s.ranks for s in steps]),
        relations=_pack_relations(relations, place),
    )


def _pack_relations(
    found: list[tuple[int, int, Related]], place: dict[tuple[int, int], int]
) -> PackedRelations:
    """Tensors of (row of the subject, example, relation) triples."""
    return PackedRelations(
        subject=torch.tensor([row for row, _, _ in found], dtype=torch.long),
        number=torch.tensor([r.number for _, _, r in found], dtype=torch.long),
        landmark=torch.tensor([place[e, r.landmark] for _, e, r in found], dtype=torch.long),
        ranks=torch.tensor([r.ranks for _, _, r in found], dtype=torch.bool),
    )
