"""The one move that leads from a layout to another."""

from fusionnet.blocks.grid import Layout, Move


def move_between(before: Layout, after: Layout) -> Move | None:
    """The one move that leads from one layout to another; None if there is no such move."""
    begins, ends = before.held, after.held
    gone, come = set(before.blocks) - set(after.blocks), set(after.blocks) - set(before.blocks)
    if len(gone) == len(come) == 1:
        source, target = gone.pop(), come.pop()
        same = (source.color, source.shape) == (target.color, target.shape)
        alone = begins in (None, source) and ends in (None, target)
        if same and alone:
            return Move(source.cell, target.cell, begins is not None, ends is not None)
    if not gone and not come and (begins is None) != (ends is None):
        held = begins or ends
        assert held is not None
        return Move(held.cell, held.cell, begins is not None, ends is not None)
    return None
