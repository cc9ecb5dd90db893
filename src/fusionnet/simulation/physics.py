"""The world as MuJoCo sees it, and the declared model of grasping.

What is physics: the arm (masses, position servos with limited torque), which collides with
the table, the floor, the robot's trunk, head, legs and other arm; the table; and the
blocks, which rest, fall, collide, are pushed and pile up. Blocks that nobody touches are
put to sleep by MuJoCo and woken by the first touch, so a hundred of them cost no time.

What is a model: a grasp is not made by friction. Blocks stand 1 mm apart and fingers are
14 mm thick, so real contacts would sweep the neighbours away. Instead, when the hand
closes with its pinch point within `GATE` of the grasp point of a block (just above its
top), a point of the block is tied to the pinch and a small torque keeps the block's
orientation; opening the hand unties it. Fingers pass through blocks; a small ball at
the pinch does not, so a hand that comes down on a block pushes it.
"""

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import Block, Layout, Shape
from fusionnet.robots import ArmKinematics, CollisionBit, Robot, model_errors
from fusionnet.simulation.appearance import BLOCK_COLORS
from fusionnet.simulation.tabletop import (
    BLOCK_HALF,
    PYRAMID,
    TABLE_THICKNESS,
    BlockPoses,
    add_pyramid_mesh,
    ideal_poses,
)

GATE = 0.013
"""How far the pinch may be from a block's grasp point for the hand to hold the block, in metres."""

TIME_STEP = 0.002
"""In seconds."""

BLOCK_MASS = 0.012
"""In kilograms: beech wood of this size."""

PROBE_RADIUS = 0.008
"""Of the ball at the pinch that touches blocks: 4 mm above the block in a perfect grasp."""

TORQUE_LIMIT = 6.0
"""Of each arm joint, in newton metres: about what servos of this size can do."""

UPRIGHT_STIFFNESS = 5e-2
UPRIGHT_DAMPING = 3.5e-4
"""Of the torque that keeps a held block's orientation, in N m / rad and N m s / rad."""

HIDDEN_GROUP = 4
"""Of what is there for contacts only; viewers draw what is to be looked at (`scenery`)."""

HOLD, TOUCH = "hold", "touch"
"""Names of the tie between hand and block, and of the sensor at the pinch."""

_WORLD = int(CollisionBit.WORLD)
_BLOCK = int(CollisionBit.BLOCK)
_PROBE = int(CollisionBit.PROBE)

OBSTACLES = ("", "its own body", "the table", "the floor")
"""What the arm and the hand must not touch, by number; 0 is everything else."""


def describe_grasp_model() -> str:
    """One sentence for results: how this simulation grasps."""
    return (
        f"a closing hand within {GATE * 1000:.0f} mm of a block's grasp point holds it by a point "
        "constraint and a small upright torque; fingers pass through blocks"
    )


@dataclass(frozen=True, eq=False)
class Physics:
    """A compiled world and where its parts are.

    Attributes:
        model: Robot, table and blocks. The robot's joint positions come first in `qpos`.
        arm: Addresses of the arm's joints in `qpos`.
        arm_actuators: Their position servos.
        finger_actuators: The fingers' servos.
        finger_range: Their open and closed values.
        robot_positions: How many of `qpos` are the robot's.
        lead: Seconds by which a servo lags behind a moving target; commands lead by as much.
        pinch: Site of the pinch.
        hold: The equality that ties a block to the pinch; -1 where there are no blocks.
        touch: Address in `sensordata` of the force on the ball at the pinch.
        blocks: Body of each block of the layout.
        block_positions: Address in `qpos` of each block's position and quaternion.
        block_velocities: Address in `qvel` of each block's six velocities.
        obstacles: For each geom its number in `OBSTACLES`.
    """

    model: mujoco.MjModel
    arm: np.ndarray
    arm_actuators: np.ndarray
    finger_actuators: np.ndarray
    finger_range: Float[np.ndarray, "f 2"]
    robot_positions: int
    lead: Float[np.ndarray, " n"]
    pinch: int
    hold: int
    touch: int
    blocks: np.ndarray
    block_positions: np.ndarray
    block_velocities: np.ndarray
    obstacles: np.ndarray

    def let_touch_hand(self, block: int, touching: bool) -> None:
        """Whether a block and the ball at the pinch collide; not while it is held."""
        geom = self.model.body_geomadr[self.blocks[block]]
        self.model.geom_contype[geom] = _BLOCK if touching else 0
        self.model.geom_conaffinity[geom] = _BLOCK | _WORLD | (_PROBE if touching else 0)

    def touched(self, data: mujoco.MjData) -> set[str]:
        """Which of the `OBSTACLES` the arm or the hand touches now."""
        touching = data.contact.dist < 0.0
        pairs = self.obstacles[data.contact.geom[touching]]
        return {OBSTACLES[n] for n in pairs.max(axis=1)[pairs.min(axis=1) > 0]}

    def block_poses(self, qpos: Float[np.ndarray, " q"]) -> BlockPoses:
        """Where the blocks are in a state of the model."""
        index = self.block_positions[:, None] + np.arange(7)
        poses = qpos[index]
        return BlockPoses(poses[:, :3], _rotations(poses[:, 3:]))


