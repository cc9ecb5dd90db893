"""The estimated camera, put right by the corners of the board that can be seen.

The pose head looks at features four pixels apart. Where four squares of the board meet, the
picture itself says to a tenth of a pixel where they do; blocks hide some of these corners, and
what looks like one may be none, so the camera is fitted robustly and not far from the estimate.

References:
    Foerstner and Guelch (1987), A fast operator for detection and precise location of distinct
    points (the search for saddle points, by OpenCV); Geman and McClure (1987), Statistical methods
    for tomographic image reconstruction (the weights).
"""

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from fusionnet.models.heads.camera_pose import PARAMETERS, CameraPose
from fusionnet.simulation.tabletop import BOARD_THICKNESS

WINDOW = 4
"""Pixels around a corner, to each side, in which it is looked for."""

FARTHEST = 2.0
"""Pixels from where it is expected at which a corner is at most found."""

CLEAR = 0.25
"""Least strength of a corner, as a share of that which a tenth of them surpass."""

FEWEST = 4
"""Corners below which the estimate stands."""

CORNER_ERROR = 0.4
"""Pixels by which a corner that was found is off, as a rule."""

POSE_ERROR = 1.5
"""Pixels by which the estimated camera may show the corners of the grid elsewhere."""

_ROUNDS = 5
_STEP = 0.02
_SEARCH = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)


@torch.no_grad()
def refined_pose(
    head: CameraPose, pose: Float[Tensor, "1 7"], picture: UInt8[np.ndarray, "h w 3"]
) -> Float[Tensor, "1 7"]:
    """The pose after which the corners of the board appear where the picture has them.

    Args:
        head: Whose pose it is.
        pose: As estimated.
        picture: The network's input.
    """
    corners = head.landmarks + torch.tensor([0.0, 0.0, BOARD_THICKNESS])
    which, seen = board_corners(picture, head.project(pose, corners)[0].double().numpy())
    if len(which) < FEWEST:
        return pose
    count = len(which)
    points = torch.cat([corners[which], head.corners])
    goal = torch.cat([torch.from_numpy(seen), head.project(pose, head.corners)[0].double()])
    steps = torch.cat([torch.zeros(1, PARAMETERS), _STEP * torch.eye(PARAMETERS)])
    fitted = pose
    for _ in range(_ROUNDS):
        pixels = head.project(fitted + steps, points).double()
        rest, slopes = goal - pixels[0], (pixels[1:] - pixels[0]) / _STEP
        errors = rest[:count].norm(dim=1) / (1.5 * CORNER_ERROR)
        weights = torch.full((len(points),), POSE_ERROR**-2, dtype=torch.float64)
        weights[:count] = (1 + errors**2) ** -2 * CORNER_ERROR**-2
        normal = torch.einsum("inc,n,jnc->ij", slopes, weights, slopes)
        normal += 1e-6 * torch.eye(PARAMETERS)
        change = torch.linalg.solve(normal, torch.einsum("inc,n,nc->i", slopes, weights, rest))
        fitted = fitted + change.float()
    return fitted


def board_corners(
    picture: UInt8[np.ndarray, "h w 3"], expected: Float[np.ndarray, "n 2"]
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, "m 2"]]:
    """Which corners of squares are seen, and where, in pixels (whole numbers at their edges).

    Args:
        picture: Of a board.
        expected: Where its corners should appear.
    """
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    size = np.array(grey.shape[::-1])
    starts = (expected - 0.5).astype(np.float32)
    margin = WINDOW + 1
    which = np.flatnonzero(((starts >= margin) & (starts < size - margin - 1)).all(axis=1))
    if not len(which):
        return which, np.zeros((0, 2))
    search = (WINDOW, WINDOW)
    found = cv2.cornerSubPix(grey, starts[which, None].copy(), search, (-1, -1), _SEARCH)[:, 0]
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.2)
    across, down, both = (cv2.Sobel(smooth, -1, *order) for order in ((2, 0), (0, 2), (1, 1)))
    columns, rows = np.clip(np.rint(found), 0, size - 1).astype(int).T
    saddle = (both**2 - across * down)[rows, columns]
    clear = (saddle > 0) & (saddle >= CLEAR * np.quantile(saddle, 0.9))
    clear &= np.linalg.norm(found - starts[which], axis=1) < FARTHEST
    return which[clear], found[clear].astype(float) + 0.5
