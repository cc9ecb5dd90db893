"""A recorded episode read back from JSON, with suspicion, to be done again."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from fusionnet.apps.output_folder import RESULT_FILE
from fusionnet.blocks import BLOCK_SIZE, Layout, layout_from_json
from fusionnet.errors import InputError
from fusionnet.simulation import Episode, World

LARGEST_FILE = 20_000_000
"""Bytes; a result takes some ten thousand."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedEpisode:
    """What is needed to do an episode again, and how it ended.

    Attributes:
        robot: Who did it.
        before: The layout in which it began.
        shifts: Displacement of each block from its cell then, along x and y of the board, in
            metres; None if all stood in the middle.
        targets: What was executed.
        corrections: By how much the pinch was moved where the arm looked again, in metres.
        expected: The layout that should have come out, if that was known.
        end: Parts of `Episode.as_json` that tell how it ended.
    """

    robot: str
    before: Layout
    shifts: Float[np.ndarray, "n 2"] | None
    targets: Float[np.ndarray, " k"]
    corrections: dict[str, Float[np.ndarray, "3"]]
    expected: Layout | None
    end: dict[str, Any]

    def look_again(
        self, phase: Literal["grasp", "place"], rise: float, world: World
    ) -> Float[np.ndarray, "3"]:
        """What was seen then; see `simulation.LookAgain`."""
        return self.corrections.get(phase, np.zeros(3))

    def ends_like(self, episode: Episode) -> bool:
        """Whether another episode ended in the same way, every block within 0.001 mm."""
        return self.end == _end_of(episode.as_json())


def read_episode(path: Path) -> RecordedEpisode:
    """The episode in a run's folder, its result.json, or saved output of `simulate --json`.

    Raises:
        InputError: If there is none, or it is damaged.
    """
    file = path / RESULT_FILE if path.is_dir() else path
    document = _decoded(file)
    try:
        robot, episode = document["robot"], document["episode"]
        before = layout_from_json(document["layout_before"])
        wanted = document["layout_expected"]
        expected = None if wanted is None else layout_from_json(wanted)
        targets = np.array(episode["targets"], dtype=float)
        corrections = {
            phase: np.array(shift, dtype=float).reshape(3)
            for phase, shift in episode.get("corrections_m", {}).items()
        }
        given = episode.get("shifts_m", [])
        shifts = np.array(given, dtype=float).reshape(len(before.blocks), 2) if given else None
        end = _end_of(episode)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        missing = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(
            f"{file} is no result of `fusionnet run` or `fusionnet simulate --json`: {missing}."
        ) from None
    if not isinstance(robot, str):
        raise InputError(f"{file}: the robot is a name, not {robot!r}.")
    if not all(np.isfinite(shift).all() for shift in corrections.values()):
        raise InputError(f"{file}: a correction is not finite.")
    if shifts is not None and not (np.abs(shifts) <= BLOCK_SIZE / 2).all():
        raise InputError(f"{file}: a block is shifted out of its cell, by more than half of it.")
    return RecordedEpisode(
        robot=robot,
        before=before,
        shifts=shifts,
        targets=targets,
        corrections=corrections,
        expected=expected,
        end=end,
    )


def _decoded(file: Path) -> Any:
    try:
        with file.open("rb") as opened:
            content = opened.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise InputError(f"There is no file {file}.") from None
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror or error}.") from None
    if len(content) > LARGEST_FILE:
        raise InputError(f"{file} has more than {LARGEST_FILE} bytes: it is no recorded episode.")
    try:
        return json.loads(content)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{file} is not JSON: {error.msg} in line {error.lineno}, column {error.colno}."
        ) from None
    except (RecursionError, ValueError):  # nested without end, not UTF-8, endless numbers
        raise InputError(f"{file} is not JSON that can be read.") from None


def _end_of(episode: dict[str, Any]) -> dict[str, Any]:
    parts = ("success", "layout_after", "grasped", "errors_mm", "displacement_mm", "stopped")
    return {part: episode[part] for part in parts}
