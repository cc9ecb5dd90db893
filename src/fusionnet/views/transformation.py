"""Level-two noise and crops: pictures moved as a whole, with everything that is known of them.

Every change here is an affine map of the picture, and a camera followed by an affine map
is again a pinhole camera (rolled about its axis, with skewed pixels): the labels of boxes,
masks and pose all stay exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float
from scipy.linalg import rq

from fusionnet.errors import InputError
from fusionnet.geometry import PinholeCamera, transform
from fusionnet.simulation import View
from fusionnet.simulation.renderer import visible_boxes

CROP_FACTORS = (0.12, 0.25, 0.5, 0.75, 0.9, 1.0)
"""Sizes of crops as shares of the picture (thesis 6.1)."""

Affine = Float[np.ndarray, "3 3"]


@dataclass(frozen=True, kw_only=True)
class LevelTwo:
    """Ranges of the random map of a finished picture about its middle.

    Attributes:
        rotation: Largest rotation, in degrees.
        translation: Largest shift, as a share of the width and of the height.
        shear: Largest shear along each axis, in degrees.
        scale: Range of factors on the picture's size.

    References:
        Thesis 3.2.5, level 2.
    """

    rotation: float = 10.0
    translation: float = 0.10
    shear: float = 10.0
    scale: tuple[float, float] = (0.8, 1.2)

    def __post_init__(self) -> None:
        if not 0.0 <= self.shear < 45.0:
            raise InputError(f"A shear is 0 to below 45 degrees, not {self.shear}.")
        if not 0.0 < self.scale[0] <= self.scale[1]:
            raise InputError(f"The range of scale must rise from above 0, not {self.scale}.")

    def sample(self, rng: np.random.Generator, size: tuple[int, int]) -> Affine:
        """One map `new_from_old` between pixels of pictures of this width and height."""
        angle = np.deg2rad(rng.uniform(-self.rotation, self.rotation))
        across, down = np.tan(np.deg2rad(rng.uniform(-self.shear, self.shear, 2)))
        scale = rng.uniform(*self.scale)
        shift = rng.uniform(-self.translation, self.translation, 2) * size
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = scale * np.array([[cosine, -sine], [sine, cosine]])
        sheared = (
            turned @ np.array([[1.0, across], [0.0, 1.0]]) @ np.array([[1.0, 0.0], [down, 1.0]])
        )
        middle = 0.5 * (np.array(size) - 1.0)
        new_from_old = np.eye(3)
        new_from_old[:2, :2] = sheared
        new_from_old[:2, 2] = middle + shift - sheared @ middle
        return new_from_old


def transformed(view: View, new_from_old: Affine, size: tuple[int, int] | None = None) -> View:
    """The view after an affine map of its picture.

    Boxes are exact, those of the masks, if the view has masks; otherwise each is the box around its
    mapped corners, which is larger. What the map moves out of the picture is lost; what comes
    in repeats the picture's edge. A block's share counts what is cut off as hidden.

    Args:
        view: What is to be mapped.
        new_from_old: Map of pixels (whole numbers at their centres); its last row is (0, 0, 1).
        size: Width and height of the new picture; the old one's by default.
    """
    width, height = size or (view.image.shape[1], view.image.shape[0])
    rows = new_from_old[:2]
    image = cv2.warpAffine(view.image, rows, (width, height), borderMode=cv2.BORDER_REPLICATE)
    camera = _mapped_camera(view.camera, new_from_old, (width, height))
    enlargement = abs(np.linalg.det(new_from_old[:2, :2]))
    block_at = depth = None
    if view.block_at is not None:
        block_at = cv2.warpAffine(
            view.block_at, rows, (width, height), flags=cv2.INTER_NEAREST, borderValue=-1
        )
        visible, all_boxes = visible_boxes(block_at.astype(np.int32) + 1, len(view.visible))
        seen = np.flatnonzero(visible)
        boxes = all_boxes[seen]
    else:
        mapped, inside = _mapped_boxes(view.boxes, new_from_old, (width, height))
        seen, boxes = view.indices[inside > 0.0], mapped[inside > 0.0]
        visible = np.zeros_like(view.visible)
        kept = inside[inside > 0.0] * view.visible[seen] * enlargement
        visible[seen] = np.maximum(np.rint(kept), 1)
    if view.depth is not None:
        depth = cv2.warpAffine(
            view.depth,
            rows,
            (width, height),
            flags=cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_REPLICATE,
        )
    remaining = np.clip(visible / np.maximum(view.visible * enlargement, 1.0), 0.0, 1.0)
    classes = np.zeros(len(view.visible), dtype=view.classes.dtype)
    classes[view.indices] = view.classes
    return View(
        image, camera, boxes, classes[seen], seen, visible, view.shares * remaining, block_at, depth
    )


def crop_around(
    boxes: Float[np.ndarray, "n 4"],
    size: tuple[int, int],
    factors: Sequence[float] = CROP_FACTORS,
) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the smallest crop that holds all boxes.

    The crop has the picture's aspect and is centred on the boxes, or as nearly as the picture
    allows. Without boxes, and where they fit into no smaller one, it is the whole picture.

    Args:
        boxes: Of all blocks (left, top, right, bottom), in pixels.
        size: Width and height of the picture, in pixels.
        factors: Sizes to try, as shares of the picture, smallest first.

    References:
        Thesis 6.1.
    """
    width, height = size
    if len(boxes):
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        for factor in factors:
            extent = np.rint(np.array(size) * factor).astype(int)
            corner = np.rint(0.5 * (low + high - extent))
            left, top = np.clip(corner, 0, np.array(size) - extent).astype(int).tolist()
            right, bottom = left + int(extent[0]), top + int(extent[1])
            if np.all(low >= [left, top]) and np.all(high <= [right, bottom]):
                return left, top, right, bottom
    return 0, 0, width, height


