"""Pictures of a layout, whatever takes them: the robot's eyes or an environmental view."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import Layout
from fusionnet.errors import UnknownNameError
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer, View, displacements
from fusionnet.views import EnvironmentalView, Look, OverlayRenderer, SensorNoise, level_one

SIMULATION = "simulation"
"""Environment of pictures through the robot's eyes."""

FARTHEST = 0.01
"""How far blocks that are displaced stand from the middle of their cells, in metres, at most."""


DISPLACED = "appearance and displaced blocks"
"""What is varied in a picture whose top blocks stand beside the middle of their cells."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One picture of a layout, what is true of it, and what it was taken with.

    Attributes:
        view: The picture with its labels and masks.
        camera_from_board: Pose of the camera.
        environment: Name of the environment.
        noise: What was varied, as JSON.
        offsets: How far each block of the layout stands beside its cell's middle, along x and y of
            the board in metres, and how far it is turned about the vertical, in radians.
    """

    view: View
    camera_from_board: Float[np.ndarray, "4 4"]
    environment: str
    noise: str
    offsets: Float[np.ndarray, "n 3"]


class Eyes:
    """Takes pictures through a robot's cameras, each in a look of its own (thesis 3.3.3).

    Args:
        robot: Name of the robot.
        size: Width and height of pictures, in pixels.

    Raises:
        RenderingError: If pictures cannot be rendered here.
    """

    def __init__(self, robot: str, size: tuple[int, int]) -> None:
        self._renderer = SceneRenderer(robot, size)

    def shot(self, layout: Layout, camera: str, seed: int, displaced: bool = False) -> Shot:
        """A layout through one of the robot's cameras; the look depends on the seed alone.

        Args:
            layout: What stands on the board.
            camera: Name of the camera.
            seed: Of the look.
            displaced: Whether top blocks stand up to `FARTHEST` beside the middle of their cells.
        """
        look = Appearance.sample(generator(seed, "look"))
        if displaced:
            shifts = displacements(layout, FARTHEST, generator(seed, "displacement"))
            look.block_shifts[: len(shifts)] += shifts
        kind = DISPLACED if displaced else "appearance"
        view = self._renderer.view(layout, camera=camera, appearance=look, masks=True)
        board = self._renderer.robot.robot_from_board
        return Shot(
            view=view,
            camera_from_board=view.camera.camera_from_robot @ board,
            environment=SIMULATION,
            noise=json.dumps({"kind": kind, **_short_values(look)}),
            offsets=np.column_stack([look.block_shifts, look.block_turns])[: len(layout.blocks)],
        )


class Photographs:
    """Draws layouts into environmental views, as they are or varied (thesis 3.2.4, 3.2.5).

    Args:
        views: The photographs.
        robot: Name of the robot in whose frame cameras are given.
        size: Width and height of pictures, in pixels.
        strength: Of the level-one noise, 0 to 1; see `views.level_one`.
        sensor: Whether a noised picture gets the noise of a camera, too.

    Raises:
        RenderingError: If pictures cannot be rendered here.
    """

    def __init__(
        self,
        views: Sequence[EnvironmentalView],
        robot: str,
        size: tuple[int, int],
        strength: float,
        sensor: bool = True,
    ) -> None:
        self._renderer = OverlayRenderer(size, robot)
        self._views = {view.name: view for view in views}
        self._noise = level_one(strength)
        self._sensor = SensorNoise(quality=None) if sensor else None

    def shot(self, layout: Layout, name: str, seed: int, noised: bool) -> Shot:
        """A layout in a view; if noised, its look depends on the seed alone.

        Raises:
            UnknownNameError: If there is no such view.
        """
        if name not in self._views:
            raise UnknownNameError(f"No view called {name!r}; available: {', '.join(self._views)}.")
        photograph, offsets = self._views[name], np.zeros((len(layout.blocks), 3))
        if not noised:
            view = self._renderer.view(layout, photograph, masks=True)
            noise: dict[str, Any] = {"kind": "none"}
        else:
            rng = generator(seed, "look")
            look = self._noise.sample(rng, max(len(layout.blocks), 1))
            view = self._renderer.view(layout, photograph, look, masks=True)
            offsets = np.column_stack([look.shifts[:, :2], look.turns[:, 2]])[: len(offsets)]
            kind = "level one"
            if self._sensor is not None:
                view = replace(view, image=self._sensor.apply(view.image, rng))
                kind = "level one and sensor"
            noise = {"kind": kind, **_short_values(look)}
        return Shot(
            view=view,
            camera_from_board=photograph.camera_from_board,
            environment=photograph.environment,
            noise=json.dumps(noise),
            offsets=offsets,
        )


def _short_values(look: Appearance | Look) -> dict[str, Any]:
    """The numbers and short vectors of a look; what varies by block follows from the seed."""
    values = {f.name: getattr(look, f.name) for f in fields(look)}
    short = {n: v for n, v in values.items() if not isinstance(v, np.ndarray) or v.shape == (3,)}
    return {
        name: [round(float(x), 5) for x in value] if isinstance(value, np.ndarray) else value
        for name, value in short.items()
    }
