"""A table, blocks and a robot that does what fourteen numbers tell it."""

from collections.abc import Sequence
from typing import Any, Literal, Protocol, SupportsInt, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from fusionnet import blocks, robots
from fusionnet.blocks.grid import Layout, Move
from fusionnet.errors import InputError
from fusionnet.randomness import generator
from fusionnet.robots import ArmKinematics, Robot
from fusionnet.simulation.appearance import Appearance
from fusionnet.simulation.episode import (
    Episode,
    Recording,
    judge,
    measured_layout,
    measured_shifts,
)
from fusionnet.simulation.execution import Execution
from fusionnet.simulation.hand import Hand
from fusionnet.simulation.motion import PathPlanner, even_motion
from fusionnet.simulation.physics import TIME_STEP, build_physics
from fusionnet.simulation.renderer import View, shared_renderer
from fusionnet.simulation.tabletop import BlockPoses
from fusionnet.simulation.viewer import LiveViewer


@runtime_checkable
class LookAgain(Protocol):
    """Looks at a world in the middle of an execution, and corrects the arm."""

    def __call__(
        self, phase: Literal["grasp", "place"], rise: float, world: "World"
    ) -> Float[np.ndarray, "3"]:
        """How far to move the pinch from the pose that was answered.

        Args:
            phase: Before the grasp, with the hand out of sight, or above the place.
            rise: How far the hand hangs above the place, in metres.
            world: To look at.

        Returns:
            A displacement in the robot frame, in metres; zero where nothing can be said.
        """
        ...


def joint_targets(robot: str | Robot, move: Move) -> Float[np.ndarray, " k"]:
    """What the arm must do for a move: grasp angles and gripper, place angles and gripper.

    The angles (radians) are those of the robot's joint table at the move's two cells. A
    gripper value is 1 where the hand is closed on a block: with the grasp pose if the move
    begins so (a drop), with the place pose if it ends so (a take).
    """
    robot = robots.load(robot) if isinstance(robot, str) else robot
    return np.concatenate(
        [
            robot.joint_angles(move.source),
            [float(move.begins_held)],
            robot.joint_angles(move.target),
            [float(move.ends_held)],
        ]
    )


def make_world(
    robot: str = "nico",
    seed: int = 0,
    layout: Layout | None = None,
    appearance: Appearance | None = None,
    shifts: Float[np.ndarray, "n 2"] | None = None,
) -> "World":
    """A world with a layout of blocks; a random one, which depends on the seed, if none is given.

    `shifts` displaces each block of the layout from its cell, along x and y of the board (metres).

    Raises:
        UnknownNameError: If there is no such robot.
        InputError: If the layout cannot stand: off the grid, overlapping, floating.
    """
    if layout is None:
        layout = blocks.random_layout(generator(seed, "world"))
    else:
        blocks.validate(layout)
    if shifts is not None and np.shape(shifts) != (len(layout.blocks), 2):
        raise InputError(
            f"Shifts of shape {np.shape(shifts)}; expected two numbers (metres) for each of the "
            f"{len(layout.blocks)} blocks."
        )
    return World(robots.load(robot), layout, appearance, shifts)


