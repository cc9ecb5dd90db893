"""How the gradients of several losses lie to each other at the parameters that they share.

The thesis supposed destructive interference between its tasks (7.2.2) and did not
measure it. A cosine below zero between two losses' gradients is such a conflict.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import torch
from torch import Tensor, nn


def gradient_cosines(
    losses: Mapping[str, Tensor], parameters: Sequence[nn.Parameter]
) -> dict[tuple[str, str], float]:
    """The cosine between the gradients of every two losses, at the parameters both reach.

    Pairs that reach no common parameter, or do not move it, are left out.

    Args:
        losses: Named scalars of one batch; their graph is kept.
        parameters: Where to look.

    References:
        Yu et al. (2020), Gradient surgery for multi-task learning, definition 1.
    """
    found: dict[str, dict[int, Tensor]] = {}
    for name, loss in losses.items():
        gradients = torch.autograd.grad(loss, parameters, retain_graph=True, allow_unused=True)
        found[name] = {
            place: gradient.flatten().float()
            for place, gradient in enumerate(gradients)
            if gradient is not None and bool(gradient.any())
        }
    cosines = {}
    for one, other in combinations(found, 2):
        shared = [place for place in found[one] if place in found[other]]
        if shared:
            first = torch.cat([found[one][place] for place in shared])
            second = torch.cat([found[other][place] for place in shared])
            cosines[one, other] = float(first @ second / (first.norm() * second.norm()))
    return cosines


def shared_parameters(
    losses: Mapping[str, Tensor], parameters: Sequence[nn.Parameter]
) -> dict[tuple[str, str], int]:
    """How many numbers both of every two losses reach; 0 means that they cannot conflict."""
    reached: dict[str, set[int]] = {}
    for name, loss in losses.items():
        gradients = torch.autograd.grad(loss, parameters, retain_graph=True, allow_unused=True)
        reached[name] = {i for i, gradient in enumerate(gradients) if gradient is not None}
    return {
        (one, other): sum(parameters[i].numel() for i in reached[one] & reached[other])
        for one, other in combinations(losses, 2)
    }
