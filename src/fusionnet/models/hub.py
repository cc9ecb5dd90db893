"""Checkpoints by the name of a folder or of a repository on the Hugging Face hub.

A checkpoint has the hub's layout: `config.json`, `model.safetensors` and a card, `README.md`.
Nothing else is fetched, and nothing in it is executed.
"""

import importlib.util
import re
from collections.abc import Sequence
from pathlib import Path

from fusionnet import robots
from fusionnet.errors import CheckpointError, UnknownNameError
from fusionnet.models.card import CARD_FILE
from fusionnet.models.checkpoint import CONFIG_FILE, WEIGHTS_FILE

FILES = (CONFIG_FILE, WEIGHTS_FILE, CARD_FILE)
"""All that is ever fetched of a checkpoint."""

_REPOSITORY = re.compile(r"[\w][\w.-]{0,95}/[\w][\w.-]{0,95}")


def checkpoint_folder(name: str | Path, *, revision: str | None = None) -> Path:
    """The folder of a checkpoint; one on the hub is fetched first, or found in its cache.

    Args:
        name: A folder, or `owner/name` on the hub.
        revision: Branch, tag or commit on the hub.

    Raises:
        CheckpointError: If it is neither, or cannot be fetched.
    """
    folder = Path(name)
    if folder.is_dir():
        return folder
    if not is_hub_name(name):
        raise CheckpointError(
            f"No checkpoint at {name}: expected a folder with {CONFIG_FILE} and {WEIGHTS_FILE}, "
            "or a hub name like owner/name."
        )
    return fetched(str(name), FILES, revision=revision)


def is_hub_name(name: str | Path) -> bool:
    """Whether this may be a repository on the hub: `owner/name`, given as text."""
    return isinstance(name, str) and _REPOSITORY.fullmatch(name) is not None


def fetched(name: str, files: Sequence[str], *, revision: str | None = None) -> Path:
    """The folder of some files of a repository, fetched first or found in the hub's cache.

    Args:
        name: `owner/name` on the hub.
        files: What is wanted of it; what it lacks is left out.
        revision: Branch, tag or commit on the hub.

    Raises:
        CheckpointError: If it cannot be fetched.
    """
    if importlib.util.find_spec("huggingface_hub") is None:
        raise CheckpointError(
            f"{name} is no folder here, and to fetch it from the hub huggingface-hub is missing: "
            "pip install 'fusionnet[hub]'."
        )
    from huggingface_hub import snapshot_download

    try:
        return Path(snapshot_download(name, revision=revision, allow_patterns=list(files)))
    except Exception as error:  # its own errors, those of its HTTP client, and the system's
        lines = [line for line in str(error).strip().splitlines() if line]
        reason = lines[0][:160] if lines else type(error).__name__
        raise CheckpointError(
            f"{name} is no folder here and could not be fetched from the hub ({reason}). Check the "
            "name and the connection, or give a folder."
        ) from error


def check_robot(
    name: str, trained: str, joint_names: Sequence[str], wanted: str | None = None
) -> None:
    """Accept a checkpoint for a robot.

    Args:
        name: Of the checkpoint, for messages.
        trained: Robot that it was trained for.
        joint_names: Joints that it knows.
        wanted: Robot whose values are wanted; by default the one that it was trained for.

    Raises:
        CheckpointError: If it was trained for another robot, one that is not known here, or
            one whose joints have changed since.
    """
    if wanted is not None and wanted != trained:
        raise CheckpointError(
            f"The checkpoint {name} was trained for the robot {trained!r}; its joint values mean "
            f"nothing to {wanted!r}. Train one for {wanted!r}, or use {trained!r}."
        )
    try:
        body = robots.load(trained)
    except UnknownNameError as error:
        raise CheckpointError(
            f"The checkpoint {name} was trained for the robot {trained!r}, which is not here. "
            f"{error}"
        ) from error
    if tuple(joint_names) != tuple(body.joint_names):
        raise CheckpointError(
            f"The checkpoint {name} knows the joints {', '.join(joint_names)}; the robot "
            f"{trained!r} has {', '.join(body.joint_names)}. It is of another release of the robot."
        )
