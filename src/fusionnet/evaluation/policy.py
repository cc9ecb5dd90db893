"""How often a policy's answer, executed in the simulator, reaches what was asked for.

Image and sentence are all that the policy gets. Scenes come from one part of a corpus,
split by scene group, so that no layout of the test part was ever trained on.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks import Layout, Move, apply, plan
from fusionnet.corpora import Command, executable, load_corpus
from fusionnet.errors import DoubtError, InputError, NotUnderstoodError, PlanningError
from fusionnet.evaluation.intervals import wilson_interval
from fusionnet.evaluation.new_text import new_text
from fusionnet.policy import Answer, Kind, Policy, Servo, ThesisAnswer, ThesisPolicy, load_policy
from fusionnet.randomness import derived_seed, generator
from fusionnet.rcl import Tree
from fusionnet.robots import Robot
from fusionnet.simulation import Appearance, displacements, joint_targets, make_world

Outcome = Literal[
    "reached", "not understood", "doubted", "read wrong", "saw wrong", "pointed wrong", "slipped"
]
"""What became of an episode, and which part is to blame when it failed."""

EYES = {"left": ("left_eye",), "both": ("left_eye", "right_eye")}
"""Cameras of the robot that look."""


@dataclass(frozen=True, kw_only=True)
class PolicyEvaluation:
    """What to measure.

    Attributes:
        corpus: Where commands and scenes come from.
        data: Folder of the corpus's files.
        split: Part of the corpus: train, val or test.
        policy: `fusion` or `symbolic`.
        checkpoint: A shipped name, a folder of checkpoints, or owner/name on the hub; or the
            checkpoint of a FusionNet of the thesis.
        episodes: How many; commands are drawn again, in other looks, if there are fewer.
        eyes: Whether the left eye looks, or both.
        check: Whether the policy refuses to move where its two kinds disagree.
        closed_loop: Whether the policy looks again before the grasp and above the place.
        displaced: Blocks that nothing stands on are displaced from their cells by up to this
            much, in millimetres; if they are, the policy is told so.
        joint_noise: Standard deviation of the error of every turning joint in both poses, in
            degrees.
        strength: Of the camera's and blocks' displacement; 0 leaves only light and colours.
        seed: Of the drawing, the looks and the policy's vote.
    """

    corpus: str = "treebank"
    data: Path | None = None
    split: Literal["train", "val", "test"] = "test"
    policy: Kind = "fusion"
    checkpoint: str = "compact"
    episodes: int = 300
    eyes: Literal["left", "both"] = "left"
    check: bool = False
    closed_loop: bool = False
    displaced: float = 0.0
    joint_noise: float = 0.0
    strength: float = 1.0
    seed: int = 0


@dataclass(frozen=True)
class EpisodeRecord:
    """One command, answered and executed.

    Attributes:
        command: Its number in the corpus.
        outcome: What became of it.
        reason: The episode's own account, or the policy's refusal.
        squared_error: Mean squared error of the fourteen scaled values; None if refused.
        grasp_degrees: Mean absolute error of the grasp's turning joints; None if refused.
        place_degrees: Mean absolute error of the place's turning joints; None if refused.
        milliseconds: Time that the policy took to answer.
    """

    command: int
    outcome: Outcome
    reason: str
    squared_error: float | None
    grasp_degrees: float | None
    place_degrees: float | None
    milliseconds: float


@dataclass(frozen=True, eq=False)
class Watched:
    """One episode with all that it came from, for those who look closer.

    Attributes:
        record: What became of it.
        command: What was asked, in which scene.
        wanted: The move that was asked for.
        image: What the left eye saw.
        answer: What the policy answered; None if it refused.
    """

    record: EpisodeRecord
    command: Command
    wanted: Move
    image: UInt8[np.ndarray, "h w 3"]
    answer: Answer | ThesisAnswer | None


@dataclass
class PolicyReport:
    """All episodes of one evaluation.

    Attributes:
        config: What was measured.
        records: One an episode.
        not_executable: Commands of the part that were left out, because what they ask for
            cannot be done in their scene.
        new_text: Numbers of the commands whose words no other part of the corpus has.
    """

    config: PolicyEvaluation
    records: list[EpisodeRecord] = field(default_factory=list)
    not_executable: int = 0
    new_text: frozenset[int] = frozenset()

    def as_json(self) -> dict[str, Any]:
        """The numbers that are reported; joint errors are over the answered episodes.

        Episodes of one command are not independent of one another: `each_command_once` counts
        the first one of every command alone.
        """
        outcomes = Counter(record.outcome for record in self.records)
        wrong = sum(r.outcome != "reached" and r.squared_error is not None for r in self.records)
        wrong_low, wrong_high = wilson_interval(wrong, len(self.records))
        answered = [r for r in self.records if r.squared_error is not None]
        first = {record.command: record for record in reversed(self.records)}
        return {
            "corpus": self.config.corpus,
            "split": self.config.split,
            "policy": self.config.policy,
            "checkpoint": self.config.checkpoint,
            "eyes": self.config.eyes,
            "check": self.config.check,
            "closed_loop": self.config.closed_loop,
            "displaced_mm": self.config.displaced,
            "joint_noise_deg": self.config.joint_noise,
            "strength": self.config.strength,
            "seed": self.config.seed,
            "not_executable": self.not_executable,
            **_success(self.records),
            "answered": len(answered),
            "wrong_moves": round(wrong / len(self.records), 4),
            "wrong_moves_95": [round(wrong_low, 4), round(wrong_high, 4)],
            "joint_mse": _mean([r.squared_error for r in answered], 6),
            "grasp_error_deg": _mean([r.grasp_degrees for r in answered], 3),
            "place_error_deg": _mean([r.place_degrees for r in answered], 3),
            "median_answer_ms": round(float(np.median([r.milliseconds for r in self.records])), 1),
            "each_command_once": _success(list(first.values())),
            "new_text": _success([r for r in self.records if r.command in self.new_text]),
            "outcomes": dict(outcomes.most_common()),
            "failures": [
                {"command": r.command, "outcome": r.outcome, "reason": r.reason}
                for r in self.records
                if r.outcome != "reached"
            ],
        }


def _success(records: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Executed success over some episodes, with its 95 % Wilson interval."""
    reached = sum(record.outcome == "reached" for record in records)
    if not records:
        return {"n": 0}
    return {
        "n": len(records),
        "executed_success": round(reached / len(records), 4),
        "executed_success_95": [round(v, 4) for v in wilson_interval(reached, len(records))],
    }