class World:
    """A robot at a table with blocks, in a MuJoCo simulation.

    Several commands can be executed one after the other; the world stays as they leave it.

    Args:
        robot: Who acts.
        layout: What stands on the board. If a block is held, the hand begins around it.
        appearance: Look of the pictures; nominal by default.
        shifts: Displacement of each block from its cell along x and y of the board, in metres.
    """

    def __init__(
        self,
        robot: Robot,
        layout: Layout,
        appearance: Appearance | None = None,
        shifts: Float[np.ndarray, "n 2"] | None = None,
    ) -> None:
        self.robot = robot
        self.appearance = appearance or Appearance()
        self.blocks = layout.blocks
        self._physics = build_physics(robot, layout, shifts)
        self._data = mujoco.MjData(self._physics.model)
        self._planner = PathPlanner(ArmKinematics(robot))
        self._hand = Hand(robot, self._physics, self._data)
        held = layout.held
        arm = robot.poses["prepare"] if held is None else robot.joint_angles(held.cell)
        self._hand.jump(arm, closed=layout.gripper.closed)
        self._hand.closed = layout.gripper.closed
        if held is not None:
            self._hand.hold(layout.blocks.index(held))

    @property
    def layout(self) -> Layout:
        """Blocks in the cells where they are now, and the hand."""
        return measured_layout(
            self.robot,
            self.blocks,
            self.block_poses,
            self._hand.held,
            self._hand.closed,
            self._hand.pinch,
        )

    @property
    def joint_angles(self) -> Float[np.ndarray, " n"]:
        """The arm's joints now, in radians."""
        return self._hand.posture

    @property
    def hand_closed(self) -> bool:
        """Whether the hand is closed now, around a block or empty."""
        return self._hand.closed

    @property
    def block_poses(self) -> BlockPoses:
        """Where each block is now, in the robot frame (with `joint_angles` the whole state)."""
        return self._physics.block_poses(self._data.qpos)

    def image(
        self, camera: str = "left_eye", size: Sequence[SupportsInt] = (960, 540)
    ) -> UInt8[np.ndarray, "h w 3"]:
        """What a camera sees now; the first picture's thread takes all of them.

        Raises:
            RenderingError: If there is no working OpenGL, or another thread took pictures.
            InputError: If no picture can have the size.
            UnknownNameError: If there is no such camera.
        """
        return self._view(camera, size).image

    def view(
        self,
        camera: str = "left_eye",
        size: Sequence[SupportsInt] = (960, 540),
        *,
        masks: bool = False,
        depth: bool = False,
    ) -> View:
        """What a camera sees now, with the exact boxes of what is visible.

        Args:
            camera: "left_eye", "right_eye" or "external".
            size: Width and height, in pixels.
            masks: Whether it is wanted which block is seen in each pixel.
            depth: Whether it is wanted how far what is seen in each pixel is.

        Raises:
            RenderingError: If there is no working OpenGL, or another thread took pictures.
            InputError: If no picture can have the size.
            UnknownNameError: If there is no such camera.
        """
        return self._view(camera, size, labels=True, masks=masks, depth=depth)

    def watch(self) -> LiveViewer:
        """A window in which this world is seen at the pace of a clock, until it is closed.

        Raises:
            RenderingError: If there is no display.
        """
        viewer = LiveViewer(self.robot, self._physics.model, self._data)
        self._hand.on_frame = viewer.show
        return viewer

    def execute(
        self,
        answer: Any,
        expected: Layout | None = None,
        record: bool = False,
        look_again: LookAgain | None = None,
    ) -> Episode:
        """Let the arm do it: go to the grasp pose, close, go to the place pose, open (or not).

        Args:
            answer: Anything with `grasp` and `place`, each with `joint_angles` (radians) and
                `gripper` (closed from 0.5); or the flat vector of `joint_targets`.
            expected: The layout that should come out, if known.
            record: Whether to keep states for a film.
            look_again: Closes the loop: asked before the way down to the grasp, and above the
                place with the block in the hand, how far to move the pinch from the pose that
                was answered.

        Raises:
            InputError: If the targets have the wrong length, are not finite, or are outside
                the joints' limits.
        """
        grasp, grasp_closed, place, place_closed = self._targets(answer)
        hand = self._hand
        hand.frames = [] if record else None
        hand.touched = set()
        before = self.block_poses
        start = hand.seconds
        run = Execution(self.robot, hand, self._planner)
        begins_held = hand.held
        touched = {begins_held}
        targets = np.r_[grasp, grasp_closed, place, place_closed]
        corrections: dict[str, Float[np.ndarray, "3"]] = {}

        if not grasp_closed and hand.closed:
            run.phase("open", hand.open)
        if hand.held is None and not hand.closed:
            if look_again is not None:
                corrections["grasp"] = look_again("grasp", 0.0, self)
                grasp = run.beside(grasp, corrections["grasp"])
            run.phase("ready", run.to_ready)
        run.phase("reach", lambda: run.descend(grasp))
        distance: float | None = None
        if not hand.closed:
            distance = run.phase("grasp", hand.close)
        grasped = hand.held
        touched.add(grasped)
        run.phase("lift", lambda: run.lift(place))
        run.phase("move", lambda: run.cross(place))
        if look_again is not None and hand.held is not None:
            rise = run.phase("look", lambda: run.hover(place))
            corrections["place"] = look_again("place", rise, self)
            place = run.beside(place, corrections["place"])
        run.phase("place", lambda: run.set_down(place))
        if not place_closed:
            run.phase("release", hand.open)
            run.phase("retreat", run.retreat)
        run.phase("rest", run.settle)

        after = self.block_poses
        moved = np.linalg.norm(after.positions - before.positions, axis=1)
        still = [float(moved[i]) for i in range(len(moved)) if i not in touched]
        if expected is None:
            success, errors = None, 1000.0 * moved
            wrong: list[str] = []
        else:
            wrong, errors = judge(self.robot, self.blocks, after, hand.held, expected)
            success = not wrong
        if success:
            worst = np.max(errors, initial=0.0)
            reason = f"Every block is where it should be, at most {worst:.1f} mm off."
        else:
            story = run.story(self.blocks, begins_held, grasped, distance, grasp_closed)
            reason = "; ".join([*wrong[:3], story])
            reason = reason[0].upper() + reason[1:] + "."
        episode = Episode(
            success=success,
            reason=reason,
            targets=targets,
            layout_after=self.layout,
            grasped=None if grasped is None else self.blocks[grasped],
            errors=errors,
            displacement=1000.0 * max(still, default=0.0),
            grasp_distance=None if distance is None else 1000.0 * distance,
            stopped=tuple(run.stopped),
            touched=tuple(sorted(hand.touched)),
            seconds=hand.seconds - start,
            phases=tuple(run.phases),
            corrections=corrections,
            shifts=measured_shifts(self.robot, before),
            recording=self._recording() if record else None,
        )
        hand.frames = None
        return episode

    def drive(
        self, joint_angles: Float[np.ndarray, " n"], closed: bool, seconds: float = 0.05
    ) -> None:
        """Move the arm's targets evenly to a posture, and then close or open the hand.

        For closed loops: the arm follows as fast as its servos can, and nothing is planned.

        Args:
            joint_angles: Where to, in radians.
            closed: Whether the hand is to be closed then. Closing takes hold of a block within
                the gate, as in `execute`.
            seconds: Time that this takes.

        Raises:
            InputError: If the angles have the wrong length, are not finite, or are outside the
                joints' limits.
        """
        goal = np.asarray(joint_angles, dtype=float)
        self.robot.check_joint_angles(goal)
        hand = self._hand
        hand.follow(even_motion(hand.target, goal, seconds, TIME_STEP))
        if closed and not hand.closed:
            hand.close(0.0)
        elif not closed and hand.closed:
            hand.open(0.0)

    @property
    def touched(self) -> tuple[str, ...]:
        """What the arm touched beside blocks, since the world began or an episode last did."""
        return tuple(sorted(self._hand.touched))

    def differences(self, expected: Layout) -> list[str]:
        """What is not as expected now, in clauses; empty when all is, and rests."""
        wrong, _ = judge(self.robot, self.blocks, self.block_poses, self._hand.held, expected)
        if not wrong and not self._hand.at_rest():
            wrong = ["a block still moves"]
        return wrong

    def _targets(
        self, answer: Any
    ) -> tuple[Float[np.ndarray, " n"], bool, Float[np.ndarray, " n"], bool]:
        count = len(self.robot.joint_names)
        if hasattr(answer, "grasp") and hasattr(answer, "place"):
            poses = [answer.grasp, answer.place]
            vectors = [np.asarray(p.joint_angles, dtype=float) for p in poses]
            grippers = np.array([p.gripper for p in poses], dtype=float)
        else:
            flat = _flat(answer, 2 * count + 2, self.robot)
            vectors = [flat[:count], flat[count + 1 : -1]]
            grippers = flat[[count, -1]]
        for vector in vectors:
            self.robot.check_joint_angles(vector)
        if not np.all(np.isfinite(grippers)):
            raise InputError(f"A gripper value is not finite: {grippers.tolist()}; give 0 to 1.")
        return vectors[0], bool(grippers[0] >= 0.5), vectors[1], bool(grippers[1] >= 0.5)

    def _view(
        self,
        camera: str,
        size: Sequence[SupportsInt],
        labels: bool = False,
        masks: bool = False,
        depth: bool = False,
    ) -> View:
        renderer = shared_renderer(self.robot, size)
        posture = self._data.qpos[: self._physics.robot_positions]
        poses, look = self.block_poses, self.appearance
        return renderer.draw(posture, self.blocks, poses, camera, look, labels, masks, depth)

    def _recording(self) -> Recording:
        frames = np.array(self._hand.frames)
        poses = [self._physics.block_poses(frame) for frame in frames]
        return Recording(
            robot=self.robot,
            blocks=self.blocks,
            postures=frames[:, : self._physics.robot_positions],
            positions=np.array([p.positions for p in poses], dtype=np.float32),
            rotations=np.array([p.rotations for p in poses], dtype=np.float32),
            appearance=self.appearance,
        )


def _flat(answer: Any, width: int, robot: Robot) -> Float[np.ndarray, " k"]:
    try:
        flat = np.asarray(answer, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{type(answer).__name__} is no answer: give an object with grasp and place, "
            f"or {width} numbers."
        ) from error
    if flat.shape != (width,):
        shape: Sequence[int] = flat.shape
        raise InputError(
            f"Targets of shape {tuple(shape)}; robot {robot.name!r} needs {width} numbers: "
            f"{len(robot.joint_names)} angles and a gripper value, for the grasp and the place."
        )
    return flat
