"""What a policy answers: joint angles, and the evidence for them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import CLASS_NAMES, Cell, Layout, Move, layout_to_json
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera
from fusionnet.models.labelled_boxes import Boxes
from fusionnet.models.translator import Reading
from fusionnet.policy._attention import Attention, attended_pixels
from fusionnet.rcl import Tree, describe
from fusionnet.rcl import format as format_tree

LEAST_SCORE = 0.5
"""Detections below this score are no evidence; measuring precision needs them, people do not."""

LEAST_SHARE = 0.01
"""Words and cells with a smaller share of an attention are left out of its JSON."""


@dataclass(frozen=True, eq=False)
class Pose:
    """One posture of the arm.

    Attributes:
        joint_angles: In radians, or metres for joints that slide, in the order of the robot's
            `joint_names`.
        gripper: 1 closed, 0 open.
    """

    joint_angles: Float[np.ndarray, " n"]
    gripper: float


@dataclass(frozen=True)
class Detection:
    """One block that was found in the picture.

    Attributes:
        class_name: One of `blocks.CLASS_NAMES`.
        score: Probability, 0 to 1.
        box: Left, top, right, bottom in pixels of the picture.
    """

    class_name: str
    score: float
    box: tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What the arm is to do, and why.

    Attributes:
        grasp: The arm where it takes the block; the gripper is closed if it holds one already.
        place: The arm where it lets go; the gripper stays closed if the block is to be held.
        boxes: Blocks found in the picture, with a score of at least `LEAST_SCORE`.
        layout: The most likely layout of the blocks.
        cells: Probabilities of 16 classes and of emptiness for every cell.
        holding: Probability that the gripper held a block in the picture.
        readings: The sentence's readings, most likely first.
        tree: The reading that was acted on.
        source: Probability of each cell to be grasped at.
        target: Probability of each cell to be placed at.
        source_cell: Where it is grasped: together with `target_cell` the likeliest pair.
        target_cell: Where it is placed.
        move: The move that the planner's vote elected.
        agreement: Share of the votes for that move.
        confidence: Of the policy that answers, in its grasp and place cells together.
        attention: What each part of the tree rests on: every entity, landmarks first, then the
            grasp and the place.
        camera: The eye as it was estimated, for the picture that was shown; the board's frame
            stands for the robot's.
        milliseconds: Time spent by stage.
    """

    grasp: Pose
    place: Pose
    boxes: tuple[Detection, ...]
    layout: Layout
    cells: Float[np.ndarray, "8 8 8 17"]
    holding: float
    readings: tuple[Reading, ...]
    tree: Tree
    source: Float[np.ndarray, "512"]
    target: Float[np.ndarray, "512"]
    source_cell: Cell
    target_cell: Cell
    move: Move
    agreement: float
    confidence: float
    attention: tuple[Attention, ...] = ()
    camera: PinholeCamera | None = None
    milliseconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def targets(self) -> Float[np.ndarray, " k"]:
        """The flat vector of the thesis (4.3.1): grasp and place, each joints and gripper."""
        return flat_targets(self.grasp, self.place)

    @property
    def understood(self) -> str:
        """What was acted on, in plain English."""
        return describe(self.tree)

    def pixels(self, attention: Attention) -> Float[np.ndarray, "h w"]:
        """Which part of the eye's picture an attention looked at, 1 where it looked most.

        Raises:
            InputError: If the policy that answered estimates no camera.
        """
        if self.camera is None:
            raise InputError("This answer has no camera: its policy does not say where it looked.")
        return attended_pixels(attention.cells, self.layout, self.camera)

    def as_json(self) -> dict[str, Any]:
        """JSON values of everything but the large arrays."""
        return {
            "grasp": pose_as_json(self.grasp),
            "place": pose_as_json(self.place),
            "boxes": boxes_as_json(self.boxes),
            "layout": layout_to_json(self.layout),
            "holding": round(self.holding, 4),
            "readings": [
                {"tree": format_tree(r.tree), "probability": round(r.probability, 6)}
                for r in self.readings
            ],
            "tree": format_tree(self.tree),
            "source_cell": list(self.source_cell),
            "target_cell": list(self.target_cell),
            "source_cells": _likely_cells(self.source),
            "target_cells": _likely_cells(self.target),
            "attention": [
                {
                    "of": part.label,
                    "words": [
                        {"word": word, "share": round(share, 4)}
                        for word, share in part.words
                        if share >= LEAST_SHARE
                    ],
                    "cells": _likely_cells(part.cells, LEAST_SHARE),
                }
                for part in self.attention
            ],
            "symbolic_move": {
                "source": list(self.move.source),
                "target": list(self.move.target),
                "begins_held": self.move.begins_held,
                "ends_held": self.move.ends_held,
                "agreement": round(self.agreement, 4),
            },
            "confidence": round(self.confidence, 4),
            "milliseconds": {stage: round(ms, 1) for stage, ms in self.milliseconds.items()},
        }


def as_detections(boxes: Boxes) -> tuple[Detection, ...]:
    """The boxes that count as evidence."""
    return tuple(
        Detection(CLASS_NAMES[int(kind)], float(score), tuple(float(c) for c in box))  # type: ignore[arg-type]
        for box, kind, score in zip(boxes.xyxy, boxes.classes, boxes.scores, strict=True)
        if score >= LEAST_SCORE
    )


def _likely_cells(distribution: Float[np.ndarray, "512"], least: float = 0.0) -> list[Any]:
    """The three likeliest cells, of those that are likely enough."""
    best = np.argsort(distribution)[::-1][:3]
    return [
        {"cell": list(Cell.from_index(int(i))), "probability": round(float(distribution[i]), 4)}
        for i in best
        if distribution[i] >= least
    ]


def flat_targets(grasp: Pose, place: Pose) -> Float[np.ndarray, " k"]:
    """Both poses as the flat vector of the thesis (4.3.1), each joints and gripper."""
    return np.concatenate(
        [grasp.joint_angles, [grasp.gripper], place.joint_angles, [place.gripper]]
    )


def boxes_as_json(boxes: Sequence[Detection]) -> list[dict[str, Any]]:
    """JSON values of the blocks that were found."""
    return [
        {
            "class": found.class_name,
            "score": round(found.score, 4),
            "box": [round(c, 1) for c in found.box],
        }
        for found in boxes
    ]


def pose_as_json(pose: Pose) -> dict[str, Any]:
    """JSON values of one posture, in radians, or metres for joints that slide."""
    return {
        "joint_values": [round(float(a), 5) for a in pose.joint_angles],
        "gripper": round(pose.gripper, 4),
    }