def build_physics(
    robot: Robot, layout: Layout, shifts: Float[np.ndarray, "n 2"] | None = None
) -> Physics:
    """Compile a world with a robot, its table and the blocks of a layout.

    Args:
        robot: Who acts.
        layout: Blocks in their cells.
        shifts: Displacement of each block from its cell along x and y of the board, in metres.

    Raises:
        DataError: If the robot's model cannot be compiled with what the world adds to it.
    """
    spec = robot.spec()
    with model_errors(robot.name):
        _furnish(spec, robot, layout, shifts)
        model = spec.compile()
    return _located(robot, model, len(layout.blocks))


def _furnish(
    spec: mujoco.MjSpec,
    robot: Robot,
    layout: Layout,
    shifts: Float[np.ndarray, "n 2"] | None,
) -> None:
    """Add the table, the blocks and the grasp model to a robot."""
    _set_options(spec)
    probe = spec.site("pinch").parent.add_geom(
        name="probe", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[PROBE_RADIUS, 0, 0]
    )
    probe.pos, probe.mass, probe.group = spec.site("pinch").pos, 0.0, HIDDEN_GROUP
    probe.contype, probe.conaffinity = _PROBE, _BLOCK | _WORLD
    probe.friction, probe.priority = [0.05, 0.005, 0.0001], 1  # smooth: it slides off edges
    _add_table(spec, robot)
    add_pyramid_mesh(spec, BLOCK_HALF)
    poses = ideal_poses(layout.blocks, robot.robot_from_board, shifts)
    held = layout.held
    # A model begins in its zero posture; blocks cannot sleep where the hand is then.
    aside = poses.positions[:, :2] - _zero_pinch(robot)[:2]
    apart = np.linalg.norm(aside, axis=1) > 2 * PROBE_RADIUS + 2 * BLOCK_HALF[0]
    for index, block in enumerate(layout.blocks):
        asleep = block is not held and bool(apart[index])
        _add_block(spec, f"block {index}", block, poses.positions[index], asleep=asleep)
    _add_hold(spec, len(layout.blocks))
    _add_touch(spec)
    for name in robot.joint_names:
        spec.actuator(name).forcerange = [-TORQUE_LIMIT, TORQUE_LIMIT]
        spec.actuator(name).forcelimited = True


@lru_cache(maxsize=16)
def _zero_pinch(robot: Robot) -> Float[np.ndarray, "3"]:
    """Where the pinch is when all joints are at 0."""
    kinematics = ArmKinematics(robot)
    return kinematics.robot_from_pinch(np.zeros(len(robot.joint_names)))[:3, 3]


def _set_options(spec: mujoco.MjSpec) -> None:
    option = spec.option
    option.timestep = TIME_STEP
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 5.0
    option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    option.sleep_tolerance = 2e-3