def cropped(
    view: View, crop: tuple[int, int, int, int], size: tuple[int, int] | None = None
) -> View:
    """The part of a view within a crop, resized if asked; camera and labels follow.

    Args:
        view: The whole view.
        crop: Left, top, right, bottom edge, in pixels.
        size: Width and height of the result; the crop's own by default.

    Raises:
        InputError: If the crop is empty or leaves the picture.
    """
    left, top, right, bottom = crop
    height, width = view.image.shape[:2]
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise InputError(
            f"The crop {crop} does not lie within a picture of {width}x{height} pixels."
        )
    shift = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]])
    own = (right - left, bottom - top)
    part = transformed(view, shift, own)
    if size is None or tuple(size) == own:
        return part
    factors = np.array(size) / own
    edges = np.diag([*factors, 1.0])
    edges[:2, 2] = 0.5 * factors - 0.5
    resized = transformed(part, edges, size)
    shrinks = factors.min() < 1.0
    image = cv2.resize(
        part.image, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    return replace(resized, image=image)


def _mapped_camera(
    camera: PinholeCamera, new_from_old: Affine, size: tuple[int, int]
) -> PinholeCamera:
    """The camera that takes the mapped picture: intrinsics with skew, and a roll."""
    matrix, roll = rq(new_from_old @ camera.matrix)
    signs = np.diag(np.sign(np.diag(matrix)))
    matrix, roll = matrix @ signs, signs @ roll
    if np.linalg.det(roll) < 0.0:
        raise InputError("A picture can be turned, sheared and scaled, but not mirrored.")
    return PinholeCamera(*size, matrix / matrix[2, 2], transform(roll) @ camera.camera_from_robot)


def _mapped_boxes(
    boxes: Float[np.ndarray, "n 4"], new_from_old: Affine, size: tuple[int, int]
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, " n"]]:
    """Boxes around the mapped corners, clipped to the picture, and the share of each inside it."""
    corners = boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]] - 0.5
    mapped = corners @ new_from_old[:2, :2].T + new_from_old[:2, 2] + 0.5
    whole = np.concatenate([mapped.min(axis=1), mapped.max(axis=1)], axis=1)
    clipped = np.clip(whole, 0.0, np.tile(size, 2))
    before = np.prod(whole[:, 2:] - whole[:, :2], axis=1)
    after = np.prod(clipped[:, 2:] - clipped[:, :2], axis=1)
    return clipped, after / np.maximum(before, 1e-9)
