"""A policy: one picture and one sentence in, joint angles and the evidence for them out.

Two policies share the same eyes and ears. *fusion* is FusionNet: what is seen and
what is said meet in a learned network whose fourteen values go to the arm as they
are. *symbolic* samples layouts from what was seen, lets the planner execute the likely
readings of the sentence in each, and looks up the joint angles of the winning move.
The second is the yardstick and the explanation of the first.
"""

import functools
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks import CLASS_NAMES, Cell, Layout, Move, layout_to_json
from fusionnet.blocks.voting import Vote, likely_layout, vote
from fusionnet.catalogue import did_you_mean
from fusionnet.errors import PlanningError, UnknownNameError
from fusionnet.models.fusionnet import FusionNet
from fusionnet.models.retinanet import RetinaNet, Sight
from fusionnet.models.translator import Reading, Translator
from fusionnet.randomness import generator
from fusionnet.rcl import Tree
from fusionnet.rcl import format as format_tree
from fusionnet.robots import load as load_robot
from fusionnet.simulation import joint_targets

Kind = Literal["fusion", "symbolic"]

LEAST_SCORE = 0.5
"""Detections below this score are no evidence; measuring precision needs them, people do not."""

SHIPPED = ("compact",)
"""Names of the policies inside this package."""


@dataclass(frozen=True, eq=False)
class Pose:
    """One posture of the arm.

    Attributes:
        joint_angles: In radians, in the order of the robot's `joint_names`.
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
        move: The move that the planner's vote elected.
        agreement: Share of the votes for that move.
        confidence: Of the policy that answers, in its grasp and place cells together.
        attention: Where each node of the tree looked, as (label, probabilities of cells).
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
    move: Move
    agreement: float
    confidence: float
    attention: tuple[tuple[str, Float[np.ndarray, "512"]], ...] = ()
    milliseconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def targets(self) -> Float[np.ndarray, " k"]:
        """The flat vector of the thesis (4.3.1): grasp and place, each joints and gripper."""
        return np.concatenate(
            [
                self.grasp.joint_angles,
                [self.grasp.gripper],
                self.place.joint_angles,
                [self.place.gripper],
            ]
        )

    def as_json(self) -> dict[str, Any]:
        """JSON values of everything but the large arrays."""
        return {
            "grasp": _pose_as_json(self.grasp),
            "place": _pose_as_json(self.place),
            "boxes": [
                {
                    "class": d.class_name,
                    "score": round(d.score, 4),
                    "box": [round(c, 1) for c in d.box],
                }
                for d in self.boxes
            ],
            "layout": layout_to_json(self.layout),
            "holding": round(self.holding, 4),
            "readings": [
                {"tree": format_tree(r.tree), "probability": round(r.probability, 6)}
                for r in self.readings
            ],
            "tree": format_tree(self.tree),
            "source_cells": _likely_cells(self.source),
            "target_cells": _likely_cells(self.target),
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


class Policy:
    """Eyes, ears and, for `fusion`, the network that joins them.

    Args:
        detector: Reads a picture.
        translator: Reads a sentence.
        fusion: Joins both.
        robot: Name of the robot that they were trained for.
        kind: Whose fourteen values are answered.
        beam: Width of the search for readings.
        samples: Layouts that are sampled for the vote.
        seed: Of that sampling.
    """

    def __init__(
        self,
        detector: RetinaNet,
        translator: Translator,
        fusion: FusionNet,
        *,
        robot: str = "nico",
        kind: Kind = "fusion",
        beam: int = 10,
        samples: int = 64,
        seed: int = 0,
    ) -> None:
        self.detector = detector
        self.translator = translator
        self.fusion = fusion
        self.robot = load_robot(robot)
        self.kind = kind
        self.beam = beam
        self.samples = samples
        self.seed = seed

    def __call__(self, image: UInt8[np.ndarray, "h w 3"], sentence: str) -> Answer:
        """Look, read, and answer with joint angles and the evidence for them.

        Args:
            image: What the robot's left eye sees.
            sentence: A command in English.

        Raises:
            NotUnderstoodError: If the sentence cannot be read as a command.
            PlanningError: If no reading of it can be executed in what was seen.
        """
        milliseconds: dict[str, float] = {}
        with _stage(milliseconds, "see"):
            sight = self.detector.see(image)
        with _stage(milliseconds, "read"):
            readings = self.translator.translate(
                sentence, holding=sight.holding > 0.5, beam=self.beam
            )
        with _stage(milliseconds, "vote"):
            elected = self._vote(sight, readings)
        with _stage(milliseconds, "fuse"):
            fused = self.fusion(
                sight.cells, sight.holding, [(r.tree, r.probability) for r in readings]
            )
        if elected.move is None:
            raise PlanningError(elected.refusal)
        symbolic = self.kind == "symbolic"
        source = _cell_shares(elected, "source") if symbolic else fused.source
        target = _cell_shares(elected, "target") if symbolic else fused.target
        targets = joint_targets(self.robot, elected.move) if symbolic else fused.targets
        middle = len(targets) // 2
        return Answer(
            grasp=Pose(targets[: middle - 1], float(targets[middle - 1])),
            place=Pose(targets[middle:-1], float(targets[-1])),
            boxes=_detections(sight),
            layout=likely_layout(sight.cells, sight.holding),
            cells=sight.cells,
            holding=sight.holding,
            readings=readings,
            tree=elected.tree if symbolic else readings[fused.reading].tree,
            source=source,
            target=target,
            move=elected.move,
            agreement=elected.share,
            confidence=elected.share if symbolic else fused.confidence,
            attention=tuple(fused.attention),
            milliseconds=milliseconds,
        )

    def _vote(self, sight: Sight, readings: tuple[Reading, ...]) -> Vote:
        return vote(
            sight.cells,
            sight.holding,
            [(r.tree, r.probability) for r in readings],
            generator(self.seed, "vote"),
            samples=self.samples,
        )


def load_policy(name: str | Path = "compact", kind: Kind = "fusion", *, seed: int = 0) -> Policy:
    """A policy from a shipped name or from a folder of checkpoints.

    Args:
        name: One of `SHIPPED`, or a folder that holds `detector`, `translator` and `fusion`.
        kind: `fusion` or `symbolic`.
        seed: Of the symbolic vote's sampling.

    Raises:
        UnknownNameError: If the name is neither shipped nor a folder, or the kind is unknown.
        CheckpointError: If a checkpoint is missing, damaged or of another version.
    """
    if kind not in get_args(Kind):
        raise UnknownNameError(
            f"No policy of the kind {kind!r}; available: {', '.join(get_args(Kind))}."
            + did_you_mean(str(kind), list(get_args(Kind)))
        )
    folder = weights_folder(name)
    detector, translator, fusion = _models(folder)
    return Policy(detector, translator, fusion, kind=kind, seed=seed)


def weights_folder(name: str | Path) -> Path:
    """Where a shipped policy, or one in a folder, has its checkpoints.

    Raises:
        UnknownNameError: If it is neither.
    """
    if str(name) in SHIPPED:
        return Path(str(resources.files("fusionnet"))) / "weights" / str(name)
    folder = Path(name)
    if not folder.is_dir():
        raise UnknownNameError(
            f"No policy called {str(name)!r}; available: {', '.join(SHIPPED)}, or a folder that "
            "holds the checkpoints detector, translator and fusion."
            + did_you_mean(str(name), list(SHIPPED))
        )
    return folder


@functools.lru_cache(maxsize=2)
def _models(folder: Path) -> tuple[RetinaNet, Translator, FusionNet]:
    return (
        RetinaNet.from_folder(folder / "detector"),
        Translator.from_folder(folder / "translator"),
        FusionNet.from_folder(folder / "fusion"),
    )


def _detections(sight: Sight) -> tuple[Detection, ...]:
    boxes = sight.boxes
    return tuple(
        Detection(CLASS_NAMES[int(kind)], float(score), tuple(float(c) for c in box))  # type: ignore[arg-type]
        for box, kind, score in zip(boxes.xyxy, boxes.classes, boxes.scores, strict=True)
        if score >= LEAST_SCORE
    )


def _cell_shares(elected: Vote, end: Literal["source", "target"]) -> Float[np.ndarray, "512"]:
    """How the votes are spread over the cells at one end of the moves."""
    shares = np.zeros(512)
    for move, weight in elected.votes.items():
        shares[getattr(move, end).index] += weight
    return shares / shares.sum()


def _likely_cells(distribution: Float[np.ndarray, "512"], count: int = 3) -> list[dict[str, Any]]:
    best = np.argsort(distribution)[::-1][:count]
    return [
        {"cell": list(Cell.from_index(int(i))), "probability": round(float(distribution[i]), 4)}
        for i in best
    ]


def _pose_as_json(pose: Pose) -> dict[str, Any]:
    return {
        "joint_angles_rad": [round(float(a), 5) for a in pose.joint_angles],
        "joint_angles_deg": [round(float(np.degrees(a)), 2) for a in pose.joint_angles],
        "gripper": round(pose.gripper, 4),
    }


@contextmanager
def _stage(milliseconds: dict[str, float], name: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    milliseconds[name] = 1000 * (time.perf_counter() - began)
