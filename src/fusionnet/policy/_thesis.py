"""The thesis's FusionNet as a policy: one picture and one sentence in, joint angles out.

It answers the fourteen values and shows what it found and wrote on the way. It reads no layout and
plans nothing: where `Policy` has cells, votes and confidence, it has none.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from fusionnet.blocks import BLOCK_SIZE, Cell
from fusionnet.errors import CheckpointError, InputError, TreeError
from fusionnet.models.checkpoint import checkpoint_kind
from fusionnet.models.labelled_boxes import Boxes
from fusionnet.models.placement import Placement, placement_crop
from fusionnet.models.target_text import written_tree
from fusionnet.models.thesis_fusionnet import KIND, ThesisFusionNet
from fusionnet.policy._answer import (
    Detection,
    Pose,
    as_detections,
    boxes_as_json,
    flat_targets,
    pose_as_json,
)
from fusionnet.policy._eyes import Picture, pictures_of
from fusionnet.rcl import Tree, describe
from fusionnet.rcl import format as format_tree
from fusionnet.robots import ArmKinematics, Robot
from fusionnet.robots import load as load_robot
from fusionnet.sentences import readable_words
from fusionnet.simulation.renderer import shared_renderer


@dataclass(frozen=True, kw_only=True, eq=False)
class ThesisAnswer:
    """What the arm is to do, and what the thesis's FusionNet found and wrote on the way.

    Attributes:
        grasp: The arm where it takes the block; the gripper is closed if it holds one already.
        place: The arm where it lets go; the gripper stays closed if the block is to be held.
        boxes: Blocks found in the picture, with a score of at least `LEAST_SCORE`; none if the
            network was trained without the heads of boxes and classes.
        written: What the Transformer wrote, token by token.
        tree: That as a tree; None if it is none.
        source_cell: The cell that the hand is at when it grasps; None off the grid.
        target_cell: The cell that it is at when it places; None off the grid.
        milliseconds: Time spent by stage.
    """

    grasp: Pose
    place: Pose
    boxes: tuple[Detection, ...]
    written: tuple[str, ...]
    tree: Tree | None
    source_cell: Cell | None
    target_cell: Cell | None
    milliseconds: Mapping[str, float]

    @property
    def targets(self) -> Float[np.ndarray, " k"]:
        """The flat vector of the thesis (4.3.1): grasp and place, each joints and gripper."""
        return flat_targets(self.grasp, self.place)

    @property
    def understood(self) -> str:
        """The tree that was written, in plain English; where it is none, what was written."""
        if self.tree is not None:
            return describe(self.tree)
        return f"no tree: {' '.join(self.written) or 'nothing was written'}"

    def as_json(self) -> dict[str, Any]:
        """JSON values."""
        return {
            "grasp": pose_as_json(self.grasp),
            "place": pose_as_json(self.place),
            "boxes": boxes_as_json(self.boxes),
            "written": " ".join(self.written),
            "tree": None if self.tree is None else format_tree(self.tree),
            "source_cell": None if self.source_cell is None else list(self.source_cell),
            "target_cell": None if self.target_cell is None else list(self.target_cell),
            "milliseconds": {stage: round(ms, 1) for stage, ms in self.milliseconds.items()},
        }


class ThesisPolicy:
    """The thesis's FusionNet behind the call of a policy.

    Args:
        network: Trained; `fusionnet train fusion --preset thesis` writes its checkpoint.
    """

    def __init__(self, network: ThesisFusionNet) -> None:
        self.network = network.eval()
        self.robot: Robot = load_robot(network.config.robot)

    @cached_property
    def _arm(self) -> ArmKinematics:
        return ArmKinematics(self.robot)

    def __call__(self, image: Picture | Sequence[Picture], sentence: str) -> ThesisAnswer:
        """Look, read, and answer with joint angles; joints stop at their limits, as an arm does.

        Args:
            image: What the robot's left eye sees.
            sentence: A command in English.

        Raises:
            NotUnderstoodError: If the sentence is empty, too long or not in English letters.
            InputError: If there is not one picture, or something is no picture.
            RenderingError: If pictures are cropped and the eye cannot be set up here.

        References:
            Thesis 4.3.3.
        """
        pictures = pictures_of(image)
        if len(pictures) != 1:
            raise InputError(
                f"Received {len(pictures)} pictures; the thesis's FusionNet sees with one eye: "
                "give the left eye's picture alone."
            )
        readable_words(sentence)
        began = time.perf_counter()
        place = self._placement((pictures[0].shape[1], pictures[0].shape[0]))
        prepared = torch.from_numpy(place.picture(pictures[0]))[None]
        ready = time.perf_counter()
        joints, [written], found = self.network.answer(prepared, [sentence])
        done = time.perf_counter()
        poses = self._poses(joints[0])
        return ThesisAnswer(
            grasp=poses[0],
            place=poses[1],
            boxes=_detections(found, place),
            written=written,
            tree=self._tree(written),
            source_cell=self._cell(poses[0]),
            target_cell=self._cell(poses[1]),
            milliseconds={"crop": 1000 * (ready - began), "network": 1000 * (done - ready)},
        )

    def _placement(self, size: tuple[int, int]) -> Placement:
        frame = self.network.config.detector.frame
        if not self.network.config.crop:
            return Placement((0, 0, *size), frame)
        eye = shared_renderer(self.robot.name, size).camera("left_eye")
        pose = eye.camera_from_robot @ self.robot.robot_from_board
        return Placement(placement_crop(eye.matrix, pose, size), frame)

    def _poses(self, values: Float[np.ndarray, " k"]) -> tuple[Pose, Pose]:
        low, high = self.robot.joint_limits.T
        grasp, place = (
            Pose(np.clip(half[:-1], low, high), float(half[-1])) for half in np.split(values, 2)
        )
        return grasp, place

    def _tree(self, written: Sequence[str]) -> Tree | None:
        try:
            return written_tree(self.network.config.writes, written)
        except TreeError:
            return None

    def _cell(self, pose: Pose) -> Cell | None:
        """The cell whose block the pinch of a pose would hold."""
        pinch = self._arm.robot_from_pinch(pose.joint_angles)[:3, 3]
        cell = Cell(
            *np.rint((pinch - self.robot.pinch_position((0, 0, 0))) / BLOCK_SIZE)
            .astype(int)
            .tolist()
        )
        return cell if cell.on_grid else None


def thesis_policy(
    folder: Path, kind: str, *, check: bool = False, robot: str | None = None
) -> ThesisPolicy:
    """The policy of a checkpoint of the thesis's FusionNet.

    Args:
        folder: The checkpoint.
        kind: What was asked for; only `fusion` can be had.
        check: Whether the policy was asked to compare itself with another.
        robot: Robot whose values are wanted; by default whichever it was trained for.

    Raises:
        InputError: If it was asked for what this network cannot do.
        CheckpointError: If the checkpoint cannot be used, or is of another robot.
    """
    found = checkpoint_kind(folder)
    if found != KIND:
        raise CheckpointError(
            f"The checkpoint {folder} holds a {found!r} alone, which moves no arm. Give a folder "
            f"that holds detector, translator and fusion, or a {KIND!r}, the thesis's FusionNet."
        )
    if kind != "fusion":
        raise InputError(
            f"{folder} holds the thesis's FusionNet, which reads no layout to plan in: it has no "
            f"{kind} policy. Choose the policy fusion, or another checkpoint."
        )
    if check:
        raise InputError(
            f"{folder} holds the thesis's FusionNet, which has no planner to be checked against. "
            "Leave the check out, or choose another checkpoint."
        )
    return ThesisPolicy(ThesisFusionNet.from_pretrained(folder, robot=robot))


def _detections(found: Mapping[str, Sequence[Any]], place: Placement) -> tuple[Detection, ...]:
    """The boxes that count as evidence, in pixels of the picture."""
    if not {"boxes", "classes"} <= found.keys():
        return ()
    seen: Boxes = found["boxes"][0]
    corners = torch.from_numpy(place.to_picture(seen.xyxy.double().numpy()))
    return as_detections(Boxes(corners, seen.classes, seen.scores))
