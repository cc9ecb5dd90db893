"""The check before a move: do the neural and the symbolic answer agree?"""

from fusionnet.blocks import Cell, Move
from fusionnet.errors import DoubtError

FARTHEST = 1
"""Cells, along any axis, by which the two answers may differ at either end of the move."""

LEAST_AGREEMENT = 0.6
"""Share of the planner's votes that the elected move must have, chosen on validation scenes."""


def disagreement(source: Cell, target: Cell, move: Move, agreement: float) -> str:
    """Why not to move, as a clause; empty if there is no reason.

    Args:
        source: The cell that FusionNet grasps at.
        target: The cell that it places at.
        move: The move that the planner's vote elected.
        agreement: Share of the votes for it.
    """
    for verb, cell, elected in (
        ("grasp", source, move.source),
        ("place", target, move.target),
    ):
        apart = max(abs(a - b) for a, b in zip(cell, elected, strict=True))
        if apart > FARTHEST:
            return (
                f"the network would {verb} at {tuple(cell)} and the planner at {tuple(elected)}, "
                f"{apart} cells apart"
            )
    if agreement < LEAST_AGREEMENT:
        return (
            f"only {agreement:.0%} of the layouts that may be there lead to the same move "
            f"(at least {LEAST_AGREEMENT:.0%} should)"
        )
    return ""


def refuse_doubtful(source: Cell, target: Cell, move: Move, agreement: float) -> None:
    """Raise if there is a reason not to move.

    Raises:
        DoubtError: With the reason.
    """
    reason = disagreement(source, target, move, agreement)
    if reason:
        raise DoubtError(f"I would rather not move: {reason}. Look again, or say it otherwise.")
