"""A window in which a world is watched while it moves; needs a display."""

import importlib
import os
import platform
import threading
import time
from typing import Any

import mujoco
import numpy as np

from fusionnet.errors import RenderingError
from fusionnet.geometry import apply
from fusionnet.robots import Robot
from fusionnet.simulation.appearance import Appearance
from fusionnet.simulation.scenery import add_furniture
from fusionnet.simulation.tabletop import EXTERNAL_POSITION, EXTERNAL_TARGET

REMEDY = "Film the episode instead: `fusionnet simulate ... --video FILE`, or Episode.video."


class LiveViewer:
    """MuJoCo's own viewer on a running world, no faster than a clock.

    Args:
        robot: Says where table and board are.
        model: The world.
        data: Its state, which others change.

    Raises:
        RenderingError: If there is no display, or no window can be opened.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._data = data
        _light(model)
        before = set(threading.enumerate())
        self._window = _open_window(model, data)
        self._threads = [t for t in threading.enumerate() if t not in before]
        with self._window.lock():
            camera = self._window.cam
            camera.lookat[:] = apply(robot.robot_from_board, EXTERNAL_TARGET)
            away = EXTERNAL_TARGET - EXTERNAL_POSITION
            camera.distance = float(np.linalg.norm(away))
            camera.azimuth = float(np.degrees(np.arctan2(away[1], away[0])))
            camera.elevation = float(np.degrees(np.arcsin(away[2] / camera.distance)))
            add_furniture(self._window.user_scn, robot, Appearance())
        self._begin = time.perf_counter() - data.time
        self.show()

    @property
    def is_open(self) -> bool:
        """Whether the window has not been closed."""
        return bool(self._window.is_running())

    def show(self) -> None:
        """Show the present state, when its time has come."""
        ahead = self._begin + self._data.time - time.perf_counter()
        if ahead > 0:
            time.sleep(ahead)
        else:  # others took their time; do not hurry to catch up
            self._begin -= ahead
        if self.is_open:
            self._window.sync()

    def close(self) -> None:
        """Close the window, and wait until its threads have freed what they draw."""
        self._window.close()
        for thread in self._threads:
            thread.join(timeout=5.0)


def _light(model: mujoco.MjModel) -> None:
    """Brighten the lamp at the window's camera: a world has no lights of its own."""
    look = Appearance()
    lamp = model.vis.headlight
    lamp.ambient[:], lamp.diffuse[:], lamp.specular[:] = look.ambient, look.light, 0.1


def _open_window(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    if platform.system() == "Linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise RenderingError(f"There is no display for a window (DISPLAY is not set). {REMEDY}")
    try:
        viewer = importlib.import_module("mujoco.viewer")
        return viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    except Exception as error:  # GLFW and the viewer raise many unrelated types here
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise RenderingError(f"No window can be opened ({reason}). {REMEDY}") from error
