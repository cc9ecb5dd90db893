"""What is true of a picture as a network sees it: boxes, cells, camera."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from fusionnet.blocks import Layout
from fusionnet.dataset.frame import PictureFrame
from fusionnet.errors import UnknownNameError
from fusionnet.simulation import Appearance, SceneRenderer

LEAST_PIXELS = 12
"""Blocks with fewer visible pixels of the eye's picture get no box."""

EYE_FRAMES = {
    "left_eye": PictureFrame(eye_size=(960, 540), crop=(190, 28, 782, 540), input_size=(480, 416)),
    "right_eye": PictureFrame(eye_size=(960, 540), crop=(16, 28, 608, 540), input_size=(480, 416)),
}
"""The part of each of NICO's eyes in which the 8x8x8 grid appears, at 0.81 of its size."""

EYE_FRAME = EYE_FRAMES["left_eye"]
"""That of the eye which looks where nothing else is said."""


@dataclass(frozen=True)
class Labels:
    """What is true of one picture.

    Attributes:
        boxes: Left, top, right, bottom in pixels of the network's input.
        classes: Index into `CLASS_NAMES` for each box.
        hidden: Whether less than a quarter of the block in each box is visible.
        cells: Class of each of the 512 cells; `EMPTY` where there is no block.
        visible: Visible pixels (of the eye's picture) of the block in each cell.
        offsets: How far the block in each cell stands beside the cell's middle, along x and y
            of the board in metres, and how far it is turned about the vertical, in radians.
        holding: Whether the gripper holds a block.
        matrix: Intrinsics for the network's input.
        camera_from_board: Pose of the eye.
        by_eye: Whether an eye of the robot looked, through which layouts are read.
    """

    boxes: Float[np.ndarray, "n 4"]
    classes: Int[np.ndarray, " n"]
    hidden: Bool[np.ndarray, " n"]
    cells: Int[np.ndarray, "512"]
    visible: Int[np.ndarray, "512"]
    offsets: Float[np.ndarray, "512 3"]
    holding: bool
    matrix: Float[np.ndarray, "3 3"]
    camera_from_board: Float[np.ndarray, "4 4"]
    by_eye: bool = True


def block_offsets(layout: Layout, look: Appearance) -> Float[np.ndarray, "512 3"]:
    """`Labels.offsets` of a layout's picture in a look."""
    offsets, count = np.zeros((512, 3)), len(layout.blocks)
    cells = [block.cell.index for block in layout.blocks]
    offsets[cells, :2] = look.block_shifts[:count]
    offsets[cells, 2] = look.block_turns[:count]
    return offsets


def label(
    renderer: SceneRenderer,
    layout: Layout,
    appearance: Appearance,
    frame: PictureFrame | None = None,
    camera: str = "left_eye",
) -> tuple[UInt8[np.ndarray, "h w 3"], Labels]:
    """The network's input for a layout, and what is true of it.

    Args:
        renderer: Takes the picture.
        layout: What stands on the board.
        appearance: How it looks.
        frame: The part of the picture that the network sees; by default the eye's own.
        camera: Name of the eye that looks.

    Raises:
        UnknownNameError: If there is no such camera, or no frame is given and none is known of it.
    """
    if frame is None and camera not in EYE_FRAMES:
        raise UnknownNameError(
            f"No frame is known of the camera {camera!r}, only of {', '.join(EYE_FRAMES)}; name "
            "the frame, too."
        )
    frame = frame or EYE_FRAMES[camera]
    view = renderer.view(layout, camera=camera, appearance=appearance)
    visible = np.zeros(512, dtype=int)
    for block, pixels in zip(layout.blocks, view.visible, strict=True):
        visible[block.cell.index] = pixels
    shown = view.visible[view.indices] >= LEAST_PIXELS
    boxes = frame.to_input(view.boxes[shown].astype(float))
    return frame.prepare(view.image), Labels(
        boxes=np.clip(boxes, 0, np.tile(frame.input_size, 2)),
        classes=view.classes[shown],
        hidden=view.mostly_hidden[shown],
        cells=layout.cell_classes.reshape(512),
        visible=visible,
        offsets=block_offsets(layout, appearance),
        holding=layout.held is not None,
        matrix=frame.matrix(view.camera.matrix),
        camera_from_board=view.camera.camera_from_robot @ renderer.robot.robot_from_board,
    )
