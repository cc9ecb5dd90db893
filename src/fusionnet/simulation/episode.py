"""One pick and place in the simulator: what happened, and whether it was what was asked."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fusionnet.blocks.grid import BLOCK_SIZE, GRID, Block, Cell, Gripper, Layout
from fusionnet.errors import InputError
from fusionnet.geometry import apply, invert
from fusionnet.robots import Robot
from fusionnet.simulation.appearance import Appearance
from fusionnet.simulation.physics import describe_grasp_model
from fusionnet.simulation.tabletop import BlockPoses, cell_at, cell_center

TIPPED = np.deg2rad(20.0)
"""A block that leans further than this does not stand in its cell, wherever its centre is."""

_PLACES = 12
"""Of shifts in metres: what remains is the noise of floating point."""


@dataclass(frozen=True, kw_only=True)
class Phase:
    """One part of an episode, from and to in simulated seconds."""

    name: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class Recording:
    """States of an episode, 25 a second, from which a film can be made."""

    robot: str | Robot
    blocks: tuple[Block, ...]
    postures: Float[np.ndarray, "t q"]
    positions: Float[np.ndarray, "t n 3"]
    rotations: Float[np.ndarray, "t n 3 3"]
    appearance: Appearance

    def __len__(self) -> int:
        return len(self.postures)


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """The outcome of one execution.

    Attributes:
        success: Whether the world ended as expected; None when nothing was expected.
        reason: Why, in one sentence.
        targets: What was answered: grasp joints, grasp gripper, place joints, place gripper.
        layout_after: Blocks in the cells where they were measured at the end (off the grid
            where they fell off the board), and the hand.
        grasped: The block that the hand closed on, or None.
        errors: Distance of each block (in the order of the world's layout) from the middle of
            its expected cell, or from where it stood before when nothing was expected, in mm.
        displacement: Largest distance by which any block moved that was never held, in mm.
        grasp_distance: From the pinch to the nearest block's grasp point when the hand closed,
            in mm; None if it did not close.
        stopped: Phases that were cut short because the hand pushed on something.
        touched: What the arm or the hand touched beside blocks: "the table", "the floor", or
            "its own body".
        seconds: Simulated time.
        phases: Parts of the motion.
        corrections: How far the pinch was moved from the answered "grasp" and "place" where it was
            looked again, in the robot frame, in metres; empty where it was not.
        grasp_model: How grasping is simulated.
        shifts: How far each block stood beside the middle of its cell when the episode began,
            along x and y of the board, in metres.
        recording: States for a film, if recorded.
    """

    success: bool | None
    reason: str
    targets: Float[np.ndarray, " k"]
    layout_after: Layout
    grasped: Block | None
    errors: Float[np.ndarray, " n"]
    displacement: float
    grasp_distance: float | None
    stopped: tuple[str, ...]
    touched: tuple[str, ...]
    seconds: float
    phases: tuple[Phase, ...]
    corrections: Mapping[str, Float[np.ndarray, "3"]] = field(default_factory=dict)
    grasp_model: str = field(default_factory=describe_grasp_model)
    shifts: Float[np.ndarray, "n 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    recording: Recording | None = None

    def video(self, path: str | Path, camera: str = "external") -> None:
        """Film the episode (mp4, 960x540, 25 frames a second).

        Raises:
            InputError: If the episode was not recorded.
            RenderingError: If there is no working OpenGL.
            OutputError: If the file cannot be written.
        """
        if self.recording is None:
            raise InputError(
                "This episode was not recorded; execute it again with record=True to film it."
            )
        from fusionnet.simulation.video import film

        film(self.recording, Path(path), camera)

    def as_json(self) -> dict[str, Any]:
        """Everything but the recording, as plain numbers, texts and lists."""
        return {
            "success": self.success,
            "reason": self.reason,
            "targets": [float(value) for value in self.targets],
            "layout_after": {
                "gripper": {
                    "cell": list(self.layout_after.gripper.cell),
                    "closed": self.layout_after.gripper.closed,
                },
                "blocks": [_block_json(b) for b in self.layout_after.blocks],
            },
            "grasped": None if self.grasped is None else _block_json(self.grasped),
            "errors_mm": [None if np.isnan(e) else round(float(e), 3) for e in self.errors],
            "displacement_mm": round(self.displacement, 3),
            "grasp_distance_mm": (
                None if self.grasp_distance is None else round(self.grasp_distance, 3)
            ),
            "stopped": list(self.stopped),
            "touched": list(self.touched),
            "seconds": round(self.seconds, 3),
            "phases": [
                {"name": p.name, "start": round(p.start, 3), "end": round(p.end, 3)}
                for p in self.phases
            ],
            "corrections_m": {
                name: [float(value) for value in shift] for name, shift in self.corrections.items()
            },
            "grasp_model": self.grasp_model,
            "shifts_m": self.shifts.tolist() if self.shifts.any() else [],
        }


def measured_layout(
    robot: Robot,
    blocks: tuple[Block, ...],
    poses: BlockPoses,
    held: int | None,
    closed: bool,
    pinch: Float[np.ndarray, "3"],
) -> Layout:
    """Each block in the cell where its centre is, and the hand in the cell of what it holds.

    An empty hand is in the cell of the grid that is nearest to it. A layout takes a block in a
    closed hand's cell for held, so an empty hand counts as open in the cell of a block.
    """
    board_from_robot = invert(robot.robot_from_board)
    centers = apply(board_from_robot, poses.positions)
    cells = [cell_at(center) for center in centers]
    if held is None:
        below_pinch = np.array([0.0, 0.0, robot.pinch_clearance + BLOCK_SIZE / 2])
        near = cell_at(apply(board_from_robot, pinch) - below_pinch)
        hand = Cell(*(int(np.clip(c, 0, GRID - 1)) for c in near))
        closed = closed and hand not in cells
    else:
        hand = cells[held]
    found = tuple(
        Block(block.color, block.shape, cell) for block, cell in zip(blocks, cells, strict=True)
    )
    return Layout(found, Gripper(hand, closed))


def measured_shifts(robot: Robot, poses: BlockPoses) -> Float[np.ndarray, "n 2"]:
    """How far each block stands beside the middle of its cell, along x and y of the board (m)."""
    centers = apply(invert(robot.robot_from_board), poses.positions)
    middles = np.array([cell_center(cell_at(center)) for center in centers]).reshape(-1, 3)
    return (centers - middles)[:, :2].round(_PLACES)


def judge(
    robot: Robot,
    blocks: tuple[Block, ...],
    poses: BlockPoses,
    held: int | None,
    expected: Layout,
) -> tuple[list[str], Float[np.ndarray, " n"]]:
    """What differs from the expected layout, in sentences, and each block's distance in mm.

    A block is where it should be if its centre is within half a cell, along each axis, of the
    middle of its cell and it stands upright. Blocks of one kind may stand in for each other.
    The level at which a block is held does not count, as in `Layout.same_blocks`.
    """
    centers = apply(invert(robot.robot_from_board), poses.positions)
    upright = poses.rotations[:, 2, 2] > np.cos(TIPPED)
    errors = np.full(len(blocks), np.nan)
    wrong: list[str] = []
    free = set(range(len(blocks)))
    for wanted in expected.blocks:
        middle = cell_center(wanted.cell)
        alike = [i for i in free if blocks[i].class_index == wanted.class_index]
        if not alike:
            wrong.append(f"the world has no {kind_of(wanted)} for cell {_cell(wanted.cell)}")
            continue
        offsets = centers[alike] - middle
        if expected.held == wanted and held in alike:
            offsets[alike.index(held), 2] = 0.0
        best = int(np.argmin(np.abs(offsets).max(axis=1)))
        block = alike[best]
        inside = np.abs(offsets[best]).max() <= BLOCK_SIZE / 2
        if not inside:
            continue
        free.discard(block)
        errors[block] = 1000.0 * np.linalg.norm(offsets[best])
        if not upright[block]:
            wrong.append(f"the {kind_of(wanted)} in cell {_cell(wanted.cell)} lies on its side")
        should_hold = expected.held == wanted
        if should_hold and held != block:
            wrong.append(f"the {kind_of(wanted)} is not in the hand")
        if not should_hold and held == block:
            wrong.append(f"the {kind_of(wanted)} is still in the hand")
    for block in sorted(free):
        wanted_cells = [
            w.cell for w in expected.blocks if w.class_index == blocks[block].class_index
        ]
        if not wanted_cells:
            wrong.append(f"no {kind_of(blocks[block])} was expected")
            continue
        offsets = np.linalg.norm(centers[block] - [cell_center(c) for c in wanted_cells], axis=1)
        errors[block] = 1000.0 * float(offsets.min())
        where = "in the hand" if held == block else f"in cell {_cell(cell_at(centers[block]))}"
        name, away = kind_of(blocks[block]), f"{errors[block]:.0f} mm"
        wrong.append(f"the {name} is {where}, {away} from where one belongs")
    return wrong, errors


def kind_of(block: Block) -> str:
    """For sentences: "red pyramid"."""
    return f"{block.color.value} {'pyramid' if block.shape.value == 'prism' else 'cube'}"


def _cell(cell: Cell) -> str:
    return f"({cell.x}, {cell.y}, {cell.z})"


def _block_json(block: Block) -> dict[str, Any]:
    return {"color": block.color.value, "shape": block.shape.value, "cell": list(block.cell)}
