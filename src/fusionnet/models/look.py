"""Look at a picture of any size: boxes in its own pixels, and the layout if a board is seen.

The detector always answers with a camera and with cells. Of a picture in which no board
lies where the camera says, they would be invented; then there is no layout.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8

from fusionnet.blocks import Layout
from fusionnet.blocks.voting import likely_layout
from fusionnet.models.labelled_boxes import Boxes
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.sight import BOARD_SEEN, Sight, board_evidence, padded_to_aspect


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What is seen in a picture.

    Attributes:
        boxes: Detections, in pixels of the picture.
        board: How clearly a board lies where the estimated camera says, 0 to 1; None of a
            detector that finds boxes only.
        layout: The most likely layout; None if no board is seen, or of boxes only.
        probabilities: Of each block of the layout: that its cell holds a block of its class.
        holding: Probability that the gripper holds a block; None without a layout.
    """

    boxes: Boxes
    board: float | None = None
    layout: Layout | None = None
    probabilities: tuple[float, ...] = ()
    holding: float | None = None


def look(
    model: RetinaNet, image: UInt8[np.ndarray, "h w 3"], elsewhere: RetinaNet | None = None
) -> Look:
    """Boxes and layout of a picture of any size and aspect.

    Args:
        model: Detector of one of the robot's eyes, or of boxes alone.
        image: The picture.
        elsewhere: Finds the boxes in all of the picture where no board is seen as that eye sees
            it; `model` itself by default.
    """
    elsewhere = elsewhere or model
    if not model.config.reads_layouts:
        return Look(boxes=elsewhere.detect(image))
    whole = padded_to_aspect(image, model.frame.eye_size)
    sight, board = seen_by_eye(model, whole)
    scale = np.array([whole.shape[1], whole.shape[0]]) / model.frame.eye_size
    if board < BOARD_SEEN:
        return Look(boxes=elsewhere.detect(image), board=board)
    boxes = _within(sight.boxes, scale, (image.shape[1], image.shape[0]))
    layout = likely_layout(sight.cells, sight.holding)
    return Look(
        boxes=boxes,
        board=board,
        layout=layout,
        probabilities=tuple(
            float(sight.cells[*block.cell, block.class_index]) for block in layout.blocks
        ),
        holding=sight.holding,
    )


def seen_by_eye(model: RetinaNet, picture: UInt8[np.ndarray, "h w 3"]) -> tuple[Sight, float]:
    """What an eye's detector reads, and how clearly a board lies where it says (`BOARD_SEEN`).

    Args:
        model: Detector that reads layouts.
        picture: In the aspect of the eye's, of any size (`padded_to_aspect`).
    """
    eye = cv2.resize(picture, model.frame.eye_size, interpolation=cv2.INTER_AREA)
    sight = model.see(eye)
    return sight, board_evidence(eye, sight.corners)


def _within(boxes: Boxes, scale: Float[np.ndarray, "2"], size: tuple[int, int]) -> Boxes:
    """Boxes of the eye in pixels of a picture, without what lies on its border."""
    xyxy = (boxes.xyxy.double().numpy() * np.tile(scale, 2)).clip(0, np.tile(size, 2))
    kept = torch.from_numpy((xyxy[:, 2:] - xyxy[:, :2]).min(axis=1) > 0)
    return Boxes(torch.from_numpy(xyxy)[kept], boxes.classes[kept], boxes.scores[kept])
