"""Blocks drawn into a photograph: augmented reality with exact labels (thesis 3.2.4).

MuJoCo draws the blocks, and only them, with the intrinsics of the photograph's own camera,
at twice the resolution in the part of the picture where they are; the table of the photograph
takes their shadows (`shadows.py`), and light is estimated from it (`lighting.py`).
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import mujoco
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.spatial.transform import Rotation

from fusionnet.blocks.grid import Block, Layout
from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera, PointBehindCameraError, invert
from fusionnet.robots import load
from fusionnet.simulation import BLOCK_COLORS, Appearance, View
from fusionnet.simulation.offscreen import Offscreen
from fusionnet.simulation.renderer import visible_boxes
from fusionnet.simulation.scenery import add_blocks, board_center, picture_model, set_lights
from fusionnet.simulation.silhouettes import Region, region_of, silhouette_areas, visible_shares
from fusionnet.simulation.tabletop import BlockPoses, drawn_corners, ideal_poses
from fusionnet.views.lighting import estimate_light
from fusionnet.views.noise import Look
from fusionnet.views.shadows import cast_shadows
from fusionnet.views.view import EnvironmentalView

SUPERSAMPLING = 2
"""Colour samples a pixel along each axis, where there are blocks."""

SHADOW_PIXELS = 512
"""Edge of the map of the shadows that blocks throw on blocks."""

_TWIN_SCALE = 0.95
_BLACK = np.zeros(3)
_BOARD = np.eye(4)
_PLAIN = Look()


@dataclass(frozen=True, eq=False)
class _Backdrop:
    """A photograph of the renderer's size, its light, and its camera in the board frame."""

    image: UInt8[np.ndarray, "h w 3"]
    camera: PinholeCamera
    light: Appearance


