"""The course of a pick and place: prepare, ready, reach, grasp, lift, move, place, retreat."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import BLOCK_SIZE, Block
from fusionnet.robots import Robot
from fusionnet.simulation.episode import Phase, kind_of
from fusionnet.simulation.hand import Hand
from fusionnet.simulation.motion import PathPlanner
from fusionnet.simulation.physics import GATE, TIME_STEP
from fusionnet.simulation.tabletop import BLOCK_HALF

Result = TypeVar("Result")

APPROACH = 0.035
"""Last part of a way down that is driven slowly, in metres: more than the height of a block, so
that a block that misses its gap comes down on its neighbour slowly."""

AIR = 0.012
"""Between what the hand carries and the highest block on its way, in metres."""

HOVER = 0.03
"""A block is looked at from this far above its place, in metres."""

FEELS = 8
"""So often a block that came down on an edge is lifted and set down a little beside it."""

FEEL_STEP = 0.0015
"""So far each time, in metres; blocks stand 1 mm apart."""

FEEL_LIFT = 0.004
"""So high it is lifted for that, in metres."""

LEAST_LIFT = 0.02
"""Even with nothing in the way the hand comes to a pose from this far above, in metres."""

CORRIDOR = 0.045
"""Blocks nearer than this to the hand's way across count as being on it, in metres."""

HIGHEST = 0.08
"""Above the grasp height of level 7: the hand goes no higher, in metres."""


