"""From a picture and a sentence to an episode: the straight line of `fusionnet run`."""

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import UInt8

from fusionnet.apps.run import RunConfig
from fusionnet.apps.run_record import Reference, RunRecord
from fusionnet.apps.setting import Setting
from fusionnet.blocks import Layout, Shape, apply, plan, validate
from fusionnet.errors import FusionNetError, InputError, NotUnderstoodError, PlanningError
from fusionnet.models.look import seen_by_eye
from fusionnet.models.sight import BOARD_SEEN, padded_to_aspect
from fusionnet.policy import Answer, Policy, Servo, ThesisAnswer, ThesisPolicy
from fusionnet.sentences import words_of
from fusionnet.simulation import make_world

EYES = {"left": ("left",), "both": ("left", "right")}


class NothingDoneError(FusionNetError):
    """The policy refused what the corpus knows to be possible."""


def look_and_act(
    config: RunConfig,
    setting: Setting,
    picture: UInt8[np.ndarray, "h w 3"] | None,
    policy: Policy | ThesisPolicy,
    seconds: dict[str, float],
    film: bool = True,
) -> RunRecord:
    """Show the picture and the sentence to the policy, and let the arm do what it answers.

    Args:
        config: What was asked for.
        setting: The world that the options name.
        picture: A picture from a file, which stands for the simulated eye's view.
        policy: Who answers.
        seconds: Wall time by stage; this adds to it.
        film: Whether the episode is recorded, so that it can be filmed.

    Raises:
        NothingDoneError: If the policy refuses what the corpus knows to be possible.
        DoubtError: If the policy checks, and would rather not move.
        InputError: If the picture shows no board.
        FusionNetError: If the sentence cannot be understood or done there.
    """
    robot, seed = policy.robot.name, config.seed or 0
    expected: Layout | None = None
    reference: Reference | None = None
    if picture is None:
        with timed(seconds, "world"):
            world = make_world(robot=robot, seed=seed, layout=setting.layout)
            views = [world.image(f"{eye}_eye") for eye in EYES[config.eyes]]
        recorded = _recorded(config.sentence, setting)
        with timed(seconds, "answer"):
            answer = _answer(policy, views, config.sentence, recorded, world.layout)
        if recorded is not None:
            expected, reference = recorded, "recorded"
        else:
            expected = _planned(answer, world.layout)
            reference = None if expected is None else "understood"
    else:
        with timed(seconds, "answer"):
            views = [_shown(policy, picture)]
            answer = policy(views, config.sentence)
        with timed(seconds, "world"):
            world = make_world(robot=robot, seed=seed, layout=_as_read(answer))
    before = world.layout
    with timed(seconds, "episode"):
        episode = world.execute(
            answer,
            expected=expected,
            record=film,
            look_again=Servo(policy, answer) if config.closed_loop else None,
        )
    return RunRecord(
        sentence=config.sentence,
        policy=config.policy,
        checkpoint=config.checkpoint,
        robot=robot,
        origin=setting.origin,
        seed=seed,
        picture=views[0],
        answer=answer,
        episode=episode,
        layout=before,
        layout_is_read=picture is not None,
        expected=expected,
        reference=reference,
        seconds=seconds,
    )


def _shown(
    policy: Policy | ThesisPolicy, picture: UInt8[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "h2 w2 3"]:
    """A person's picture in the aspect of the eye's.

    Raises:
        InputError: If it does not show a board as the eye sees it: its blocks would be invented.
    """
    if isinstance(policy, ThesisPolicy):
        return picture
    padded = padded_to_aspect(picture, policy.detector.frame.eye_size)
    _, board = seen_by_eye(policy.detector, padded)
    if board < BOARD_SEEN:
        width, height = policy.detector.frame.eye_size
        raise InputError(
            f"The picture shows no board as the robot's left eye sees it (evidence {board:.2f}, at "
            f"least {BOARD_SEEN} is needed), so where its blocks stand cannot be read. Give one of "
            f"the whole board from the eye's place, {width} x {height} pixels or of that aspect; "
            "`fusionnet detect` finds boxes in any picture."
        )
    return padded


def _as_read(answer: Answer | ThesisAnswer) -> Layout:
    """The layout that a network read in a picture, if blocks could stand so.

    Raises:
        InputError: If they could not, or the network reads none.
    """
    if isinstance(answer, ThesisAnswer):
        raise InputError(
            "The thesis's FusionNet reads no layout from a picture, so there is no world for the "
            "arm to move in. Leave the picture out, or choose another checkpoint."
        )
    layout = answer.layout
    try:
        validate(layout)
    except InputError as error:
        raise InputError(f"The blocks in the picture could not be read: {error}") from error
    return layout


def _recorded(sentence: str, setting: Setting) -> Layout | None:
    """The layout that the corpus recorded, if it has the sentence for this scene."""
    said = words_of(sentence).texts
    for command in setting.recorded:
        if words_of(command.sentence).texts == said:
            return command.scene.after
    return None


def _answer(
    policy: Policy | ThesisPolicy,
    views: list[UInt8[np.ndarray, "h w 3"]],
    sentence: str,
    recorded: Layout | None,
    layout: Layout,
) -> Answer | ThesisAnswer:
    """The policy's answer.

    Raises:
        NothingDoneError: If the policy refuses a sentence of which the corpus knows that
            it can be done there: the networks' mistake, not the user's.
        NotUnderstoodError, PlanningError: If it refuses any other sentence.
    """
    try:
        return policy(views, sentence)
    except (NotUnderstoodError, PlanningError) as refusal:
        if recorded is not None:
            raise NothingDoneError(f"Missed: the arm did not move. {refusal}") from refusal
        if isinstance(refusal, PlanningError):
            raise PlanningError(f"{refusal} {_on_the_table(layout)}") from refusal
        raise


def _planned(answer: Answer | ThesisAnswer, layout: Layout) -> Layout | None:
    """The layout that the planner reaches by executing the command, as it was read.

    None where the thesis's FusionNet wrote no tree, or one that cannot be executed: it moves all
    the same.

    Raises:
        PlanningError: If no reading of the sentence can be executed there: it names no
            block that is there, or several.
    """
    if isinstance(answer, ThesisAnswer):
        try:
            return None if answer.tree is None else apply(plan(answer.tree, layout), layout)
        except PlanningError:
            return None
    refusals = []
    for tree in (answer.tree, *(reading.tree for reading in answer.readings)):
        try:
            return apply(plan(tree, layout), layout)
        except PlanningError as refusal:
            refusals.append(refusal)
    raise PlanningError(f"{refusals[0]} {_on_the_table(layout)}")


def _on_the_table(layout: Layout) -> str:
    """For messages: what a sentence could have spoken of."""
    names = (f"{b.color} {'cube' if b.shape is Shape.CUBE else 'pyramid'}" for b in layout.blocks)
    counts = sorted(Counter(names).items())
    blocks = [name if count == 1 else f"{count} {name}s" for name, count in counts]
    return f"On the table: {', '.join(blocks) or 'nothing'}."


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Note how long a stage took."""
    begin = time.perf_counter()
    yield
    seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - begin
