"""Which part of a stored picture a network sees, and the labels in that part.

Through one of the robot's eyes it is the eye's fixed crop; in an environmental view it is where
the 8x8x8 grid appears, with a margin (thesis 6.1).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet.blocks import BLOCK_SIZE, EMPTY, GRID
from fusionnet.dataset.frame import PictureFrame, decoded
from fusionnet.dataset.pictures import (
    EYE_FRAME,
    EYE_FRAMES,
    LEAST_PIXELS,
    Labels,
)
from fusionnet.dataset.recipes import EYE
from fusionnet.errors import DataError, InputError

MARGIN = 0.06
"""Around the grid on each side, as a share of its extent in the picture."""

SOFTEST = 1.1
"""A picture may be decoded at a half, quarter or eighth if that is enlarged no more than this."""

_STEP = 8
"""Crops begin and end at multiples of this, so that reduced pictures can be cropped alike."""

_REDUCED = {
    1: cv2.IMREAD_COLOR,
    2: cv2.IMREAD_REDUCED_COLOR_2,
    4: cv2.IMREAD_REDUCED_COLOR_4,
    8: cv2.IMREAD_REDUCED_COLOR_8,
}


def grid_frame(
    matrix: Float[np.ndarray, "3 3"],
    camera_from_board: Float[np.ndarray, "4 4"],
    size: tuple[int, int],
    input_size: tuple[int, int],
    margin: float = MARGIN,
) -> PictureFrame:
    """The part of a picture in which the whole grid appears.

    Args:
        matrix: Intrinsics of the picture.
        camera_from_board: Pose of its camera.
        size: Width and height of the picture, in pixels.
        input_size: Width and height of the network's input, in pixels.
        margin: Share of the grid's extent that is added on each side.

    Raises:
        InputError: If the grid does not appear in the picture.
    """
    ends = (0.0, GRID * BLOCK_SIZE)
    corners = np.array([[x, y, z, 1.0] for x in ends for y in ends for z in ends])
    in_camera = (corners @ camera_from_board.T)[:, :3]
    if (in_camera[:, 2] <= 0).any():
        raise InputError("Part of the grid lies behind the camera; the picture cannot be cropped.")
    projected = in_camera @ matrix.T
    pixels = projected[:, :2] / projected[:, 2:] + 0.5
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    middle, extent = (low + high) / 2, (high - low) * (1 + 2 * margin)
    wanted = np.array(input_size, dtype=float)
    extent = wanted * (extent / wanted).max()
    limit = np.array(size)
    start = np.clip(np.floor((middle - extent / 2) / _STEP) * _STEP, 0, limit).astype(int)
    end = np.clip(np.ceil((middle + extent / 2) / _STEP) * _STEP, 0, limit).astype(int)
    if (end - start < _STEP).any():
        raise InputError("The grid does not appear in the picture; it cannot be cropped.")
    crop = (int(start[0]), int(start[1]), int(end[0]), int(end[1]))
    return PictureFrame(eye_size=size, crop=crop, input_size=input_size)


def whole_frame(size: tuple[int, int], input_size: tuple[int, int]) -> PictureFrame:
    """The whole picture."""
    return PictureFrame(eye_size=size, crop=(0, 0, *size), input_size=input_size)


def frame_of(
    sample: Mapping[str, Any], input_size: tuple[int, int] = EYE_FRAME.input_size
) -> PictureFrame:
    """The part of a stored sample's picture that a network sees."""
    camera = sample["camera"]
    if by_known_eye(sample):
        return replace(EYE_FRAMES[camera["name"]], input_size=input_size)
    matrix = np.array(camera["matrix"]).reshape(3, 3)
    pose = np.array(camera["camera_from_board"]).reshape(4, 4)
    return grid_frame(matrix, pose, (sample["width"], sample["height"]), input_size)


def by_known_eye(sample: Mapping[str, Any]) -> bool:
    """Whether a stored sample was seen by one of NICO's eyes, whose frames are known."""
    camera = sample["camera"]
    eye = camera["kind"] == EYE and camera["name"] in EYE_FRAMES
    return bool(eye and sample["robot"] == "nico")


