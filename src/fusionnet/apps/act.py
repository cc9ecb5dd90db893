"""From a picture and a sentence to an episode: the straight line of `fusionnet run`."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import UInt8

from fusionnet.apps.run import RunConfig
from fusionnet.apps.run_record import Reference, RunRecord
from fusionnet.apps.setting import Setting
from fusionnet.blocks import Layout, apply, plan, validate
from fusionnet.corpora import Command
from fusionnet.errors import InputError, PlanningError
from fusionnet.policy import Answer, Policy
from fusionnet.sentences import words_of
from fusionnet.simulation import make_world


def look_and_act(
    config: RunConfig,
    setting: Setting,
    picture: UInt8[np.ndarray, "h w 3"] | None,
    policy: Policy,
    seconds: dict[str, float],
) -> RunRecord:
    """Show the picture and the sentence to the policy, and let the arm do what it answers.

    Args:
        config: What was asked for.
        setting: The world that the options name.
        picture: A picture from a file, which stands for the simulated eye's view.
        policy: Who answers.
        seconds: Wall time by stage; this adds to it.

    Raises:
        FusionNetError: If the sentence cannot be understood or done there.
    """
    robot = policy.robot.name
    expected, reference = None, None
    if picture is None:
        with timed(seconds, "world"):
            world = make_world(robot=robot, seed=config.seed, layout=setting.layout)
            view = world.image("left_eye")
        with timed(seconds, "answer"):
            answer = policy(view, config.sentence)
        expected, reference = _expected(config.sentence, world.layout, setting.recorded, answer)
    else:
        view = picture
        with timed(seconds, "answer"):
            answer = policy(view, config.sentence)
        with timed(seconds, "world"):
            world = make_world(robot=robot, seed=config.seed, layout=_as_read(answer.layout))
    with timed(seconds, "episode"):
        episode = world.execute(answer, expected=expected, record=True)
    return RunRecord(
        sentence=config.sentence,
        policy=config.policy,
        robot=robot,
        origin=setting.origin,
        seed=config.seed,
        picture=view,
        answer=answer,
        episode=episode,
        layout=world.layout,
        layout_is_read=picture is not None,
        expected=expected,
        reference=reference,
        seconds=seconds,
    )


def _as_read(layout: Layout) -> Layout:
    """The layout that a network read in a picture, if blocks could stand so.

    Raises:
        InputError: If they could not.
    """
    try:
        validate(layout)
    except InputError as error:
        raise InputError(f"The blocks in the picture could not be read: {error}") from error
    return layout


def _expected(
    sentence: str, layout: Layout, recorded: tuple[Command, ...], answer: Answer
) -> tuple[Layout, Reference]:
    """The layout that the command asks for: recorded by the corpus, or planned.

    A sentence that the corpus has for this scene has a recorded outcome. Any other is
    executed by the planner in the true layout, as the policy read it.

    Raises:
        PlanningError: If no reading of the sentence can be executed there: it names no
            block that is there, or several.
    """
    said = words_of(sentence).texts
    for command in recorded:
        if words_of(command.sentence).texts == said:
            return command.scene.after, "recorded"
    refusals = []
    for tree in (answer.tree, *(reading.tree for reading in answer.readings)):
        try:
            return apply(plan(tree, layout), layout), "understood"
        except PlanningError as refusal:
            refusals.append(refusal)
    raise refusals[0]


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Note how long a stage took."""
    begin = time.perf_counter()
    yield
    seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - begin
