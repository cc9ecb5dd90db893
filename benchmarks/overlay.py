"""How many finished, labelled, JPEG-encoded overlays a second, against named rivals.

    MUJOCO_GL=egl OMP_NUM_THREADS=1 python benchmarks/overlay.py

Prints JSON. A sample is a view with blocks and shadows drawn into it under level-one noise,
boxes, classes, masks and visible shares, encoded as JPEG. The rival is differential rendering
as MuJoCo's own Renderer does it with MuJoCo's default quality (a 4096 pixel shadow map, four
samples a pixel): the blocks on a plain table in colour, the table without them (once, though
the light varies), the segmentation; then the same labels and the same JPEG. Both are measured
in turns, in processor seconds on one thread. BlenderProc's 1 to 4 seconds an image are
published, not measured here. MUJOCO_GL must be set, or the rival draws in our context.
"""

import copy
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import mujoco
import numpy as np
import tyro

from fusionnet.blocks import Layout, random_layout
from fusionnet.geometry import PinholeCamera, invert
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.simulation import BLOCK_COLORS, SceneRenderer
from fusionnet.simulation.renderer import visible_boxes
from fusionnet.simulation.scenery import add_blocks, picture_model, set_lights
from fusionnet.simulation.silhouettes import silhouette_areas, visible_shares
from fusionnet.simulation.tabletop import BOARD_SIZE, drawn_corners
from fusionnet.views import EnvironmentalView, Look, OverlayRenderer, level_one
from fusionnet.views.lighting import estimate_light
from fusionnet.views.overlay import displaced_poses

BLENDERPROC_SECONDS = (1.0, 4.0)
"""Seconds an image as published for BlenderProc, which path-traces; not measured here."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        samples: Of each way.
        size: Width and height, in pixels.
        quality: Of the JPEG.
        seed: Everything random derives from it.
    """

    samples: int = 100
    size: tuple[int, int] = (960, 540)
    quality: int = 90
    seed: int = 0


def empty_table(size: tuple[int, int]) -> EnvironmentalView:
    """What the robot's left eye sees of its table without blocks, in the place of a photograph."""
    eye = SceneRenderer(size=size)
    seen = eye.view(Layout(()))
    board = seen.camera.camera_from_robot @ eye.robot.robot_from_board
    eye.close()
    return EnvironmentalView(
        name="left eye",
        environment="simulation",
        part="val",
        image=seen.image,
        matrix=seen.camera.matrix,
        camera_from_board=board,
    )