def labels_of(sample: Mapping[str, Any], frame: PictureFrame) -> Labels:
    """What is true of the part of a stored sample's picture that a frame shows.

    Args:
        sample: Its columns, as lists or arrays.
        frame: For pictures of any size; the sample's labels are brought to its size.
    """
    scale = np.array(frame.eye_size) / [sample["width"], sample["height"]]
    cells, visible = np.full(512, EMPTY), np.zeros(512, dtype=int)
    offsets = np.zeros((512, 3))
    places = np.asarray(sample["block_cells"], dtype=int)
    pixels = np.asarray(sample["block_pixels"], dtype=int)
    cells[places] = np.asarray(sample["block_classes"], dtype=int)
    offsets[places] = np.asarray(sample["block_offsets"], dtype=float).reshape(-1, 3)
    visible[places] = np.rint(pixels * scale.prod()).astype(int)
    boxes = np.asarray(sample["boxes"], dtype=float).reshape(-1, 4) * np.tile(scale, 2)
    owners = np.asarray(sample["box_blocks"], dtype=int)
    boxes = np.clip(frame.to_input(boxes), 0, np.tile(frame.input_size, 2))
    inside = (boxes[:, 2] - boxes[:, 0] > 1) & (boxes[:, 3] - boxes[:, 1] > 1)
    shown = inside & (visible[places[owners]] >= LEAST_PIXELS)
    resize = np.array([[scale[0], 0, scale[0] / 2 - 0.5], [0, scale[1], scale[1] / 2 - 0.5]])
    matrix = np.vstack([resize, [0, 0, 1]]) @ np.array(sample["camera"]["matrix"]).reshape(3, 3)
    return Labels(
        boxes=boxes[shown],
        classes=np.asarray(sample["classes"], dtype=int)[shown],
        hidden=np.asarray(sample["box_hidden"], dtype=bool)[shown],
        cells=cells,
        visible=visible,
        offsets=offsets,
        holding=bool(sample["holding"]),
        matrix=frame.matrix(matrix),
        camera_from_board=np.array(sample["camera"]["camera_from_board"]).reshape(4, 4),
        by_eye=by_known_eye(sample),
    )


def decode(
    jpeg: bytes | memoryview | np.ndarray, size: tuple[int, int], frame: PictureFrame
) -> UInt8[np.ndarray, "h w 3"]:
    """The network's input from a stored picture, decoded at a reduced scale where that will do.

    Args:
        jpeg: The stored picture.
        size: Its width and height, in pixels.
        frame: Which part of it is wanted, and at which size.

    Raises:
        DataError: If it is no JPEG of that size.
    """
    by = _reduction(size, frame)
    flags = _REDUCED[by] | cv2.IMREAD_IGNORE_ORIENTATION
    image = decoded(jpeg, flags)
    if image is None or image.shape[:2] != (size[1] // by, size[0] // by):
        found = "none" if image is None else f"{image.shape[1]} x {image.shape[0]}"
        raise DataError(f"The picture is damaged: {found} instead of {size[0]} x {size[1]} pixels.")
    if size == frame.eye_size:
        left, top, right, bottom = (edge // by for edge in frame.crop)
        part = image[top:bottom, left:right]
        shrinks = (right - left) > frame.input_size[0]
        how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        resized = cv2.resize(part, frame.input_size, interpolation=how)
    else:
        resized = frame.prepare(image)
    return cv2.cvtColor(resized, cv2.COLOR_BGR2RGB, dst=resized)


def _reduction(size: tuple[int, int], frame: PictureFrame) -> int:
    """By how much a picture may be reduced while it is decoded."""
    if size != frame.eye_size:
        return 1
    for by in (8, 4, 2):
        whole = not any(edge % by for edge in (*size, *frame.crop))
        if whole and by * frame.scale.max() <= SOFTEST:
            return by
    return 1
