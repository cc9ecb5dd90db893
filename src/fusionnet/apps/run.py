"""`fusionnet run "SENTENCE"`: look, read, move a block, and show why."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from jaxtyping import UInt8

from fusionnet.apps.output_folder import RESULT_FILE, check_writable, written_whole
from fusionnet.apps.picture_file import read_picture
from fusionnet.blocks import Layout, apply, plan, read_layout, validate
from fusionnet.catalogue import did_you_mean
from fusionnet.corpora import Command, load_corpus
from fusionnet.errors import InputError, PlanningError, UnknownNameError
from fusionnet.sentences import readable_words, words_of

if TYPE_CHECKING:
    from fusionnet.apps.run_record import Reference, RunRecord
    from fusionnet.policy import Answer, Policy

POLICIES = ("fusion", "symbolic")
FILES = (
    "picture.png",
    "boxes.png",
    "tree.txt",
    "tree.png",
    "joint_angles.json",
    "episode.mp4",
    "index.html",
)
"""What a run's folder holds beside result.json."""


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """What to say to the robot, about which scene, and what to write."""

    sentence: Annotated[str, tyro.conf.Positional]
    """The command in English, for example "put the red pyramid on the blue cube"."""

    scene: int | None = None
    """Number of a scene of the corpus; without one (and no layout), a random scene."""

    corpus: str = "examples"
    """Where the scene comes from: "examples" (in this package) or "treebank" (with --data)."""

    data: Path | None = None
    """Folder of the corpus's files."""

    layout: Path | None = None
    """A file with a layout of your own, as JSON."""

    image: Path | None = None
    """A picture to look at instead of the simulated eye's view."""

    seed: int = 0
    """Everything random derives from it: the scene, and the symbolic policy's samples."""

    policy: str = "fusion"
    """"fusion" (FusionNet's fourteen values go to the arm), "symbolic" (read, plan, look up
    the angles), or the folder of a checkpoint."""

    robot: str = "nico"
    """Which robot looks and moves."""

    out: Path | None = None
    """Folder for pictures, video, result.json and index.html [default: fusionnet-run; none
    with --json]."""

    json: bool = False
    """Print one JSON object instead of the summary."""


@dataclass(frozen=True)
class _Setting:
    """The world as it is before the command, as far as it is known.

    Attributes:
        origin: Where it came from, in words.
        layout: The blocks; None when a seed or a picture stands for them.
        recorded: The corpus's commands for the scene.
    """

    origin: str
    layout: Layout | None = None
    recorded: tuple[Command, ...] = ()


def run(config: RunConfig) -> int:
    """Look at a table of blocks, read one sentence, and move the block.

    Writes a folder with what the robot saw, understood and did; open its index.html.
    """
    out = config.out if config.out is not None or config.json else Path("fusionnet-run")
    readable_words(config.sentence)
    kind, checkpoint = _policy_choice(config.policy)
    setting = _setting(config)
    picture = None if config.image is None else read_picture(config.image)
    if out is not None:
        check_writable(out)
    seconds: dict[str, float] = {}
    with _timed(seconds, "load"):
        from fusionnet.policy import load_policy

        policy = load_policy(checkpoint, kind=kind)
    record = _look_and_act(config, setting, picture, policy, seconds)
    if out is not None:
        with _timed(seconds, "write"):
            _write(record, out)
    if config.json:
        print(json.dumps(record.as_json(list(FILES) if out else []), allow_nan=False))
    else:
        from fusionnet.apps.summary import print_summary

        print_summary(record, out)
    return record.status


def _policy_choice(name: str) -> tuple[str, str]:
    """The kind of policy, and the checkpoint that it is loaded from."""
    if name in POLICIES:
        return name, "compact"
    if Path(name).exists() or "/" in name:
        return "fusion", name
    raise UnknownNameError(
        f"No policy called {name!r}; available: {', '.join(POLICIES)}, or the folder of a "
        f"checkpoint.{did_you_mean(name, list(POLICIES))}"
    )


