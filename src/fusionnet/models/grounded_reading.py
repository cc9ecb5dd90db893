"""Which of several readings a layout agrees with: the first that can be executed in it."""

from collections.abc import Sequence
from dataclasses import dataclass

from fusionnet.blocks import Layout, Move, plan
from fusionnet.errors import PlanningError
from fusionnet.models.reading import Reading

LEAST_SHARE = 0.01
"""Below this share of the best reading's probability, another is no reading of the sentence:
training leaves every wrong symbol about a thousandth."""


@dataclass(frozen=True)
class GroundedReading:
    """A reading that can be executed.

    Attributes:
        reading: Tree and probability.
        move: What the arm has to do.
        place: How many more probable readings could not be executed.
        softened: Whether cyan had to pass for blue, or white for gray, or the reverse.
    """

    reading: Reading
    move: Move
    place: int
    softened: bool

    @property
    def remark(self) -> str:
        """What a person should know about the choice, in one sentence; often nothing."""
        remarks = []
        if self.place:
            remarks.append("took a less probable reading, because the scene does not fit the first")
        if self.softened:
            remarks.append("let cyan pass for blue and white for gray, or the reverse")
        return (" and ".join(remarks).capitalize() + ".") if remarks else ""


def grounded(
    readings: Sequence[Reading], layout: Layout, *, least_share: float = LEAST_SHARE
) -> GroundedReading:
    """The first reading that the planner executes; if none, the first with colours softened.

    Args:
        readings: The most probable first.
        layout: The blocks before the command.
        least_share: Readings below this share of the best one's probability do not count.

    Raises:
        PlanningError: If no reading can be executed; says why the best one cannot.
    """
    likely = [r for r in readings if r.probability >= least_share * readings[0].probability]
    reason: PlanningError | None = None
    for softened in (False, True):
        for place, reading in enumerate(likely):
            try:
                move = plan(reading.tree, layout, soften=softened)
            except PlanningError as error:
                reason = reason or error
            else:
                return GroundedReading(reading, move, place, softened)
    raise reason or PlanningError("There is no reading to execute.")
