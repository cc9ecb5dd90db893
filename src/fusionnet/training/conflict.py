"""How the gradients of several losses lie to each other at the parameters that they share.

The thesis supposed destructive interference between its tasks (7.2.2) and did not
measure it. A cosine below zero between two losses' gradients is such a conflict.
"""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn


def gradient_cosines(
    losses: Mapping[str, Tensor], shared: Sequence[nn.Parameter]
) -> dict[tuple[str, str], float]:
    """The cosine between the gradients of every two losses; pairs with no gradient are left out.

    Args:
        losses: Named scalars of one batch; their graph is kept.
        shared: Parameters that the losses share.

    References:
        Yu et al. (2020), Gradient surgery for multi-task learning, definition 1.
    """
    flat: dict[str, Tensor] = {}
    for name, loss in losses.items():
        found = torch.autograd.grad(loss, shared, retain_graph=True, allow_unused=True)
        parts = [
            torch.zeros_like(p) if g is None else g for p, g in zip(shared, found, strict=True)
        ]
        vector = torch.cat([part.flatten().float() for part in parts])
        if vector.norm() > 0:
            flat[name] = vector / vector.norm()
    names = list(flat)
    return {
        (one, other): float(flat[one] @ flat[other])
        for place, one in enumerate(names)
        for other in names[place + 1 :]
    }