def evaluate(
    config: PolicyEvaluation,
    *,
    progress: Callable[[int, int], None] | None = None,
    watch: Callable[[Watched], None] | None = None,
) -> PolicyReport:
    """Answer and execute the drawn commands.

    Args:
        config: What to measure.
        progress: Called with episodes done, of how many.
        watch: Called with every episode.

    Raises:
        InputError: If no episodes are asked for, a disturbance is negative, the part has no
            executable commands, or the policy cannot do what it is asked for.
    """
    if config.episodes < 1:
        raise InputError(f"At least one episode is needed; received {config.episodes}.")
    disturbances = (config.displaced, config.joint_noise, config.strength)
    if not (np.isfinite(disturbances).all() and min(disturbances) >= 0.0):
        raise InputError(
            "displaced, joint_noise and strength are numbers of at least 0; received "
            f"{', '.join(map(str, disturbances))}."
        )
    corpus = load_corpus(config.corpus, config.data)
    part, commands = corpus.split(config.split), executable(corpus).split(config.split)
    not_executable = len(part) - len(commands)
    if not commands:
        raise InputError(
            f"The corpus {config.corpus!r} has no commands in {config.split!r} that can be "
            f"executed, and {not_executable} that cannot; name another part or corpus."
        )
    policy = load_policy(
        config.checkpoint,
        config.policy,
        seed=config.seed,
        check=config.check,
        displaced=config.displaced > 0.0,
    )
    new = zip(part, new_text(corpus, part), strict=True)
    report = PolicyReport(
        config,
        not_executable=not_executable,
        new_text=frozenset(command.id for command, is_new in new if is_new),
    )
    for index in range(config.episodes):
        round_number, row = divmod(index, len(commands))
        order = generator(config.seed, "episodes", round_number).permutation(len(commands))
        watched = _episode(policy, commands[order[row]], config, index)
        report.records.append(watched.record)
        if watch is not None:
            watch(watched)
        if progress is not None:
            progress(index + 1, config.episodes)
    return report


