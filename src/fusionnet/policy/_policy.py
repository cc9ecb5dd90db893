"""Policies: one picture (or one of each eye) and one sentence in, joint angles out.

Two policies share the same eyes and ears. *fusion* is FusionNet: what is seen and
what is said meet in a learned network whose fourteen values go to the arm as they
are. *symbolic* samples layouts from what was seen, lets the planner execute the likely
readings of the sentence in each, and looks up the joint angles of the winning move.
The second is the yardstick and the explanation of the first.
"""

import functools
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import Cell, Move
from fusionnet.blocks.voting import Vote, likely_layout, vote
from fusionnet.catalogue import did_you_mean
from fusionnet.errors import InputError, PlanningError, UnknownNameError
from fusionnet.models.checkpoint import CONFIG_FILE
from fusionnet.models.fusionnet import FusionAnswer, FusionNet
from fusionnet.models.hub import check_robot
from fusionnet.models.policy_folder import SHIPPED, weights_folder
from fusionnet.models.retinanet import RetinaNet, Sight
from fusionnet.models.translator import Reading, Translator
from fusionnet.policy._answer import Answer, Pose, as_detections
from fusionnet.policy._attention import attentions
from fusionnet.policy._check import refuse_doubtful
from fusionnet.policy._eyes import Picture, both_seen, pictures_of
from fusionnet.policy._placing import with_boxed_blocks
from fusionnet.policy._thesis import ThesisPolicy, thesis_policy
from fusionnet.randomness import generator
from fusionnet.robots import load as load_robot
from fusionnet.simulation import joint_targets

