"""The check before a move: do the neural and the symbolic answer agree?"""

from fusionnet.blocks import Move
from fusionnet.errors import DoubtError

FARTHEST = 1
"""Cells, along any axis, by which the two answers may differ at either end of the move."""

LEAST_AGREEMENT = 0.6
"""Share of the planner's votes that the elected move must have, chosen on validation scenes."""


def disagreement(pointed: Move, elected: Move, agreement: float) -> str:
    """Why not to move, as a clause; empty if there is no reason.

    Args:
        pointed: What FusionNet's fourteen values do: where they grasp and place, and whether the
            gripper is closed when they begin and when they end.
        elected: The move that the planner's vote elected.
        agreement: Share of the votes for it.
    """
    for verb, cell, other in (
        ("grasp", pointed.source, elected.source),
        ("place", pointed.target, elected.target),
    ):
        apart = max(abs(a - b) for a, b in zip(cell, other, strict=True))
        if apart > FARTHEST:
            return (
                f"the network would {verb} at {tuple(cell)} and the planner at {tuple(other)}, "
                f"{apart} cells apart"
            )
    if pointed.begins_held != elected.begins_held:
        held = "that the hand already holds" if pointed.begins_held else "that stands on the board"
        return f"the network would move a block {held}, and the planner would not"
    if pointed.ends_held != elected.ends_held:
        does = "keep the block in the hand" if pointed.ends_held else "let go of the block"
        return f"the network would {does}, and the planner would not"
    if agreement < LEAST_AGREEMENT:
        return (
            f"only {agreement:.0%} of the layouts that may be there lead to the same move "
            f"(at least {LEAST_AGREEMENT:.0%} should)"
        )
    return ""


def refuse_doubtful(pointed: Move, elected: Move, agreement: float) -> None:
    """Raise if there is a reason not to move; see `disagreement`.

    Raises:
        DoubtError: With the reason.
    """
    reason = disagreement(pointed, elected, agreement)
    if reason:
        raise DoubtError(f"I would rather not move: {reason}. Look again, or say it otherwise.")
