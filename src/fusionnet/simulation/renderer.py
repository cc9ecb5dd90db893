"""Pictures of layouts with exact labels: what the robot sees before it moves (thesis 3.3.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import SupportsInt

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage

from fusionnet.blocks.grid import Block, Layout
from fusionnet.catalogue import did_you_mean
from fusionnet.errors import InputError, UnknownNameError
from fusionnet.geometry import (
    PinholeCamera,
    PointBehindCameraError,
    invert,
    rotation_from_vector,
    transform,
)
from fusionnet.robots import Robot, load
from fusionnet.simulation.appearance import Appearance
from fusionnet.simulation.offscreen import Offscreen
from fusionnet.simulation.posture import robot_posture
from fusionnet.simulation.scenery import (
    HIDDEN_GROUP,
    SHADOW_RADIUS,
    WIDE_SHADOW_RADIUS,
    add_blocks,
    add_furniture,
    hide_unseen,
    picture_model,
    set_lights,
)
from fusionnet.simulation.silhouettes import Region, region_of, silhouette_areas, visible_shares
from fusionnet.simulation.tabletop import (
    EXTERNAL_POSITION,
    EXTERNAL_TARGET,
    EXTERNAL_VIEW,
    BlockPoses,
    drawn_corners,
    ideal_poses,
)

EXTERNAL = "external"
"""Name of the camera that films the robot, beside those in the robot's own model."""

LEAST_SHARE = 0.25
"""Blocks of which a smaller share is visible are marked as mostly hidden."""

LARGEST = 16384
"""Pixels along a side of a picture; software renderers draw no larger ones."""

_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class View:
    """One picture and what is in it.

    Attributes:
        image: Red, green and blue.
        camera: The camera that took it.
        boxes: Left, top, right and bottom edge (pixels) of the visible part of each block
            of which at least one pixel is visible, occlusion included.
        classes: Class index of the block in each box (`fusionnet.blocks.CLASS_NAMES`).
        indices: Which block of the layout each box belongs to.
        visible: Visible pixels of every block of the layout; 0 where it is hidden.
        shares: For every block of the layout, its visible pixels as a share of its silhouette,
            the area that it would cover in the picture with nothing before it.
        block_at: For each pixel the block of the layout that is seen there, -1 where there is
            none; only if masks were asked for.
        depth: Metres along the camera's axis to what is seen in each pixel; only if asked for.
    """

    image: UInt8[np.ndarray, "h w 3"]
    camera: PinholeCamera
    boxes: Float[np.ndarray, "n 4"]
    classes: Int[np.ndarray, " n"]
    indices: Int[np.ndarray, " n"]
    visible: Int[np.ndarray, " m"]
    shares: Float[np.ndarray, " m"]
    block_at: Int[np.ndarray, "h w"] | None = None
    depth: Float[np.ndarray, "h w"] | None = None

    @property
    def masks(self) -> Bool[np.ndarray, "n h w"]:
        """The visible pixels of the block in each box.

        Raises:
            InputError: If the view was taken without masks.
        """
        if self.block_at is None:
            raise InputError("This view has no masks; take it with masks=True.")
        return self.block_at == self.indices[:, None, None]

    @property
    def mostly_hidden(self) -> Bool[np.ndarray, " n"]:
        """Whether less than a quarter of the block in each box is visible."""
        return self.shares[self.indices] < LEAST_SHARE


