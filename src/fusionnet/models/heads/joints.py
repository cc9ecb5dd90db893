"""The fourteen values: grasp joints and gripper, place joints and gripper (thesis 4.3).

One layer upon the fused vector with a sigmoid, since the values are scaled to 0 ... 1, and
the mean squared error.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fusionnet.models.heads._head import Example, Features, Head, Shapes


class JointsHead(Head):
    """One sigmoid layer, its weights Glorot's (thesis 4.3.2)."""

    def __init__(self, shapes: Shapes) -> None:
        super().__init__(shapes)
        self.output = nn.Linear(shapes.fused, shapes.joints)
        nn.init.xavier_uniform_(self.output.weight)
        nn.init.zeros_(self.output.bias)

    @staticmethod
    def target(example: Example) -> Float[Tensor, " k"]:
        """The scaled values."""
        return torch.from_numpy(example.joints).float()

    def forward(self, features: Features) -> Float[Tensor, "b k"]:
        """Values from 0 to 1."""
        joints: Tensor = self.output(features.fused).float().sigmoid()
        return joints

    def loss(
        self,
        output: Float[Tensor, "b k"],
        targets: Sequence[Float[Tensor, " k"]],
        features: Features,
    ) -> Tensor:
        """Mean squared error."""
        return nn.functional.mse_loss(output, torch.stack(list(targets)))

    def predict(self, output: Float[Tensor, "b k"]) -> list[Float[Tensor, " k"]]:
        """The scaled values of each example."""
        return list(output.detach().cpu())

    @staticmethod
    def metric(
        found: Sequence[Float[Tensor, " k"]], truth: Sequence[Float[Tensor, " k"]]
    ) -> dict[str, float]:
        """`joint_mse` of the scaled values (thesis, chapter 7)."""
        squared = (torch.stack(list(found)) - torch.stack(list(truth))).square()
        return {"joint_mse": float(squared.mean())}


HEAD = JointsHead
