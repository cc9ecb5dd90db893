"""Pictures without a window: one OpenGL context, one MuJoCo scene, pixels out.

A thin replacement for `mujoco.Renderer`, which reads and flips more than we need
and maps segmentation colours in Python. Settings are chosen for software rendering
on one core, where MuJoCo's defaults (a 4096 pixel shadow map, four samples a pixel)
cost four times as much as ours.
"""

import ctypes
import importlib.util
import os
import platform
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int, UInt8

from fusionnet.errors import RenderingError
from fusionnet.geometry import PinholeCamera, invert

MAX_GEOMS = 2000
"""Most shapes in one picture: a robot, a board, and some hundred blocks."""

REMEDY = (
    "Install a software renderer (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri), "
    "or set MUJOCO_GL to a backend that works here (egl, osmesa, glfw)."
)


def backend() -> str:
    """The OpenGL backend in use: MUJOCO_GL if set, else EGL on Linux, else the system's own.

    The command line moves MUJOCO_GL to FUSIONNET_GL before MuJoCo is imported.
    """
    chosen = os.environ.get("FUSIONNET_GL") or os.environ.get("MUJOCO_GL", "")
    chosen = chosen.strip().lower()
    if chosen in ("egl", "osmesa", "glfw", "cgl"):
        return chosen
    if chosen in ("disable", "disabled", "off", "false", "0"):
        return "disabled"
    return {"Linux": "egl", "Darwin": "cgl"}.get(platform.system(), "glfw")


def _open_context(width: int, height: int) -> Any:
    """A current OpenGL context of the chosen backend; any failure becomes one line."""
    name = backend()
    if name == "disabled":
        raise RenderingError("Rendering is switched off by MUJOCO_GL; unset it or set it to egl.")
    _load_triton()
    try:
        context = importlib.import_module(f"mujoco.{name}").GLContext(width, height)
        context.make_current()
    except Exception as error:  # PyOpenGL raises half a dozen unrelated types here
        raise RenderingError(
            f"No picture can be rendered: the OpenGL backend {name!r} failed ({_reason(error)})."
            f" {REMEDY}"
        ) from error
    return context


def _reason(error: Exception) -> str:
    """The first line of an error's message, or its type's name if it has none."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


@cache
def _load_triton() -> None:
    """Load the library of PyTorch's compiler, where there is one, before the first picture.

    Mesa's software renderer and Triton both bring LLVM. Triton bears to be loaded first, but
    loading it after a picture ends the process: `import torchvision` would then be a crash.
    """
    found = importlib.util.find_spec("triton")
    for folder in (found.submodule_search_locations or ()) if found is not None else ():
        library = Path(folder) / "_C" / "libtriton.so"
        if library.is_file():
            with suppress(OSError):
                ctypes.CDLL(str(library))


class Offscreen:
    """An OpenGL context with the meshes and textures of one model.

    Args:
        model: Compiled model; its offscreen buffer must hold `size`.
        size: Width and height of pictures, in pixels.

    Raises:
        RenderingError: If there is no working OpenGL; the message names a remedy.
    """

    def __init__(self, model: mujoco.MjModel, size: tuple[int, int]) -> None:
        self.size = size
        self.scene = mujoco.MjvScene(model, maxgeom=MAX_GEOMS)
        self._rectangle = mujoco.MjrRect(0, 0, *size)
        self._gl = _open_context(*size)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        extent, visual = model.stat.extent, model.vis.map
        self._near, self._far = visual.znear * extent, visual.zfar * extent
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def aim(self, camera: PinholeCamera) -> None:
        """Look through a camera whose principal point is the middle of the picture.

        The scene has two OpenGL cameras, one for each eye of a stereo display; both get it.
        """
        robot_from_camera = invert(camera.camera_from_robot)
        for eye in self.scene.camera:
            half_height = 0.5 * camera.height / camera.matrix[1, 1] * eye.frustum_near
            eye.pos[:] = robot_from_camera[:3, 3]
            eye.up[:] = -robot_from_camera[:3, 1]
            eye.forward[:] = robot_from_camera[:3, 2]
            eye.frustum_center = 0.0
            eye.frustum_width = half_height * camera.width / camera.height
            eye.frustum_bottom, eye.frustum_top = -half_height, half_height

    def set_shadow_radius(self, radius: float) -> None:
        """Throw shadows within this distance of where the light points, in metres."""
        self._context.shadowClip = radius

    def picture(self, size: tuple[int, int] | None = None) -> UInt8[np.ndarray, "h w 3"]:
        """The scene in colour, of another size than the context's own if asked."""
        return self._pixels(size)

    def depth(self) -> Float[np.ndarray, "h w"]:
        """Metres along the camera's axis to what `picture` has just shown in each pixel.

        Where there is nothing, the distance to the far end of the view (12 m).
        """
        width, height = self.size
        buffer = np.empty((height, width), np.float32)
        self._make_current()
        mujoco.mjr_readPixels(None, buffer, self._rectangle, self._context)
        near, far = self._near, self._far
        # The buffer is 1 at the near end, 0 at the far one, and linear in 1 / depth.
        metres = near * far / (buffer[::-1].astype(np.float64) * (far - near) + near)
        return metres.astype(np.float32)

    def identities(self, size: tuple[int, int] | None = None) -> Int[np.ndarray, "h w"]:
        """For each pixel the `segid` of the shape seen there plus one; 0 where there is none."""
        flags = self.scene.flags
        kept = flags.copy()
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = True
        flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = True
        try:
            pixels = self._pixels(size)
        finally:
            np.copyto(flags, kept)
        numbers: np.ndarray = pixels[..., 1].astype(np.int32)
        numbers *= 256
        numbers += pixels[..., 0]
        return numbers

    def _pixels(self, size: tuple[int, int] | None) -> UInt8[np.ndarray, "h w 3"]:
        width, height = size or self.size
        rectangle = mujoco.MjrRect(0, 0, width, height)
        self._make_current()
        mujoco.mjr_render(rectangle, self.scene, self._context)
        pixels = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, rectangle, self._context)
        return pixels[::-1]

    def _make_current(self) -> None:
        if self._context is None:
            raise RenderingError("This renderer was closed; make a new one.")
        try:
            self._gl.make_current()
        except Exception as error:  # PyOpenGL's, as above
            raise RenderingError(
                f"This renderer takes no picture here ({_reason(error)}); it serves the thread"
                " that made it alone."
            ) from error

    def close(self) -> None:
        """Free the OpenGL context; nothing can be rendered after."""
        if self._context is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._context = None

    def __del__(self) -> None:
        # Left to itself, MuJoCo frees the textures and lists of whichever context is current.
        if getattr(self, "_context", None) is not None:
            with suppress(Exception):  # while Python shuts down, half of it is gone
                self.close()