class SceneRenderer:
    """Takes pictures of block layouts, of any number of blocks, with one compiled model.

    Only the robot is part of the model. Table, board and blocks are handed to the
    renderer as shapes for each picture, so that a new layout costs nothing but its shapes.

    Args:
        robot: Who is seen, or the name in the robots' catalogue.
        size: Width and height of pictures, in pixels.

    Raises:
        RenderingError: If there is no working OpenGL; the message names a remedy.
        UnknownNameError: If there is no such robot.
        InputError: If the size is not of two whole numbers from 1 to `LARGEST`.
    """

    def __init__(
        self, robot: str | Robot = "nico", size: Sequence[SupportsInt] = (960, 540)
    ) -> None:
        self.size = picture_size(size)
        self.robot: Robot = load(robot) if isinstance(robot, str) else robot
        self.model = picture_model(self.robot, self.size)
        self._data = mujoco.MjData(self.model)
        self._pose(robot_posture(self.model, self.robot, Layout(())))
        self._offscreen = Offscreen(self.model, self.size)
        self._option = mujoco.MjvOption()
        self._option.sitegroup[:] = 0
        self._option.geomgroup[HIDDEN_GROUP] = 0
        self._groups = self.model.geom_group.copy()
        self._free_camera = mujoco.MjvCamera()

    @property
    def cameras(self) -> list[str]:
        """Names of all cameras."""
        return [self.model.camera(i).name for i in range(self.model.ncam)] + [EXTERNAL]

    def view(
        self,
        layout: Layout,
        camera: str = "left_eye",
        appearance: Appearance | None = None,
        labels: bool = True,
        masks: bool = False,
        depth: bool = False,
    ) -> View:
        """A picture of an ideal layout: every block in its cell, the hand away or holding a block.

        Args:
            layout: What stands on the board. If a block is held, the hand is there with it.
            camera: One of `cameras`.
            appearance: Look of the picture; nominal by default.
            labels: Whether boxes and visible pixels are wanted (a second rendering).
            masks: Whether it is wanted which block is seen in each pixel.
            depth: Whether it is wanted how far what is seen in each pixel is.

        Raises:
            UnknownNameError: If there is no such camera.
        """
        appearance = appearance or Appearance()
        poses = ideal_poses(
            layout.blocks,
            self.robot.robot_from_board,
            appearance.block_shifts,
            appearance.block_turns,
        )
        posture = robot_posture(self.model, self.robot, layout)
        return self.draw(posture, layout.blocks, poses, camera, appearance, labels, masks, depth)

    def draw(
        self,
        posture: Float[np.ndarray, " q"],
        blocks: tuple[Block, ...],
        poses: BlockPoses,
        camera: str = "left_eye",
        appearance: Appearance | None = None,
        labels: bool = True,
        masks: bool = False,
        depth: bool = False,
    ) -> View:
        """A picture of the robot in `posture` (all its joints) and blocks at `poses`.

        Raises:
            UnknownNameError: If there is no such camera.
        """
        appearance = appearance or Appearance()
        scene = self._offscreen.scene
        self._pose(posture)
        robot_from_board = self.robot.robot_from_board
        pinhole = self.camera(camera, appearance)
        radius = WIDE_SHADOW_RADIUS if camera == EXTERNAL else SHADOW_RADIUS
        self._offscreen.set_shadow_radius(radius)
        hide_unseen(
            self.model, self._data, self._groups, pinhole, appearance, robot_from_board, radius
        )
        mujoco.mjv_updateScene(
            self.model,
            self._data,
            self._option,
            None,
            self._free_camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            scene,
        )
        set_lights(scene, appearance, robot_from_board)
        add_furniture(scene, self.robot, appearance)
        first = add_blocks(scene, self.model, blocks, poses, appearance.block_tints)
        self._offscreen.aim(pinhole)
        image = appearance.develop(self._offscreen.picture())
        distances = self._offscreen.depth() if depth else None
        block_at = np.full(self.size[::-1], -1, np.int16) if masks else None
        visible, boxes = np.zeros(len(blocks), int), np.zeros((len(blocks), 4))
        shares = np.zeros(len(blocks))
        corners = drawn_corners(blocks, poses)
        region = self._region(pinhole, corners) if labels or masks else None
        if region is not None:
            left, top, right, bottom = region
            identities = self._offscreen.identities()[top:bottom, left:right] - first
            visible, boxes = visible_boxes(identities, len(blocks))
            boxes[visible > 0] += [left, top, left, top]
            shares = visible_shares(visible, silhouette_areas(pinhole, corners))
            if block_at is not None:
                shown = (identities > 0) & (identities <= len(blocks))
                block_at[top:bottom, left:right] = np.where(shown, identities - 1, -1)
        seen = np.flatnonzero(visible)
        classes = np.array([b.class_index for b in blocks], dtype=int)
        return View(
            image, pinhole, boxes[seen], classes[seen], seen, visible, shares, block_at, distances
        )

    def camera(self, name: str = "left_eye", appearance: Appearance | None = None) -> PinholeCamera:
        """The camera called `name`, as it stands in pictures of this appearance.

        The robot is posed as in the last picture; before the first it waits beside the table.

        Raises:
            UnknownNameError: If there is no such camera.
        """
        appearance = appearance or Appearance()
        if name == EXTERNAL:
            robot_from_camera, view = self._external()
        else:
            index = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA, name)
            if index < 0:
                raise UnknownNameError(
                    f"No camera called {name!r}; available: {', '.join(self.cameras)}."
                    + did_you_mean(name, self.cameras)
                )
            rotation = self._data.cam_xmat[index].reshape(3, 3) @ _OPENCV_FROM_OPENGL
            robot_from_camera = transform(rotation, self._data.cam_xpos[index])
            view = float(np.deg2rad(self.model.cam_fovy[index]))
        moved = transform(
            rotation_from_vector(appearance.camera_rotation), appearance.camera_translation
        )
        return PinholeCamera.from_vertical_view(
            self.size, view * appearance.view_scale, invert(robot_from_camera @ moved)
        )

    def close(self) -> None:
        """Free the OpenGL context."""
        self._offscreen.close()

    def _pose(self, posture: Float[np.ndarray, " q"]) -> None:
        """Put the robot, its cameras and lights where a posture has them."""
        self._data.qpos[:] = posture
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_camlight(self.model, self._data)

    def _region(self, camera: PinholeCamera, corners: Float[np.ndarray, "n 8 3"]) -> Region | None:
        """The part of the picture where blocks may be; all of it with one behind the camera."""
        try:
            return region_of(camera, corners)
        except PointBehindCameraError:
            return (0, 0, *self.size)

    def _external(self) -> tuple[Float[np.ndarray, "4 4"], float]:
        forward = EXTERNAL_TARGET - EXTERNAL_POSITION
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        axes = np.column_stack([right, np.cross(forward, right), forward])
        return self.robot.robot_from_board @ transform(axes, EXTERNAL_POSITION), EXTERNAL_VIEW


