"""The optimisers: AdamW for what we ship; SGD with momentum and Adam as in the thesis."""

from dataclasses import dataclass
from typing import Any, Literal

import torch

from fusionnet.errors import InputError


@dataclass(frozen=True, kw_only=True)
class OptimizerConfig:
    """Which optimiser.

    Attributes:
        kind: adamw, sgd (RetinaNet, table 6.1) or adam (tables 5.1 and 7.3).
        weight_decay: On matrices only; for sgd and adam it is an L2 penalty, as in the thesis.
        momentum: Of sgd.
        beta_1: Decay of Adam's first moment.
        beta_2: Decay of Adam's second moment.
        epsilon: Added to the root of Adam's second moment.
    """

    kind: Literal["adamw", "sgd", "adam"] = "adamw"
    weight_decay: float = 0.01
    momentum: float = 0.9
    beta_1: float = 0.9
    beta_2: float = 0.999
    epsilon: float = 1e-8

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        decays = (self.momentum, self.beta_1, self.beta_2)
        if self.weight_decay < 0 or self.epsilon <= 0 or not all(0 <= d < 1 for d in decays):
            raise InputError(
                "weight_decay >= 0, epsilon > 0, and momentum, beta_1, beta_2 from 0 to below 1; "
                f"got {self}"
            )


def new_optimizer(
    config: OptimizerConfig, model: torch.nn.Module, learning_rate: float
) -> torch.optim.Optimizer:
    """The optimiser of a model's parameters that ask for a gradient."""
    groups = _groups(model, config.weight_decay)
    if config.kind == "sgd":
        return torch.optim.SGD(groups, lr=learning_rate, momentum=config.momentum)
    kind = torch.optim.AdamW if config.kind == "adamw" else torch.optim.Adam
    betas = (config.beta_1, config.beta_2)
    return kind(groups, lr=learning_rate, betas=betas, eps=config.epsilon, fused=True)


def _groups(model: torch.nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    matrices = [p for p in model.parameters() if p.requires_grad and p.ndim > 1]
    vectors = [p for p in model.parameters() if p.requires_grad and p.ndim <= 1]
    return [
        {"params": matrices, "weight_decay": weight_decay},
        {"params": vectors, "weight_decay": 0.0},
    ]