class ByDefault:
    """Differential rendering with `mujoco.Renderer` and MuJoCo's default quality."""

    def __init__(self, view: EnvironmentalView, size: tuple[int, int]) -> None:
        self.view = view
        self.size = size
        self.model = copy.copy(picture_model(None, size))
        default = mujoco.MjModel.from_xml_string("<mujoco/>").vis.quality
        for setting in ("shadowsize", "offsamples", "numslices", "numstacks"):
            setattr(self.model.vis.quality, setting, getattr(default, setting))
        self.settings = {"shadow_map": int(default.shadowsize), "samples": int(default.offsamples)}
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.renderer = mujoco.Renderer(self.model, size[1], size[0], max_geom=2000)
        self.light = estimate_light(view)
        self.without = self._draw(None, Look()).astype(np.float32)

    def _draw(self, layout: Layout | None, look: Look) -> np.ndarray:
        self.renderer.update_scene(self.data)
        scene = self.renderer.scene
        set_lights(scene, look.on_light(self.light), np.eye(4))
        scene.ngeom += 1
        table = scene.geoms[scene.ngeom - 1]
        mujoco.mjv_initGeom(
            table,
            mujoco.mjtGeom.mjGEOM_BOX,
            np.array([1.0, 1.0, 0.01]),
            np.array([BOARD_SIZE / 2, BOARD_SIZE / 2, -0.01]),
            np.eye(3).ravel(),
            np.array([0.9, 0.9, 0.9, 1.0], np.float32),
        )
        table.category = mujoco.mjtCatBit.mjCAT_DYNAMIC
        table.segid, table.objid, table.castshadow = 0, -1, False
        if layout is not None:
            tints = np.array(
                [look.tint(BLOCK_COLORS[b.color], i) for i, b in enumerate(layout.blocks)]
            )
            poses = displaced_poses(layout.blocks, look)
            first = add_blocks(scene, self.model, layout.blocks, poses, tints)
            for index, geom in enumerate(scene.geoms[first : scene.ngeom]):
                geom.objid = index
        pose = invert(self.view.camera_from_board)
        for eye in scene.camera:
            near, focal = eye.frustum_near, self.view.matrix[1, 1]
            half = 0.5 * self.size[1] / focal * near
            eye.pos[:], eye.up[:], eye.forward[:] = pose[:3, 3], -pose[:3, 1], pose[:3, 2]
            eye.frustum_center, eye.frustum_width = 0.0, half * self.size[0] / self.size[1]
            eye.frustum_bottom, eye.frustum_top = -half, half
        return self.renderer.render()

    def sample(self, layout: Layout, look: Look) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Picture, boxes and shares of one layout."""
        drawn = self._draw(layout, look)
        self.renderer.enable_segmentation_rendering()
        identities = self.renderer.render()[..., 0] + 1
        self.renderer.disable_segmentation_rendering()
        photograph = look.on_photograph(self.view.image)
        ratio = np.clip(drawn / np.maximum(self.without, 1.0), 0.0, 1.0)
        ratio[self.without < 1.0] = 1.0  # beyond the table
        shaded = np.clip(photograph * ratio, 0, 255).astype(np.uint8)
        image = np.where((identities > 0)[..., None], drawn, shaded)
        visible, boxes = visible_boxes(identities, len(layout.blocks))
        corners = drawn_corners(layout.blocks, displaced_poses(layout.blocks, look))
        camera = PinholeCamera(*self.size, self.view.matrix, self.view.camera_from_board)
        return image, boxes, visible_shares(visible, silhouette_areas(camera, corners))


def encoded(image: np.ndarray, quality: int) -> bytes:
    """The picture as a JPEG."""
    swapped = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode(".jpg", swapped, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def measure(config: Config) -> dict[str, Any]:
    """Processor time of finished samples, ours and the rival's."""
    begun = time.perf_counter()
    cv2.setNumThreads(1)
    view = empty_table(config.size)
    layouts = [random_layout(generator(config.seed, "layout", i)) for i in range(config.samples)]
    level = level_one(0.15)
    looks = [level.sample(generator(config.seed, "look", i), 64) for i in range(config.samples)]
    ours = OverlayRenderer(config.size)
    rival = ByDefault(view, config.size)
    ways: dict[str, Callable[[int], object]] = {
        "ours": lambda i: encoded(
            ours.view(layouts[i], view, looks[i], masks=True).image, config.quality
        ),
        "ours_without_jpeg": lambda i: ours.view(layouts[i], view, looks[i], masks=True),
        "mujoco_default": lambda i: encoded(rival.sample(layouts[i], looks[i])[0], config.quality),
    }
    mine = ours.view(layouts[0], view)
    image, boxes, _ = rival.sample(layouts[0], Look())
    agreement = {
        "mean_difference_of_a_pixel": round(
            float(np.abs(mine.image.astype(float) - image.astype(float)).mean()), 2
        ),
        "largest_difference_of_a_box_in_pixels": float(
            np.abs(mine.boxes - boxes[mine.indices]).max()
        ),
    }
    for way in ways.values():
        way(0)
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for index in range(config.samples):
        for name, way in ways.items():
            begin = time.process_time()
            way(index)
            seconds[name].append(time.process_time() - begin)
    mean = {name: float(np.mean(taken)) for name, taken in seconds.items()}
    fastest, slowest = BLENDERPROC_SECONDS
    return {
        "size": config.size,
        "samples": config.samples,
        "blocks_on_average": float(np.mean([len(layout.blocks) for layout in layouts])),
        "rival_quality": rival.settings,
        "agreement_of_the_two": agreement,
        "milliseconds": {n: round(1000 * s, 1) for n, s in mean.items()},
        "samples_a_second_and_core": {n: round(1 / s, 1) for n, s in mean.items()},
        "times_as_fast_as_mujoco_default": round(mean["mujoco_default"] / mean["ours"], 2),
        "blenderproc_published_images_a_second": [1 / slowest, 1 / fastest],
        "times_as_fast_as_blenderproc_published": [
            round(fastest / mean["ours"]),
            round(slowest / mean["ours"]),
        ],
        "seed": config.seed,
        "duration_seconds": round(time.perf_counter() - begun, 1),
        **provenance(),
    }


if __name__ == "__main__":
    print(json.dumps(measure(tyro.cli(Config)), indent=1))
