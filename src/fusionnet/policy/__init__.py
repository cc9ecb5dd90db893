"""Policies: checkpoint; image and sentence to joint angles, and the evidence for them."""

from fusionnet.policy._answer import LEAST_SCORE, Answer, Detection, Pose
from fusionnet.policy._check import FARTHEST, disagreement
from fusionnet.policy._eyes import both_seen
from fusionnet.policy._placing import block_shift, with_boxed_blocks
from fusionnet.policy._policy import (
    SHIPPED,
    Kind,
    Policy,
    detector_folder,
    load_policy,
    weights_folder,
)
from fusionnet.policy._servo import Servo

__all__ = [
    "FARTHEST",
    "LEAST_SCORE",
    "SHIPPED",
    "Answer",
    "Detection",
    "Kind",
    "Policy",
    "Pose",
    "Servo",
    "block_shift",
    "both_seen",
    "detector_folder",
    "disagreement",
    "load_policy",
    "weights_folder",
    "with_boxed_blocks",
]