class Execution:
    """The parts of one execution, and what happened in them.

    Attributes:
        phases: What was done, and when.
        stopped: Phases that were cut short because the hand pushed on something.
    """

    def __init__(self, robot: Robot, hand: Hand, planner: PathPlanner) -> None:
        self.robot = robot
        self.hand = hand
        self.planner = planner
        self.phases: list[Phase] = []
        self.stopped: list[str] = []
        self._phase = ""

    def phase(self, name: str, act: Callable[[], Result]) -> Result:
        """Do something and note when it began and ended."""
        self._phase, start = name, self.hand.seconds
        result = act()
        self.phases.append(Phase(name=name, start=start, end=self.hand.seconds))
        return result

    def to_ready(self) -> None:
        """From beside the table to high above the board."""
        ready = self.robot.poses["ready"]
        height = max(self._clear_height(self.hand.posture, ready), self.planner.pinch(ready)[2])
        self._drive(np.array([self.hand.posture, self.planner.upwards(ready, height)[-1]]))

    def descend(self, goal: Float[np.ndarray, " n"]) -> None:
        """Go above a pose and straight down to it, slowly at the end; stop on contact."""
        if not self._down(goal):
            self.stopped.append(self._phase)

    def set_down(self, goal: Float[np.ndarray, " n"]) -> None:
        """Descend with a block; where it comes down on an edge, feel for the gap beside it.

        A block on an edge is pushed up on one side, and the hand gives way to the other. A
        block that finds no gap stays where it stopped. What stops the hand less than half a
        block above its goal is no edge, but what the block is to stand on.
        """
        arrived = self._down(goal)
        target = self.planner.pinch(goal)
        step = np.zeros(2)
        for _ in range(FEELS):
            here = self.planner.pinch(self.hand.posture)
            lean = self.hand.lean()
            if arrived or here[2] < target[2] + BLOCK_SIZE / 2 or not np.any(lean):
                break
            away = -lean / np.linalg.norm(lean)
            # Back where it came from: the gap is between the last two places.
            length = 0.5 * np.linalg.norm(step) if away @ step < 0.0 else FEEL_STEP
            step = length * away
            target[:2] += step
            lifted, _ = self.planner.reach(here + [0.0, 0.0, FEEL_LIFT], self.hand.posture)
            above = np.array([target[0], target[1], here[2] + FEEL_LIFT])
            beside, _ = self.planner.reach(above, lifted)
            below, _ = self.planner.reach(target, beside)
            self._drive(np.array([self.hand.posture, lifted, beside]))
            arrived = self._drive(
                np.array([self.hand.posture, below]), careful=True, approach=APPROACH
            )
        if not arrived:
            self.stopped.append(self._phase)

    def _down(self, goal: Float[np.ndarray, " n"]) -> bool:
        here, there = self.planner.pinch(self.hand.posture), self.planner.pinch(goal)
        if np.linalg.norm(here[:2] - there[:2]) < 0.03 and here[2] - there[2] < 0.02:
            return self._drive(np.array([self.hand.posture, goal]), careful=True)
        height = max(self._clear_height(self.hand.posture, goal), here[2])
        above = self.planner.upwards(goal, height)[::-1]
        if np.linalg.norm(here[:2] - there[:2]) > 0.01:
            self._drive(self.planner.across(self.hand.posture, above[0]))
        above[0] = self.hand.posture
        return self._drive(above, careful=True, approach=APPROACH)

    def lift(self, goal: Float[np.ndarray, " n"]) -> None:
        """Straight up until nothing is in the way to a pose."""
        here = self.planner.pinch(self.hand.posture)[2]
        height = max(self._clear_height(self.hand.posture, goal), here + LEAST_LIFT)
        self._drive(self.planner.upwards(self.hand.posture, height))

    def cross(self, goal: Float[np.ndarray, " n"]) -> None:
        """At this height to above a pose."""
        height = self.planner.pinch(self.hand.posture)[2]
        above = self.planner.upwards(goal, height)[-1]
        self._drive(self.planner.across(self.hand.posture, above))

    def hover(self, goal: Float[np.ndarray, " n"]) -> float:
        """Come down to a little above a pose, to be looked at; returns how far above (metres)."""
        bottom = float(self.planner.pinch(goal)[2])
        above = self.planner.upwards(goal, bottom + HOVER)[-1]
        self._drive(np.array([self.hand.posture, above]), careful=True)
        return float(self.planner.pinch(above)[2] - bottom)

    def beside(
        self, goal: Float[np.ndarray, " n"], shift: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, " n"]:
        """The posture whose pinch is beside that of a pose, in metres of the robot frame."""
        if not np.any(shift):
            return goal
        return self.planner.reach(self.planner.pinch(goal) + shift, goal)[0]

    def retreat(self) -> None:
        """Straight up, and back beside the table."""
        prepare = self.robot.poses["prepare"]
        self.lift(prepare)
        self._drive(np.array([self.hand.posture, prepare]))

    def settle(self) -> None:
        """Wait until everything rests (at most 1.5 seconds)."""
        for _ in range(15):
            self.hand.wait(0.1)
            if self.hand.at_rest():
                break

    def story(
        self,
        blocks: tuple[Block, ...],
        begins_held: int | None,
        grasped: int | None,
        distance: float | None,
        closed: bool,
    ) -> str:
        """What the hand did, as a clause."""
        told = []
        if self.stopped:
            told.append(f"the hand pushed on something and stopped ({', '.join(self.stopped)})")
        if self.hand.touched:
            told.append(f"the arm touched {' and '.join(sorted(self.hand.touched))}")
        if begins_held is not None and grasped is None:
            told.append("the hand was told to open before it had placed its block")
        elif begins_held is not None:
            told.append(
                "the hand kept its block" if self.hand.held is not None else "the hand let go"
            )
        elif grasped is not None:
            kind = kind_of(blocks[grasped])
            told.append(
                f"the hand grasped the {kind} {1000 * (distance or 0):.1f} mm from the pinch"
            )
        elif closed and distance is None:
            told.append("the hand was told to be closed before the grasp and held nothing")
        elif distance is not None:
            told.append(
                f"the hand closed {1000 * distance:.0f} mm from the nearest block's grasp point "
                f"(the gate is {1000 * GATE:.0f} mm) and held nothing"
            )
        else:
            told.append("there was nothing to grasp")
        return "; ".join(told)

    def _drive(
        self, postures: Float[np.ndarray, "k n"], *, careful: bool = False, approach: float = 0.0
    ) -> bool:
        motion = self.planner.motion(np.asarray(postures), TIME_STEP, approach)
        arrived = self.hand.follow(motion, careful=careful)
        if arrived and careful:
            self.hand.wait(0.06)
        return arrived

    def _clear_height(self, start: Float[np.ndarray, " n"], goal: Float[np.ndarray, " n"]) -> float:
        """Height of the pinch at which a held block passes over all blocks on the way."""
        robot, physics = self.robot, self.hand.physics
        a, b = self.planner.pinch(start), self.planner.pinch(goal)
        positions = physics.block_poses(self.hand.data.qpos).positions
        others = np.arange(len(positions)) != (-1 if self.hand.held is None else self.hand.held)
        along = b[:2] - a[:2]
        length = max(float(along @ along), 1e-9)
        share = np.clip((positions[:, :2] - a[:2]) @ along / length, 0.0, 1.0)
        gaps = np.linalg.norm(positions[:, :2] - (a[:2] + share[:, None] * along), axis=1)
        tops = positions[others & (gaps < CORRIDOR), 2] + BLOCK_HALF[2]
        hanging = robot.pinch_clearance + BLOCK_SIZE + AIR
        highest = robot.pinch_position((0, 0, 7))[2] + HIGHEST
        return float(min(max([b[2] + LEAST_LIFT, *(tops + hanging)]), highest))