def _add_table(spec: mujoco.MjSpec, robot: Robot) -> None:
    top = robot.table_top
    (x0, x1), (y0, y1) = top.x, top.y
    table = spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[(x1 - x0) / 2, (y1 - y0) / 2, TABLE_THICKNESS / 2],
        pos=[(x0 + x1) / 2, (y0 + y1) / 2, top.height - TABLE_THICKNESS / 2],
    )
    table.contype, table.conaffinity = _WORLD, _BLOCK | _PROBE
    table.group = HIDDEN_GROUP
    floor = spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], pos=[0, 0, 0]
    )
    floor.contype, floor.conaffinity = _WORLD, _BLOCK
    floor.group = HIDDEN_GROUP


def _add_block(
    spec: mujoco.MjSpec, name: str, block: Block, position: np.ndarray, *, asleep: bool
) -> None:
    body = spec.worldbody.add_body(name=name, pos=position)
    body.sleep = (
        mujoco.mjtSleepPolicy.mjSLEEP_INIT if asleep else mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
    )
    body.add_freejoint()
    geom = body.add_geom(name=name, mass=BLOCK_MASS, friction=[0.6, 0.005, 0.0001])
    geom.solref, geom.solimp = [0.004, 1.0], [0.97, 0.995, 0.0005, 0.5, 2.0]
    geom.condim = 4
    geom.rgba = [*BLOCK_COLORS[block.color], 1.0]  # for live viewers; pictures are drawn apart
    geom.contype, geom.conaffinity = _BLOCK, _BLOCK | _WORLD | _PROBE
    if block.shape is Shape.CUBE:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, BLOCK_HALF
    else:
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, PYRAMID


def _add_hold(spec: mujoco.MjSpec, blocks: int) -> None:
    """The tie between hand and block; which block it ties is set when the hand closes."""
    if blocks == 0:
        return
    hold = spec.add_equality(name=HOLD, type=mujoco.mjtEq.mjEQ_CONNECT, active=False)
    hold.objtype = mujoco.mjtObj.mjOBJ_BODY
    hold.name1, hold.name2 = spec.site("pinch").parent.name, "block 0"
    hold.solref = [0.006, 1.0]


def _add_touch(spec: mujoco.MjSpec) -> None:
    """A sensor of how hard the hand pushes on something."""
    pinch = spec.site("pinch")
    skin = pinch.parent.add_site(name="skin", pos=pinch.pos, size=[PROBE_RADIUS * 1.5, 0, 0])
    skin.group = HIDDEN_GROUP
    sensor = spec.add_sensor(name=TOUCH, type=mujoco.mjtSensor.mjSENS_TOUCH)
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_SITE, "skin"


def _located(robot: Robot, model: mujoco.MjModel, count: int) -> Physics:
    bodies = np.array([model.body(f"block {i}").id for i in range(count)], dtype=int)
    joints = model.body_jntadr[bodies]
    actuators = np.array([model.actuator(name).id for name in robot.joint_names])
    stiffness = model.actuator_gainprm[actuators, 0]
    joint_damping = np.array([model.joint(name).damping[0] for name in robot.joint_names])
    fingers = list(robot.finger_positions)
    return Physics(
        model=model,
        arm=np.array([model.joint(name).qposadr[0] for name in robot.joint_names]),
        arm_actuators=actuators,
        finger_actuators=np.array([model.actuator(name).id for name in fingers], dtype=int),
        finger_range=np.array([robot.finger_positions[f] for f in fingers]).reshape(-1, 2),
        robot_positions=model.nq - 7 * count,
        lead=(joint_damping - model.actuator_biasprm[actuators, 2]) / stiffness,
        pinch=model.site("pinch").id,
        hold=model.equality(HOLD).id if count else -1,
        touch=int(model.sensor(TOUCH).adr[0]),
        blocks=bodies,
        block_positions=model.jnt_qposadr[joints].astype(int),
        block_velocities=model.jnt_dofadr[joints].astype(int),
        obstacles=_obstacles(model),
    )


def _obstacles(model: mujoco.MjModel) -> np.ndarray:
    """Blocks and the probe may be touched; what else collides is body, table or floor."""
    free = (model.geom_contype & (_BLOCK | _PROBE)) > 0
    numbers = np.where(free, 0, OBSTACLES.index("its own body"))
    numbers[model.geom("table").id] = OBSTACLES.index("the table")
    numbers[model.geom("floor").id] = OBSTACLES.index("the floor")
    return numbers


def _rotations(quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 3"]:
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
