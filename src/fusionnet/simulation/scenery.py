"""What is in a picture beside the robot: lights, floor, table, board and blocks."""

from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import BLOCK_SIZE, GRID, Block, Shape
from fusionnet.geometry import PinholeCamera, apply, rotation_from_quaternion
from fusionnet.robots import Robot, compiled, load
from fusionnet.simulation.appearance import BLOCK_COLORS, Appearance
from fusionnet.simulation.tabletop import (
    BOARD_SIZE,
    BOARD_THICKNESS,
    DRAWN_HALF,
    PYRAMID,
    TABLE_THICKNESS,
    BlockPoses,
    add_pyramid_mesh,
)

SHADOW_PIXELS = 1024
"""Edge of the shadow map; MuJoCo's default of 4096 costs far more on a processor."""

SHADOW_RADIUS = 0.27
"""Half edge of the square around the board in which shadows are thrown, in metres."""

WIDE_SHADOW_RADIUS = 0.7
"""The same for the camera that films the whole robot."""

_BOX = mujoco.mjtGeom.mjGEOM_BOX
_MESH = mujoco.mjtGeom.mjGEOM_MESH
_MATRIX = np.eye(3).ravel()


@lru_cache(maxsize=4)
def picture_model(
    robot: str | Robot | None, size: tuple[int, int], shadow_pixels: int = SHADOW_PIXELS
) -> mujoco.MjModel:
    """The robot, the pyramid's mesh, and settings for software rendering.

    Two lights of ours take the place of the robot's own.

    Args:
        robot: Who, or the name in the robots' catalogue; None for nobody at all.
        size: Width and height of the largest picture, in pixels.
        shadow_pixels: Edge of the shadow map.
    """
    robot = load(robot) if isinstance(robot, str) else robot
    spec = mujoco.MjSpec() if robot is None else robot.spec()
    add_pyramid_mesh(spec, DRAWN_HALF)
    for light in spec.lights:
        spec.delete(light)
    for shadow in (True, False):
        light = spec.worldbody.add_light()
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        light.castshadow = shadow
    spec.stat.extent = 1.0
    visual = spec.visual
    visual.global_.offwidth, visual.global_.offheight = size
    visual.quality.offsamples = 0
    visual.quality.numslices, visual.quality.numstacks = 18, 10
    visual.quality.shadowsize = shadow_pixels
    visual.map.shadowclip = SHADOW_RADIUS
    visual.map.znear = 0.05
    visual.map.zfar = 12.0
    return spec.compile() if robot is None else compiled(spec, robot.name)


HIDDEN_GROUP = 5
"""Geom group of the robot's parts that are left out of a picture."""


def hide_unseen(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    groups: np.ndarray,
    camera: PinholeCamera,
    appearance: Appearance,
    robot_from_board: Float[np.ndarray, "4 4"],
    shadow_radius: float,
) -> None:
    """Leave out the robot's parts that are neither in the picture nor throw a shadow into it.

    A robot has over a hundred shapes, most of them behind its own eyes.

    Args:
        model: Its geom groups are set.
        data: Where the parts are.
        groups: The geoms' true groups.
        camera: Who looks.
        appearance: Says where the light comes from.
        robot_from_board: Where the board is.
        shadow_radius: How far from the board shadows are thrown, in metres.
    """
    radius = model.geom_rbound
    place = apply(camera.camera_from_robot, data.geom_xpos)
    slopes = 0.5 * np.array([camera.width, camera.height]) / np.diag(camera.matrix)[:2]
    # Distance to each side plane of the view; negative is outside.
    sides = (place[:, 2:] * slopes - np.abs(place[:, :2])) / np.sqrt(1.0 + slopes**2)
    seen = (sides.min(axis=1) > -radius) & (place[:, 2] > -radius)
    if appearance.shadows:
        towards = robot_from_board[:3, :3] @ appearance.light_direction
        towards = towards / np.linalg.norm(towards)
        offset = data.geom_xpos - board_center(robot_from_board)
        beside = offset - np.outer(offset @ towards, towards)
        seen |= np.linalg.norm(beside, axis=1) < shadow_radius * np.sqrt(2.0) + radius
    model.geom_group[:] = np.where(seen, groups, HIDDEN_GROUP)


