"""Sizes, shapes and places of board and blocks, in the board frame (metres).

The board frame stands on the table top at the outer corner of cell (0, 0), with its
axes along x, y and z of the grid; each robot says where that is.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import BLOCK_SIZE, GRID, Block, Cell, Shape
from fusionnet.geometry import apply

BOARD_SIZE = GRID * BLOCK_SIZE
"""Edge of the checkerboard."""

BOARD_THICKNESS = 0.0003
"""How far the face of the checkerboard is above the table, and its board frame."""

TABLE_THICKNESS = 0.025
"""Of the table's top plate, whose place each robot states."""

BLOCK_HALF = np.array([0.01265, 0.01265, 0.01315])
"""Half sizes of a block: 1 mm of air between neighbours, none between the levels of a stack."""

DRAWN_HALF = BLOCK_HALF - np.array([0.0, 0.0, 0.0004])
"""Half sizes as drawn: the seam stands for bevelled edges, and lets the eye count a tower."""

EXTERNAL_POSITION = np.array([0.843, -0.315, 0.655])
EXTERNAL_TARGET = np.array([0.023, 0.115, 0.155])
EXTERNAL_VIEW = np.deg2rad(37.0)
"""The camera that films the robot: position, target, and vertical field of view."""

PYRAMID = "pyramid"
"""Name of the mesh that draws a prism (the thesis draws pyramids, 3.2.4)."""


def pyramid_faces(
    half: Float[np.ndarray, "3"],
) -> tuple[Float[np.ndarray, "18 3"], Float[np.ndarray, "18 3"]]:
    """Corners of a pyramid's six triangles, centred on its box, and the normal at each corner."""
    x, y, z = half
    base = np.array([[-x, -y, -z], [x, -y, -z], [x, y, -z], [-x, y, -z]])
    top = np.array([0.0, 0.0, z])
    triangles = [(base[i], base[(i + 1) % 4], top) for i in range(4)]
    triangles += [(base[0], base[2], base[1]), (base[0], base[3], base[2])]
    corners = np.array(triangles).reshape(-1, 3)
    edges = np.diff(corners.reshape(-1, 3, 3), axis=1)
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return corners, np.repeat(normals, 3, axis=0)


def add_pyramid_mesh(spec: mujoco.MjSpec, half: Float[np.ndarray, "3"]) -> None:
    """Give a model the mesh of a pyramid of these half sizes, with flat faces."""
    corners, normals = pyramid_faces(half)
    mesh = spec.add_mesh(name=PYRAMID)
    mesh.uservert = corners.ravel()
    mesh.usernormal = normals.ravel()
    mesh.userface = np.arange(18)
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX


def cell_center(cell: Cell) -> Float[np.ndarray, "3"]:
    """Where the centre of a block in `cell` is, in the board frame."""
    return (np.array(cell) + 0.5) * BLOCK_SIZE


def cell_at(point: Float[np.ndarray, "3"]) -> Cell:
    """The cell that holds a point of the board frame; may be off the grid."""
    x, y, z = np.floor(np.asarray(point) / BLOCK_SIZE).astype(int)
    return Cell(int(x), int(y), int(z))


@dataclass(frozen=True, eq=False)
class BlockPoses:
    """Where each block of a layout is.

    Attributes:
        positions: Centres, in the robot frame, in metres.
        rotations: Rotation matrices `robot_from_block`.
        scales: Factors on each block's size along its own axes; none if left out.
    """

    positions: Float[np.ndarray, "n 3"]
    rotations: Float[np.ndarray, "n 3 3"]
    scales: Float[np.ndarray, "n 3"] | None = None


def ideal_poses(
    blocks: tuple[Block, ...],
    robot_from_board: Float[np.ndarray, "4 4"],
    shifts: Float[np.ndarray, "m 2"] | None = None,
    turns: Float[np.ndarray, " m"] | None = None,
) -> BlockPoses:
    """Every block in the middle of its cell, displaced by `shifts` (m) and `turns` (rad)."""
    count = len(blocks)
    centers = (np.array([b.cell for b in blocks], dtype=float).reshape(-1, 3) + 0.5) * BLOCK_SIZE
    if shifts is not None:
        centers[:, :2] += shifts[:count]
    board_from_block = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
    if turns is not None:
        board_from_block[:, 0, 0] = board_from_block[:, 1, 1] = np.cos(turns[:count])
        board_from_block[:, 1, 0] = np.sin(turns[:count])
        board_from_block[:, 0, 1] = -board_from_block[:, 1, 0]
    return BlockPoses(apply(robot_from_board, centers), robot_from_board[:3, :3] @ board_from_block)


_CUBE = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
_PYRAMID = _CUBE * np.repeat([[1.0, 1.0, 1.0], [0.0, 0.0, 1.0]], 4, axis=0)


def drawn_corners(blocks: tuple[Block, ...], poses: BlockPoses) -> Float[np.ndarray, "n 8 3"]:
    """The corners of every block as drawn, in the frame of `poses` (metres).

    The first four are the foot's; a pyramid's last four are all its tip.
    """
    unit = np.array([_CUBE if b.shape is Shape.CUBE else _PYRAMID for b in blocks])
    corners = unit.reshape(-1, 8, 3) * DRAWN_HALF
    if poses.scales is not None:
        corners *= poses.scales[:, None]
    turned: np.ndarray = corners @ poses.rotations.transpose(0, 2, 1) + poses.positions[:, None]
    return turned