class OverlayRenderer:
    """Draws layouts into environmental views; made once a process, for pictures of one size.

    Args:
        size: Width and height of pictures, in pixels; photographs of another size are resized
            (each axis by its own factor) and their intrinsics with them.
        robot: Name in the robots' catalogue, in whose frame the cameras of views are given.

    Raises:
        RenderingError: If there is no working OpenGL; the message names a remedy.
        UnknownNameError: If there is no such robot.
    """

    def __init__(self, size: tuple[int, int] = (960, 540), robot: str = "nico") -> None:
        self.size = size
        self.robot = load(robot)
        largest = (SUPERSAMPLING * size[0], SUPERSAMPLING * size[1])
        self._model = picture_model(None, largest, SHADOW_PIXELS)
        self._offscreen = Offscreen(self._model, largest)
        data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, data)
        mujoco.mjv_updateScene(
            self._model,
            data,
            mujoco.MjvOption(),
            None,
            mujoco.MjvCamera(),
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._offscreen.scene,
        )
        self._backdrop = lru_cache(maxsize=64)(self._prepare)

    def view(
        self,
        layout: Layout,
        view: EnvironmentalView,
        look: Look = _PLAIN,
        light: Appearance | None = None,
        masks: bool = False,
    ) -> View:
        """The photograph with a layout on its board, and what is seen where.

        A held block hangs in the air: there is no hand in a photograph.

        Args:
            layout: What stands on the board.
            view: The photograph.
            look: Level-one noise; none by default.
            light: Falls on the blocks; estimated from the photograph by default.
            masks: Whether it is wanted which block is seen in each pixel.

        Raises:
            PointBehindCameraError: If the camera looks from among the blocks.
            InputError: If the look is for fewer blocks than there are.
        """
        backdrop = self._backdrop(view)
        if len(look.shifts) < len(layout.blocks):
            raise InputError(
                f"The look is for {len(look.shifts)} blocks, the layout has {len(layout.blocks)}; "
                "sample it for as many."
            )
        light = look.on_light(light or backdrop.light)
        poses = displaced_poses(layout.blocks, look)
        corners = drawn_corners(layout.blocks, poses)
        image = look.on_photograph(backdrop.image)
        region = self._region(backdrop.camera, corners, view.name)
        if light.shadows:
            image = cast_shadows(image, corners, light, backdrop.camera)
        image = image.copy() if image is backdrop.image else image
        count = len(layout.blocks)
        visible, boxes = np.zeros(count, int), np.zeros((count, 4))
        block_at = np.full(self.size[::-1], -1, np.int16) if masks else None
        if region is not None:
            tints = np.array(
                [look.tint(BLOCK_COLORS[b.color], i) for i, b in enumerate(layout.blocks)]
            )
            self._set_scene(layout.blocks, poses, tints, light, corners)
            self._aim(backdrop.camera, region)
            identities = self._draw(image, region)
            left, top, right, bottom = region
            visible, boxes = visible_boxes(identities, count)
            boxes += [left, top, left, top]
            if block_at is not None:
                block_at[top:bottom, left:right] = identities - 1
        seen = np.flatnonzero(visible)
        camera = replace(
            backdrop.camera,
            camera_from_robot=view.camera_from_board @ invert(self.robot.robot_from_board),
        )
        return View(
            image=image,
            camera=camera,
            boxes=boxes[seen],
            classes=np.array([b.class_index for b in layout.blocks], dtype=int)[seen],
            indices=seen,
            visible=visible,
            shares=visible_shares(visible, silhouette_areas(backdrop.camera, corners)),
            block_at=block_at,
        )

    def close(self) -> None:
        """Free the OpenGL context."""
        self._offscreen.close()

    def _prepare(self, view: EnvironmentalView) -> _Backdrop:
        height, width = view.image.shape[:2]
        scale = np.array(self.size) / [width, height]
        # Whole numbers are the centres of pixels, but edges are what resizing keeps.
        to_size = np.array(
            [
                [scale[0], 0.0, 0.5 * scale[0] - 0.5],
                [0.0, scale[1], 0.5 * scale[1] - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )
        image = view.image
        if (width, height) != self.size:
            shrinks = scale.min() < 1.0
            image = cv2.resize(
                image, self.size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
            )
        camera = PinholeCamera(*self.size, to_size @ view.matrix, view.camera_from_board)
        return _Backdrop(np.ascontiguousarray(image), camera, estimate_light(view))

    def _region(
        self, camera: PinholeCamera, corners: Float[np.ndarray, "n 8 3"], name: str
    ) -> Region | None:
        """Left, top, right and bottom edge of the part of the picture where blocks may be."""
        try:
            return region_of(camera, corners)
        except PointBehindCameraError as error:
            raise PointBehindCameraError(
                f"The camera of view {name!r} looks from among the blocks; choose another view."
            ) from error

    def _set_scene(
        self,
        blocks: tuple[Block, ...],
        poses: BlockPoses,
        tints: Float[np.ndarray, "n 3"],
        light: Appearance,
        corners: Float[np.ndarray, "n 8 3"],
    ) -> None:
        scene = self._offscreen.scene
        scene.ngeom = 0
        set_lights(scene, light, _BOARD)
        add_blocks(scene, self._model, blocks, poses, tints)
        # Surfaces that shade themselves come out speckled; slightly smaller, hidden, twins throw
        # the shadows instead.
        for geom in scene.geoms[: scene.ngeom]:
            geom.castshadow = False
        assert poses.scales is not None
        twins = replace(poses, scales=_TWIN_SCALE * poses.scales)
        add_blocks(scene, self._model, blocks, twins, tints)
        offsets = corners.reshape(-1, 3) - board_center(_BOARD)
        # No wider than the blocks, so that a small shadow map is fine enough.
        self._offscreen.set_shadow_radius(np.linalg.norm(offsets, axis=1).max() + 0.005)

    def _draw(self, image: UInt8[np.ndarray, "h w 3"], region: Region) -> Int[np.ndarray, "h2 w2"]:
        """Draw the scene's blocks into the picture; the number, from 1, seen in each pixel."""
        left, top, right, bottom = region
        size = (right - left, bottom - top)
        fine = self._offscreen.picture((SUPERSAMPLING * size[0], SUPERSAMPLING * size[1]))
        fine = np.ascontiguousarray(fine)
        # Around the blocks the rendering is black, so its mean is already weighted by coverage.
        drawn = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        uncovered = cv2.resize(
            cv2.inRange(fine, _BLACK, _BLACK), size, interpolation=cv2.INTER_AREA
        )
        part = np.ascontiguousarray(image[top:bottom, left:right])
        part = cv2.multiply(part, cv2.cvtColor(uncovered, cv2.COLOR_GRAY2RGB), scale=1.0 / 255.0)
        image[top:bottom, left:right] = cv2.add(part, drawn)
        return self._offscreen.identities(size)

    def _aim(self, camera: PinholeCamera, region: Region) -> None:
        """Point both OpenGL cameras (one for each eye of a stereo display) at a region."""
        board_from_camera = invert(camera.camera_from_robot)
        left, top, right, bottom = (
            np.array(region) - 0.5 - np.tile(camera.matrix[:2, 2], 2)
        ) / np.tile(np.diag(camera.matrix)[:2], 2)
        for eye in self._offscreen.scene.camera:
            near = eye.frustum_near
            eye.pos[:] = board_from_camera[:3, 3]
            eye.up[:] = -board_from_camera[:3, 1]
            eye.forward[:] = board_from_camera[:3, 2]
            eye.frustum_center = 0.5 * (left + right) * near
            eye.frustum_width = 0.5 * (right - left) * near
            eye.frustum_top, eye.frustum_bottom = -top * near, -bottom * near


def displaced_poses(blocks: tuple[Block, ...], look: Look = _PLAIN) -> BlockPoses:
    """Every block in its cell as this look moves and scales it, in the board frame."""
    ideal = ideal_poses(blocks, _BOARD)
    count = len(blocks)
    turns = Rotation.from_euler("xyz", look.turns[:count]).as_matrix() if count else ideal.rotations
    return BlockPoses(ideal.positions + look.shifts[:count], turns, look.scales[:count])