Kind = Literal["fusion", "symbolic"]


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
        check: Whether to refuse a move where the two kinds of policy disagree.
        displaced: Whether blocks may stand well beside the middle of their cells; a box then
            gives a block to a cell that the reader of the grid left empty. Where they do not, this
            does harm: it cost 2 of 120 validation episodes.
        right: Reads a picture of the right eye; without it one eye has to do.
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
        check: bool = False,
        displaced: bool = False,
        right: RetinaNet | None = None,
    ) -> None:
        self.detector = detector
        self.right = right
        self.translator = translator
        self.fusion = fusion
        self.robot = load_robot(robot)
        self.kind = kind
        self.beam = beam
        self.samples = samples
        self.seed = seed
        self.check = check
        self.displaced = displaced

    def __call__(self, image: Picture | Sequence[Picture], sentence: str) -> Answer:
        """Look, read, and answer with joint angles and the evidence for them.

        Args:
            image: What the robot's left eye sees, or what its left and its right eye see, of any
                size in the aspect of the eye's picture. One that shows no board is answered as
                well: ask `models.look` first where that may happen.
            sentence: A command in English.

        Raises:
            NotUnderstoodError: If the sentence cannot be read as a command.
            PlanningError: If no reading of it can be executed in what was seen.
            DoubtError: If the policy checks, and would rather not move.
            InputError: If there are more pictures than eyes, or something is no picture.
        """
        pictures = pictures_of(image)
        eyes = [self.detector] if self.right is None else [self.detector, self.right]
        if not 1 <= len(pictures) <= len(eyes):
            raise InputError(
                f"Received {len(pictures)} pictures; this policy sees with {len(eyes)} "
                f"eye{'s' if len(eyes) > 1 else ' (its checkpoint has no detector-right)'}: "
                "give one picture, or one of each eye, the left first."
            )
        milliseconds: dict[str, float] = {}
        with _stage(milliseconds, "see"):
            sight = both_seen([e.see(p) for e, p in zip(eyes, pictures, strict=False)])
            if self.displaced:
                sight = with_boxed_blocks(sight)
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
        pointed = _pointed(fused)
        if self.check:
            refuse_doubtful(pointed, elected.move, elected.share)
        symbolic = self.kind == "symbolic"
        source = _cell_shares(elected, "source") if symbolic else fused.source
        target = _cell_shares(elected, "target") if symbolic else fused.target
        targets = joint_targets(self.robot, elected.move) if symbolic else fused.targets
        middle = len(targets) // 2
        return Answer(
            grasp=Pose(targets[: middle - 1], float(targets[middle - 1])),
            place=Pose(targets[middle:-1], float(targets[-1])),
            boxes=as_detections(sight.boxes),
            layout=likely_layout(sight.cells, sight.holding),
            cells=sight.cells,
            holding=sight.holding,
            readings=readings,
            tree=elected.tree if symbolic else readings[fused.reading].tree,
            source=source,
            target=target,
            source_cell=elected.move.source if symbolic else pointed.source,
            target_cell=elected.move.target if symbolic else pointed.target,
            move=elected.move,
            agreement=elected.share,
            confidence=elected.share if symbolic else fused.confidence,
            attention=attentions(fused, readings[fused.reading], source, target),
            camera=sight.camera,
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


def load_policy(
    name: str | Path = "compact",
    kind: Kind = "fusion",
    *,
    seed: int = 0,
    check: bool = False,
    displaced: bool = False,
    robot: str | None = None,
) -> Policy | ThesisPolicy:
    """A policy from a shipped name, a folder of checkpoints, or one on the hub.

    Args:
        name: One of `SHIPPED`, or a folder that holds `detector`, `translator` and `fusion`, and
            `detector-right` if two eyes are to look; or the checkpoint of a FusionNet of the
            thesis; or `owner/name` of either on the hub.
        kind: `fusion` or `symbolic`.
        seed: Of the symbolic vote's sampling.
        check: Whether to refuse a move where the two kinds disagree (DoubtError).
        displaced: Whether blocks may stand well beside the middle of their cells.
        robot: Who is to move; by default whichever the policy was trained for.

    Raises:
        UnknownNameError: If the name is neither shipped, a folder nor a hub's, or the kind is
            unknown.
        InputError: If a FusionNet of the thesis is asked to plan or to check itself.
        CheckpointError: If a checkpoint is missing, damaged, of another version or for another
            robot, or cannot be fetched.
    """
    if kind not in get_args(Kind):
        raise UnknownNameError(
            f"No policy of the kind {kind!r}; available: {', '.join(get_args(Kind))}."
            + did_you_mean(str(kind), list(get_args(Kind)))
        )
    folder = weights_folder(name)
    if (folder / CONFIG_FILE).is_file():
        return thesis_policy(folder, kind, check=check, robot=robot)
    # What this package holds does not change while it runs; a folder may.
    read = _shipped if str(name) in SHIPPED else _models
    detector, translator, fusion, right = read(folder)
    trained = fusion.config["robot"]
    check_robot(str(name), trained, fusion.config["joint_names"], robot)
    return Policy(
        detector,
        translator,
        fusion,
        robot=trained,
        kind=kind,
        seed=seed,
        check=check,
        displaced=displaced,
        right=right,
    )


def _models(folder: Path) -> tuple[RetinaNet, Translator, FusionNet, RetinaNet | None]:
    right = folder / "detector-right"
    return (
        RetinaNet.from_folder(folder / "detector"),
        Translator.from_folder(folder / "translator"),
        FusionNet.from_folder(folder / "fusion"),
        RetinaNet.from_folder(right) if right.is_dir() else None,
    )


_shipped = functools.lru_cache(maxsize=1)(_models)


def _pointed(fused: FusionAnswer) -> Move:
    """What the network's fourteen values do."""
    return Move(
        Cell.from_index(fused.source_cell),
        Cell.from_index(fused.target_cell),
        begins_held=bool(fused.targets[len(fused.targets) // 2 - 1] >= 0.5),
        ends_held=bool(fused.targets[-1] >= 0.5),
    )


def _cell_shares(elected: Vote, end: Literal["source", "target"]) -> Float[np.ndarray, "512"]:
    """How the votes are spread over the cells at one end of the moves."""
    shares = np.zeros(512)
    for move, weight in elected.votes.items():
        shares[getattr(move, end).index] += weight
    return shares / shares.sum()


@contextmanager
def _stage(milliseconds: dict[str, float], name: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    milliseconds[name] = 1000 * (time.perf_counter() - began)