def board_center(robot_from_board: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
    """What the lights point at, in the robot frame."""
    return apply(robot_from_board, np.array([BOARD_SIZE / 2, BOARD_SIZE / 2, BOARD_SIZE / 4]))


def set_lights(
    scene: mujoco.MjvScene, appearance: Appearance, robot_from_board: Float[np.ndarray, "4 4"]
) -> None:
    """Light the scene as the appearance says."""
    center = board_center(robot_from_board)
    rays = [
        (appearance.light_direction, appearance.light),
        (appearance.fill_direction, appearance.fill),
    ]
    directional = [light for light in scene.lights[: scene.nlight] if not light.headlight]
    for light in scene.lights[: scene.nlight]:
        if light.headlight:
            light.ambient[:] = appearance.ambient
            light.diffuse[:] = 0.0
            light.specular[:] = 0.0
    for light, (direction, strength) in zip(directional, rays, strict=True):
        towards = robot_from_board[:3, :3] @ (direction / np.linalg.norm(direction))
        light.dir[:] = towards
        light.pos[:] = center - towards
        light.ambient[:] = 0.0
        light.diffuse[:] = strength
        light.specular[:] = 0.25 * strength
    scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = appearance.shadows
    scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False


def add_furniture(scene: mujoco.MjvScene, robot: Robot, appearance: Appearance) -> None:
    """Floor, table and checkerboard."""
    top = robot.table_top
    middle = np.array([sum(top.x) / 2, sum(top.y) / 2])
    half = np.array([top.x[1] - top.x[0], top.y[1] - top.y[0]]) / 2
    shapes = [_add_box(scene, (*middle, -0.01), (10.0, 10.0, 0.01), appearance.floor)]
    plate = top.height - TABLE_THICKNESS
    shapes.append(
        _add_box(
            scene,
            (*middle, top.height - TABLE_THICKNESS / 2),
            (*half, TABLE_THICKNESS / 2),
            appearance.table,
        )
    )
    for corner in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        leg = middle + np.array(corner) * (half - 0.03)
        shapes.append(
            _add_box(scene, (*leg, plate / 2), (0.02, 0.02, plate / 2), 0.8 * appearance.table)
        )
    for x in range(GRID):
        for y in range(GRID):
            color = appearance.board_dark if (x + y) % 2 == 0 else appearance.board_light
            center = np.array([(x + 0.5) * BLOCK_SIZE, (y + 0.5) * BLOCK_SIZE, 0.0])
            shapes.append(
                _add_box(
                    scene,
                    apply(robot.robot_from_board, center),
                    (BLOCK_SIZE / 2, BLOCK_SIZE / 2, BOARD_THICKNESS),
                    color * appearance.square_tints[x * GRID + y],
                )
            )
    for shape in shapes:  # wide surfaces shadow themselves in stripes, and cost most to draw
        shape.castshadow = False


def add_blocks(
    scene: mujoco.MjvScene,
    model: mujoco.MjModel,
    blocks: tuple[Block, ...],
    poses: BlockPoses,
    tints: Float[np.ndarray, "m 3"],
) -> int:
    """Add the blocks; the segmentation label of block i is the returned number plus i plus 1.

    Args:
        scene: To which they are added.
        model: Has the pyramid's mesh.
        blocks: What to add.
        poses: Where.
        tints: Factors on red, green and blue of each block.
    """
    pyramid = model.mesh(PYRAMID).id
    # The compiler moves a mesh to its centre of mass and principal axes; move it back.
    offset = model.mesh_pos[pyramid]
    turn = rotation_from_quaternion(model.mesh_quat[pyramid])
    first = scene.ngeom
    for index, block in enumerate(blocks):
        position, rotation = poses.positions[index], poses.rotations[index]
        color = np.clip(np.array(BLOCK_COLORS[block.color]) * tints[index], 0.0, 1.0)
        scale = np.ones(3) if poses.scales is None else poses.scales[index]
        if block.shape is Shape.CUBE:
            _add_box(scene, position, DRAWN_HALF * scale, color, rotation.ravel())
        else:  # a mesh has its size in its corners, so the matrix stretches it
            stretched = rotation * scale
            center, matrix = position + stretched @ offset, (stretched @ turn).ravel()
            geom = _add_box(scene, center, DRAWN_HALF, color, matrix, _MESH)
            geom.dataid = 2 * pyramid
    return first


def _add_box(
    scene: mujoco.MjvScene,
    position: object,
    half_size: object,
    color: np.ndarray,
    matrix: np.ndarray = _MATRIX,
    shape: mujoco.mjtGeom = _BOX,
) -> mujoco.MjvGeom:
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        shape,
        np.asarray(half_size, dtype=float),
        np.asarray(position, dtype=float),
        np.asarray(matrix, dtype=float),
        np.append(color, 1.0).astype(np.float32),
    )
    geom.category = mujoco.mjtCatBit.mjCAT_DYNAMIC
    geom.segid = scene.ngeom
    geom.specular = 0.2
    geom.shininess = 0.3
    scene.ngeom += 1
    return geom
