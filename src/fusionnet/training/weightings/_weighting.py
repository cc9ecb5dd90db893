"""What every weighting does: from named losses to gradients in the parameters."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn
from torchjd.aggregation import Aggregator
from torchjd.autojac import backward as jacobian_backward
from torchjd.autojac import jac_to_grad
from torchjd.scalarization import Scalarizer

Backward = Callable[[Tensor], None]


class Weighting(nn.Module):
    """How several losses move shared parameters; may have parameters of its own.

    Args:
        names: Of the losses, the most important first.

    Attributes:
        ordered: Whether it puts the first loss before the others.
    """

    ordered = False

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__()
        self.names = tuple(names)

    def differentiate(
        self, losses: Tensor, parameters: Sequence[nn.Parameter], backward: Backward
    ) -> None:
        """Accumulate one gradient of all losses in the parameters.

        Args:
            losses: One value a name, already multiplied with their fixed factors.
            parameters: Of the model.
            backward: Differentiates one scalar (Fabric's, which scales and synchronises).
        """
        raise NotImplementedError


class ScalarWeighting(Weighting):
    """Make one scalar of the losses, and differentiate that.

    Args:
        names: Of the losses.
        scalarizer: From the vector of losses to the scalar.
    """

    def __init__(self, names: Sequence[str], scalarizer: Scalarizer) -> None:
        super().__init__(names)
        self.scalarizer = scalarizer

    def differentiate(
        self, losses: Tensor, parameters: Sequence[nn.Parameter], backward: Backward
    ) -> None:
        """Accumulate the gradient of the scalar."""
        backward(self.scalarizer(losses))


class GradientWeighting(Weighting):
    """Differentiate each loss, and aggregate the gradients (Jacobian descent).

    It costs one backward pass a loss, and needs one device and full precision.

    Args:
        names: Of the losses.
        aggregator: From the matrix of gradients, one row a loss, to one gradient.
        ordered: Whether it puts the first loss before the others.

    References:
        Quinton and Rey (2024), Jacobian descent for multi-objective optimization.
    """

    def __init__(
        self, names: Sequence[str], aggregator: Aggregator, *, ordered: bool = False
    ) -> None:
        super().__init__(names)
        self.aggregator = aggregator
        self.ordered = ordered

    def differentiate(
        self, losses: Tensor, parameters: Sequence[nn.Parameter], backward: Backward
    ) -> None:
        """Accumulate the aggregated gradient; parameters that no loss needs get none."""
        reached = _reached(losses, parameters)
        jacobian_backward(losses, inputs=reached, parallel_chunk_size=1)
        jac_to_grad(reached, self.aggregator)


def _reached(losses: Tensor, parameters: Sequence[nn.Parameter]) -> list[nn.Parameter]:
    """The parameters that the losses depend on."""
    wanted = [p for p in parameters if p.requires_grad]
    found = torch.autograd.grad(losses.sum(), wanted, retain_graph=True, allow_unused=True)
    return [p for p, gradient in zip(wanted, found, strict=True) if gradient is not None]
