"""All that one `fusionnet run` saw, understood and did, and what that amounts to."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8

from fusionnet import robots
from fusionnet.apps.cli import EXIT_MISSED, EXIT_REACHED
from fusionnet.apps.drawing import Box
from fusionnet.apps.output_folder import RESULT_KIND
from fusionnet.blocks import Layout, layout_to_json
from fusionnet.policy import Answer, ThesisAnswer
from fusionnet.rcl import format as format_tree
from fusionnet.sentences import tokenize
from fusionnet.simulation import Episode

Reference = Literal["recorded", "understood"]
"""Where the layout that the episode is judged by comes from: the corpus recorded it, or the
planner reached it by executing the command, as it was read, in the true layout."""

SCHEMA_VERSION = 1

SURE = 0.5
"""Least score of a box that is shown; result.json has them all."""


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """One run of the whole path.

    Attributes:
        sentence: What was said.
        policy: Which policy answered.
        checkpoint: Where its networks come from.
        robot: Which robot moved.
        origin: Where the scene came from, in words.
        seed: Everything random derives from it.
        picture: What the eye saw, RGB.
        answer: What the policy saw, understood and answered.
        episode: What the arm then did.
        layout: The simulated world before the episode.
        layout_is_read: Whether that world was built from what the network read in the
            picture, because the picture came from a file and nothing else is known.
        expected: The layout that was asked for, where there is a reference.
        reference: Where `expected` comes from.
        seconds: Wall time by stage.
    """

    sentence: str
    policy: str
    checkpoint: str
    robot: str
    origin: str
    seed: int
    picture: UInt8[np.ndarray, "h w 3"]
    answer: Answer | ThesisAnswer
    episode: Episode
    layout: Layout
    layout_is_read: bool
    expected: Layout | None
    reference: Reference | None
    seconds: dict[str, float]

    @property
    def words(self) -> list[str]:
        """The tokens that the tree's word positions count."""
        return [token.text for token in tokenize(self.sentence)]

    @property
    def boxes(self) -> list[Box]:
        """The blocks that the network found in the picture (`SURE` at least), surest first."""
        found = [
            Box(d.class_name, float(d.score), tuple(float(c) for c in d.box))  # type: ignore[arg-type]
            for d in self.answer.boxes
            if d.score >= SURE
        ]
        return sorted(found, key=lambda box: -box.score)

    @property
    def status(self) -> int:
        """The exit status: 1 when what was asked for was not reached, otherwise 0."""
        return EXIT_MISSED if self.episode.success is False else EXIT_REACHED

    @property
    def verdict(self) -> str:
        """The outcome in one sentence."""
        reason = str(self.episode.reason).rstrip(".")
        if self.episode.success is None:
            return f"Done, with nothing to compare it with: {_lower_first(reason)}."
        if not self.episode.success:
            return f"Missed: {_lower_first(reason)}."
        if self.reference == "recorded":
            return "Reached: every block stands where the corpus recorded it."
        return "Reached: every block stands where the command, as it was read, puts it."

    def as_json(self, files: Sequence[str] = ()) -> dict[str, Any]:
        """The record without its pictures, as JSON values.

        Args:
            files: Names of the files written beside it.
        """
        robot = robots.load(self.robot)
        return {
            "kind": RESULT_KIND,
            "schema_version": SCHEMA_VERSION,
            "sentence": self.sentence,
            "policy": self.policy,
            "checkpoint": self.checkpoint,
            "robot": self.robot,
            "origin": self.origin,
            "seed": self.seed,
            "success": self.episode.success,
            "verdict": self.verdict,
            "exit_status": self.status,
            "reference": self.reference,
            "words": self.words,
            "tree": None if self.answer.tree is None else format_tree(self.answer.tree),
            "layout_before": layout_to_json(self.layout),
            "layout_before_is_read_from_the_picture": self.layout_is_read,
            "layout_expected": None if self.expected is None else layout_to_json(self.expected),
            "joints": list(robot.joint_names),
            "joint_units": robot.joint_units,
            "answer": self.answer.as_json(),
            "episode": self.episode.as_json(),
            "seconds": {stage: round(value, 3) for stage, value in self.seconds.items()},
            "versions": versions(),
            "files": list(files),
        }


def versions() -> dict[str, str]:
    """The versions that a result depends on."""
    found = {"python": platform.python_version()}
    for package in ("fusionnet", "torch", "torchvision", "mujoco", "numpy"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _lower_first(text: str) -> str:
    """A sentence as the second half of another one: "The arm …" becomes "the arm …"."""
    return text[:1].lower() + text[1:]
