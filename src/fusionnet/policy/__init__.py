"""Policies: checkpoint; image and sentence to joint angles, and the evidence for them."""

from fusionnet.models.policy_folder import (
    SHIPPED,
    detector_folder,
    view_detector_folder,
    weights_folder,
)
from fusionnet.policy._answer import LEAST_SCORE, Answer, Detection, Pose
from fusionnet.policy._attention import Attention
from fusionnet.policy._check import FARTHEST, disagreement
from fusionnet.policy._eyes import EYE_WEIGHT, both_seen
from fusionnet.policy._placing import block_shift, with_boxed_blocks
from fusionnet.policy._policy import Kind, Policy, load_policy
from fusionnet.policy._servo import Servo
from fusionnet.policy._thesis import ThesisAnswer, ThesisPolicy

__all__ = [
    "EYE_WEIGHT",
    "FARTHEST",
    "LEAST_SCORE",
    "SHIPPED",
    "Answer",
    "Attention",
    "Detection",
    "Kind",
    "Policy",
    "Pose",
    "Servo",
    "ThesisAnswer",
    "ThesisPolicy",
    "block_shift",
    "both_seen",
    "detector_folder",
    "disagreement",
    "load_policy",
    "view_detector_folder",
    "weights_folder",
    "with_boxed_blocks",
]
