"""Where a policy's checkpoints lie: in this package, in a folder, or on the hub."""

from importlib import resources
from pathlib import Path

from fusionnet.catalogue import did_you_mean
from fusionnet.errors import UnknownNameError
from fusionnet.files import write_whole
from fusionnet.models.card import CARD_FILE, policy_card
from fusionnet.models.checkpoint import CONFIG_FILE, read_document
from fusionnet.models.hub import FILES, fetched, is_hub_name

SHIPPED = ("compact",)
"""Names of the policies inside this package."""

PARTS = ("detector", "detector-right", "detector-views", "translator", "fusion")
"""Folders of a policy's checkpoints."""

OPTIONAL = ("detector-right", "detector-views")
"""Those that may be missing: of the other eye, and of pictures that no eye of the robot took."""


def weights_folder(name: str | Path) -> Path:
    """Where a shipped policy, one in a folder, or one on the hub has its checkpoints.

    What lies on the hub is fetched first, or found in its cache.

    Raises:
        UnknownNameError: If it is none of these.
        CheckpointError: If it cannot be fetched.
    """
    if str(name) in SHIPPED:
        return Path(str(resources.files("fusionnet"))) / "weights" / str(name)
    folder = Path(name)
    if folder.is_dir():
        return folder
    if is_hub_name(name):
        return fetched(str(name), [*FILES, *(f"{part}/{file}" for part in PARTS for file in FILES)])
    raise UnknownNameError(
        f"No policy called {str(name)!r}; available: {', '.join(SHIPPED)}, or a folder that "
        "holds the checkpoints detector, translator and fusion, or a hub name like owner/name."
        + did_you_mean(str(name), list(SHIPPED))
    )


def detector_folder(name: str | Path) -> Path:
    """Where the detector of a policy, or one of its own, lies.

    Raises:
        UnknownNameError: If it is neither.
        CheckpointError: If it cannot be fetched.
    """
    own = Path(name)
    return own if (own / CONFIG_FILE).is_file() else weights_folder(name) / "detector"


def view_detector_folder(name: str | Path) -> Path:
    """Where the detector lies that a policy has for pictures which no eye of the robot took.

    It is the policy's only one, or one of its own, where there is no other.

    Raises:
        UnknownNameError: If it is neither.
        CheckpointError: If it cannot be fetched.
    """
    only = detector_folder(name)
    other = only.with_name("detector-views")
    return other if only.name == "detector" and other.is_dir() else only


def write_policy_card(folder: Path, name: str) -> None:
    """Write the model card of the policy `name` beside its checkpoints.

    Raises:
        CheckpointError: If one of them is missing or damaged.
        OutputError: If it cannot be written.
    """
    here = [part for part in PARTS if part not in OPTIONAL or (folder / part).is_dir()]
    documents = {part: read_document(folder / part) for part in here}
    write_whole(folder / CARD_FILE, policy_card(name, documents))