def _setting(config: RunConfig) -> _Setting:
    """The world that the options name.

    Raises:
        InputError: If they name two worlds, or a layout that cannot be.
        UnknownNameError: If there is no such scene or corpus.
    """
    named = {"--scene": config.scene, "--layout": config.layout, "--image": config.image}
    given = [option for option, value in named.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} name two worlds; give one of them.")
    if config.image is not None:
        return _Setting(f"picture {config.image.name}")
    if config.layout is not None:
        return _Setting(f"layout {config.layout.name}", read_layout(config.layout))
    if config.scene is None:
        return _Setting(f"random, seed {config.seed}")
    corpus = load_corpus(config.corpus, config.data)
    if config.scene not in corpus.scenes:
        first, last = min(corpus.scenes, default=0), max(corpus.scenes, default=0)
        raise UnknownNameError(
            f"No scene {config.scene} in the corpus {config.corpus!r}; it has "
            f"{len(corpus.scenes)} scenes, {first} to {last}."
        )
    scene = corpus.scenes[config.scene]
    recorded = tuple(c for c in corpus.commands if c.scene.id == config.scene)
    return _Setting(f"{config.scene} of {config.corpus}", scene.before, recorded)


def _look_and_act(
    config: RunConfig,
    setting: _Setting,
    picture: UInt8[np.ndarray, "h w 3"] | None,
    policy: "Policy",
    seconds: dict[str, float],
) -> "RunRecord":
    from fusionnet.apps.run_record import RunRecord
    from fusionnet.simulation import make_world

    expected, reference = None, None
    if picture is None:
        with _timed(seconds, "world"):
            world = make_world(robot=config.robot, seed=config.seed, layout=setting.layout)
            view = world.image("left_eye")
        with _timed(seconds, "answer"):
            answer = policy(view, config.sentence)
        expected, reference = _expected(config.sentence, world.layout, setting.recorded, answer)
    else:
        view = picture
        with _timed(seconds, "answer"):
            answer = policy(view, config.sentence)
        with _timed(seconds, "world"):
            world = make_world(robot=config.robot, seed=config.seed, layout=_as_read(answer.layout))
    with _timed(seconds, "episode"):
        episode = world.execute(answer, expected=expected, record=True)
    return RunRecord(
        sentence=config.sentence,
        policy=config.policy,
        robot=config.robot,
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


def _expected(sentence: str, setting: _Setting, answer: "Answer") -> tuple[Layout, "Reference"]:
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


def _write(record: "RunRecord", out: Path) -> None:
    """The folder of a run, whole or not at all."""
    from PIL import Image

    from fusionnet import rcl, robots
    from fusionnet.apps.drawing import draw_boxes
    from fusionnet.apps.page import page
    from fusionnet.apps.tree_drawing import draw_tree

    answer = record.answer
    with written_whole(out) as folder:
        Image.fromarray(record.picture).save(folder / "picture.png")
        seen = draw_boxes(record.picture, record.boxes)
        Image.fromarray(seen).save(folder / "boxes.png")
        text = (
            f"{record.sentence}\n\n{rcl.describe(answer.tree)}\n\n{rcl.outline(answer.tree)}\n\n"
            f"{rcl.format(answer.tree)}\n"
        )
        (folder / "tree.txt").write_text(text, encoding="utf-8")
        draw_tree(answer.tree, record.words, folder / "tree.png", folder / "tree.svg")
        tree_svg = (folder / "tree.svg").read_text(encoding="utf-8")
        (folder / "tree.svg").unlink()
        joints = {
            "joints": list(robots.load(record.robot).joint_names),
            "unit": "rad",
            "grasp": [float(a) for a in answer.grasp.joint_angles],
            "grasp_gripper": float(answer.grasp.gripper),
            "place": [float(a) for a in answer.place.joint_angles],
            "place_gripper": float(answer.place.gripper),
        }
        (folder / "joint_angles.json").write_text(json.dumps(joints, indent=1) + "\n")
        record.episode.video(folder / "episode.mp4")
        video = (folder / "episode.mp4").read_bytes()
        document = record.as_json([*FILES])
        html = page(record, seen=seen, tree_svg=tree_svg, video=video, document=document)
        (folder / "index.html").write_text(html, encoding="utf-8")
        result = json.dumps(document, indent=1, allow_nan=False)
        (folder / RESULT_FILE).write_text(result + "\n", encoding="utf-8")


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Note how long a stage took."""
    begin = time.perf_counter()
    yield
    seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - begin
