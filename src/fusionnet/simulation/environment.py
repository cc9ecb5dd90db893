"""The pick-and-place task as a Gymnasium environment."""

import string
from collections.abc import Sequence
from pathlib import Path
from typing import Any, SupportsInt

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float, UInt8

from fusionnet import robots
from fusionnet.blocks import Layout, apply, plan
from fusionnet.corpora import Command, executable, load_corpus
from fusionnet.errors import InputError
from fusionnet.randomness import derived_seed, generator
from fusionnet.simulation.appearance import Appearance
from fusionnet.simulation.renderer import picture_size
from fusionnet.simulation.viewer import LiveViewer
from fusionnet.simulation.world import World

LONGEST_SENTENCE = 1000
"""Characters; longer sentences are cut."""

EYES = ("left_eye", "right_eye")


class PickPlace(gymnasium.Env[dict[str, Any], np.ndarray]):
    """A sentence says which block to move where; one action moves it.

    ## Action
    The robot's grasp pose, gripper, place pose, gripper: 14 values for NICO. Angles in
    radians within the joints' limits; a gripper value from 0.5 means closed. One action is
    a whole pick and place, so an episode has one step.

    ## Observation
    A dictionary: `left_eye` and `right_eye` (pictures before the motion), `sentence` (the
    command), `joint_positions` (the arm's joints, in radians).

    ## Start
    A command of the corpus, of those that can be executed, and its layout, drawn by the seed;
    `reset(options={"command": id})` chooses one. The look of the pictures is nominal, or drawn
    by the seed too if `varied` is set.

    ## Reward
    1 if every block ended in the cell where the command wants it and the gripper holds what
    it should, else 0.

    ## End
    Terminated after one step. `info` has `command`, and after the step `success`, `reason`
    and `episode` (see `Episode.as_json`).

    Args:
        robot: Name in the robots' catalogue.
        corpus: Name of a corpus of commands.
        data: Folder of the corpus, if it is not part of the package.
        split: "train", "val" or "test": only the commands of this part; all if None.
        size: Width and height of the pictures, in pixels.
        varied: Whether camera, light and colours vary (domain randomisation).
        render_mode: "rgb_array" (the external camera's picture), "human" (a window that shows
            the motion as it happens; needs a display) or None.

    Raises:
        InputError: If there is no such render mode, no executable command in the split, or no
            picture of the size.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 25}

    def __init__(
        self,
        robot: str = "nico",
        corpus: str = "examples",
        data: Path | str | None = None,
        split: str | None = None,
        size: Sequence[SupportsInt] = (960, 540),
        varied: bool = False,
        render_mode: str | None = None,
    ) -> None:
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise InputError(f"No render mode {render_mode!r}; available: {', '.join(modes)}.")
        self.robot = robots.load(robot)
        records = executable(load_corpus(corpus, data))
        commands = records.commands if split is None else tuple(records.split(split))
        if not commands:
            part = "" if split is None else f" in {split!r}"
            raise InputError(
                f"The corpus {corpus!r} has no commands{part} that can be executed; name another."
            )
        self.commands: dict[int, Command] = {command.id: command for command in commands}
        self.size = picture_size(size)
        self.varied = varied
        self.render_mode = render_mode
        low, high = self.robot.joint_limits.T
        self.action_space = spaces.Box(
            np.r_[low, 0.0, low, 0.0], np.r_[high, 1.0, high, 1.0], dtype=np.float64
        )
        width, height = self.size
        picture = spaces.Box(0, 255, (height, width, 3), np.uint8)
        self.observation_space = spaces.Dict(
            {
                **{eye: picture for eye in EYES},
                "sentence": spaces.Text(LONGEST_SENTENCE, min_length=0, charset=string.printable),
                "joint_positions": spaces.Box(low, high, dtype=np.float64),
            }
        )
        self._world: World | None = None
        self._command: Command | None = None
        self._expected: Layout | None = None
        self._viewer: LiveViewer | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Set up a command's layout.

        Raises:
            InputError: If `options["command"]` is no command of the corpus.
        """
        super().reset(seed=seed)
        chosen = (options or {}).get("command")
        if chosen is None:
            ids = list(self.commands)
            chosen = ids[int(self.np_random.integers(len(ids)))]
        elif chosen not in self.commands:
            raise InputError(f"No command {chosen!r} here; there are {len(self.commands)} others.")
        self._command = command = self.commands[chosen]
        before = command.scene.before
        look = Appearance()
        if self.varied:
            drawn = derived_seed(int(self.np_random.integers(2**31)), "look")
            look = Appearance.sample(generator(drawn))
        self.close()
        self._world = World(self.robot, before, look)
        if self.render_mode == "human":
            self._viewer = self._world.watch()
        self._expected = apply(plan(command.tree, before), before)
        return self._observation(), {"command": command.id}

    def step(
        self, action: Float[np.ndarray, " k"]
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Let the arm do a whole pick and place.

        Raises:
            InputError: If the action has the wrong length, is not finite, or exceeds a limit.
        """
        if self._world is None or self._command is None:
            raise gymnasium.error.ResetNeeded("Call reset before step.")
        episode = self._world.execute(action, expected=self._expected)
        info = {
            "command": self._command.id,
            "success": bool(episode.success),
            "reason": episode.reason,
            "episode": episode.as_json(),
        }
        return self._observation(), float(bool(episode.success)), True, False, info

    def render(self) -> UInt8[np.ndarray, "h w 3"] | None:
        """The external camera's picture, in the mode "rgb_array"."""
        if self.render_mode != "rgb_array" or self._world is None:
            return None
        return self._world.image("external", self.size)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None

    def _observation(self) -> dict[str, Any]:
        assert self._world is not None and self._command is not None
        sentence = "".join(c if c in string.printable else "?" for c in self._command.sentence)
        low, high = self.robot.joint_limits.T
        return {
            **{eye: self._world.image(eye, self.size) for eye in EYES},
            "sentence": sentence[:LONGEST_SENTENCE],
            "joint_positions": np.clip(self._world.joint_angles, low, high),
        }
