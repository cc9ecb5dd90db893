"""`fusionnet run "SENTENCE"`: look, read, move a block, and show why."""

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from fusionnet.apps.cli import EXIT_MISSED
from fusionnet.apps.output_folder import check_writable
from fusionnet.apps.setting import setting_of
from fusionnet.errors import DoubtError, InputError
from fusionnet.sentences import readable_words
from fusionnet.views.picture_file import read_picture


def _says(default: str) -> Any:
    """What the help says of a default that is not simply a value."""
    return tyro.conf.arg(help_behavior_hint=f"(default: {default})" if default else "")


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """What to say to the robot, about which scene, and what to write."""

    sentence: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SENTENCE")]
    """The command in English, for example "put the red pyramid on the blue cube"."""

    scene: Annotated[int | None, _says("the examples' first")] = None
    """Number of a scene of the corpus."""

    corpus: str = "examples"
    """Where the scene comes from: "examples" (in this package) or "treebank" (with --data)."""

    data: Annotated[Path | None, _says("")] = None
    """Folder of the corpus's files."""

    layout: Annotated[Path | None, _says("")] = None
    """A file with a layout of your own, as JSON."""

    image: Annotated[Path | None, _says("")] = None
    """A picture to look at instead of the simulated eye's view."""

    seed: Annotated[int | None, _says("")] = None
    """Seed of a random scene, and of the symbolic policy's samples."""

    policy: Literal["fusion", "symbolic"] = "fusion"
    """Whose joint angles are answered: the network's, or the planner's."""

    checkpoint: str = "compact"
    """Networks: a shipped name, a folder of your own, or owner/name on the hub."""

    eyes: Literal["left", "both"] = "left"
    """Whether the left eye looks, or both."""

    check: bool = False
    """Do not move where the network and the planner disagree, and say why."""

    closed_loop: bool = False
    """Look again before the grasp and above the place, and correct the arm."""

    displaced: bool = False
    """Blocks may stand up to a centimetre beside the middle of their cells; where they do not,
    this does a little harm."""

    out: Annotated[Path | None, _says("fusionnet-run, or none with --json")] = None
    """Folder to write."""

    json: bool = False
    """Print one JSON object instead of the summary."""


def run(config: RunConfig) -> int:
    """Look at a table of blocks, read one sentence, and move the block.

    Writes a folder with what the robot saw, understood and did; open its index.html.
    """
    out = config.out if config.out is not None or config.json else Path("fusionnet-run")
    readable_words(config.sentence)
    setting = setting_of(
        scene=config.scene,
        corpus=config.corpus,
        data=config.data,
        layout=config.layout,
        image=config.image,
        seed=config.seed,
    )
    if config.image is not None and config.eyes == "both":
        raise InputError("--image is one eye's picture; leave --eyes both out, or the picture.")
    picture = None if config.image is None else read_picture(config.image)
    if out is not None:
        check_writable(out)
    begin = time.perf_counter()
    import torch

    from fusionnet.apps.act import NothingDoneError, look_and_act  # slow: PyTorch, MuJoCo
    from fusionnet.apps.run_folder import write_folder
    from fusionnet.policy import load_policy

    # One picture, small networks: a second thread gains little on an idle machine, and on a
    # busy one it waits twenty times longer than it works.
    torch.set_num_threads(1)
    policy = load_policy(
        config.checkpoint,
        config.policy,
        seed=config.seed or 0,
        check=config.check,
        displaced=config.displaced,
    )
    seconds = {"load": time.perf_counter() - begin}
    try:
        record = look_and_act(config, setting, picture, policy, seconds, film=out is not None)
    except (NothingDoneError, DoubtError) as error:
        print(f"fusionnet: {error}", file=sys.stderr)
        return EXIT_MISSED
    if out is not None:
        write_folder(record, out)
    if config.json:
        print(json.dumps(record.as_json(), allow_nan=False))
    else:
        from fusionnet.apps.summary import print_summary

        print_summary(record, out)
    return record.status