def _episode(
    policy: Policy | ThesisPolicy, command: Command, config: PolicyEvaluation, index: int
) -> Watched:
    before = command.scene.before
    look = Appearance.sample(
        generator(config.seed, "look", config.split, index), strength=config.strength
    )
    world = make_world(
        robot=policy.robot.name,
        seed=derived_seed(config.seed, "world", index),
        layout=before,
        appearance=look,
        shifts=displacements(
            before, config.displaced / 1000, generator(config.seed, "displacement", index)
        ),
    )
    images = [world.image(eye) for eye in EYES[config.eyes]]
    wanted = plan(command.tree, before)
    after = apply(wanted, before)  # recorded; a take is held as planned
    began = time.perf_counter()
    try:
        answer = policy(images, command.sentence)
    except (NotUnderstoodError, PlanningError, DoubtError) as error:
        milliseconds = 1000 * (time.perf_counter() - began)
        blame = _blame_refusal(error, policy, command, after)
        refused = EpisodeRecord(command.id, blame, str(error), None, None, None, milliseconds)
        return Watched(refused, command, wanted, images[0], None)
    milliseconds = 1000 * (time.perf_counter() - began)
    episode = world.execute(
        _disturbed(policy.robot, answer, config, index),
        expected=after,
        look_again=Servo(policy, answer) if config.closed_loop else None,
    )
    outcome: Outcome = "reached" if episode.success else _blame(answer, wanted, before, after)
    record = EpisodeRecord(
        command.id,
        outcome,
        episode.reason,
        *joint_errors(policy.robot, answer.targets, joint_targets(policy.robot, wanted)),
        milliseconds,
    )
    return Watched(record, command, wanted, images[0], answer)


def _disturbed(
    robot: Robot, answer: Answer | ThesisAnswer, config: PolicyEvaluation, index: int
) -> Float[np.ndarray, " k"]:
    """The answer's values with an error of each turning joint, within the joints' limits."""
    targets = np.array(answer.targets, dtype=float)
    noise = np.radians(config.joint_noise) * generator(
        config.seed, "joint noise", index
    ).standard_normal(len(targets))
    noise[~np.r_[robot.turning, False, robot.turning, False]] = 0.0
    low, high = robot.joint_limits.T
    limits = [
        np.r_[limit, value, limit, value] for limit, value in ((low, -np.inf), (high, np.inf))
    ]
    disturbed: np.ndarray = np.clip(targets + noise, *limits)
    return disturbed


def joint_errors(robot: Robot, given: np.ndarray, wanted: np.ndarray) -> tuple[float, float, float]:
    """Mean squared error of the scaled targets, mean joint error in degrees of grasp and place.

    The degrees are over the joints that turn; 0 where all slide.

    References:
        Thesis, equation 4.2 (scaling) and table 7.4.
    """
    squared = float(np.mean((robot.scale(given) - robot.scale(wanted)) ** 2))
    degrees = np.degrees(np.abs(given - wanted))
    grasp, place = (half[:-1][robot.turning] for half in np.split(degrees, 2))
    turns = max(1, int(robot.turning.sum()))
    return squared, float(grasp.sum() / turns), float(place.sum() / turns)


def _blame_refusal(
    error: Exception, policy: Policy | ThesisPolicy, command: Command, after: Layout
) -> Outcome:
    """Why a command was refused; of a planner's refusal, whether it was read or seen wrong."""
    if isinstance(error, NotUnderstoodError):
        return "not understood"
    if isinstance(error, DoubtError):
        return "doubted"
    assert isinstance(policy, Policy)  # the other one does not plan
    before = command.scene.before
    readings = policy.translator.translate(command.sentence, holding=before.held is not None)
    return "saw wrong" if _reaches(readings[0].tree, before, after) else "read wrong"


def _blame(answer: Answer | ThesisAnswer, wanted: Move, before: Layout, after: Layout) -> Outcome:
    """Which part made a failed episode fail; whoever wrote no tree has read wrong."""
    if answer.tree is None or not _reaches(answer.tree, before, after):
        return "read wrong"
    if (answer.source_cell, answer.target_cell) == (wanted.source, wanted.target):
        return "slipped"
    if isinstance(answer, ThesisAnswer):
        return "pointed wrong"
    elected = (answer.move.source, answer.move.target)
    return "saw wrong" if elected != (wanted.source, wanted.target) else "pointed wrong"


def _reaches(tree: Tree, before: Layout, after: Layout) -> bool:
    """Whether the planner reaches a layout by executing a tree in the true one."""
    try:
        return apply(plan(tree, before), before).same_blocks(after)
    except PlanningError:
        return False


def _mean(values: list[float | None], digits: int) -> float | None:
    known = [value for value in values if value is not None]
    return round(float(np.mean(known)), digits) if known else None