def visible_boxes(
    identities: Int[np.ndarray, "h w"], count: int
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 4"]]:
    """Pixels and box (left, top, right, bottom edge) of each of the labels 1 to `count`.

    Boxes of labels without a pixel are zero.
    """
    identities = np.where((identities > 0) & (identities <= count), identities, 0)
    visible = np.bincount(identities.ravel(), minlength=count + 1)[1:]
    boxes = np.zeros((count, 4))
    for index, found in enumerate(ndimage.find_objects(identities, max_label=count)):
        if found is not None:
            rows, columns = found
            boxes[index] = columns.start, rows.start, columns.stop, rows.stop
    return visible, boxes


def picture_size(size: Sequence[SupportsInt]) -> tuple[int, int]:
    """Width and height of a picture as whole numbers, in pixels.

    Raises:
        InputError: If the size is not of two whole numbers from 1 to `LARGEST`.
    """
    try:
        width, height = (int(side) for side in size)
        fits = (width, height) == tuple(size) and 1 <= min(width, height)
    except (TypeError, ValueError, OverflowError):
        fits = False
    if not fits or max(width, height) > LARGEST:
        raise InputError(
            f"A picture cannot have the size {size}; give a width and a height of 1 to"
            f" {LARGEST} pixels, such as (960, 540)."
        )
    return width, height


def shared_renderer(
    robot: str | Robot = "nico", size: Sequence[SupportsInt] = (960, 540)
) -> SceneRenderer:
    """One renderer a robot and size; the four that were asked for last are kept.

    Raises:
        RenderingError: As `SceneRenderer`, and so for its other errors.
    """
    return _shared(load(robot) if isinstance(robot, str) else robot, picture_size(size))


@lru_cache(maxsize=4)
def _shared(robot: Robot, size: tuple[int, int]) -> SceneRenderer:
    return SceneRenderer(robot, size)
