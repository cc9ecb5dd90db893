"""What the fourteen values that a network gives for a command are worth: done, and compared."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fusionnet.blocks import apply, plan
from fusionnet.corpora import Command
from fusionnet.evaluation.policy import joint_errors
from fusionnet.robots import Robot
from fusionnet.simulation import joint_targets
from fusionnet.simulation.world import World


@dataclass(frozen=True)
class Acted:
    """One command done with a network's values.

    Attributes:
        success: Whether every block rests within half a cell of where it should be, and the
            hand holds what it should.
        squared_error: Mean squared error of the fourteen scaled values (thesis 4.3.2).
        grasp_degrees: Mean absolute error of the grasp's joints.
        place_degrees: Mean absolute error of the place's joints.
    """

    success: bool
    squared_error: float
    grasp_degrees: float
    place_degrees: float


def act(robot: Robot, command: Command, targets: Float[np.ndarray, " k"]) -> Acted:
    """Let the simulated arm do a command with a network's values.

    What lies outside the joints' limits is done at the limit, as an arm would.

    Args:
        robot: Whose arm.
        command: Its scene is where it is done, its tree says what should come out.
        targets: Grasp joints [rad], gripper, place joints [rad], gripper (1 closed).
    """
    before = command.scene.before
    wanted = plan(command.tree, before)
    low, high = robot.joint_limits.T
    done = np.clip(targets, np.r_[low, 0.0, low, 0.0], np.r_[high, 1.0, high, 1.0])
    episode = World(robot, before).execute(done, expected=apply(wanted, before))
    return Acted(bool(episode.success), *joint_errors(robot, targets, joint_targets(robot, wanted)))


def act_all(
    robot: Robot,
    commands: Sequence[Command],
    targets: Float[np.ndarray, "n k"],
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, float]:
    """Means over commands: executed success, scaled squared error, joint errors in degrees.

    Args:
        robot: Whose arm.
        commands: What is asked for.
        targets: One row a command.
        progress: Called with commands done, of how many.
    """
    acted: list[Acted] = []
    for command, row in zip(commands, targets, strict=True):
        acted.append(act(robot, command, row))
        if progress is not None:
            progress(len(acted), len(commands))
    grasp = float(np.mean([a.grasp_degrees for a in acted]))
    place = float(np.mean([a.place_degrees for a in acted]))
    return {
        "executed_success": float(np.mean([a.success for a in acted])),
        "joint_mse": float(np.mean([a.squared_error for a in acted])),
        "grasp_error_degrees": grasp,
        "place_error_degrees": place,
        "joint_error_degrees": (grasp + place) / 2,
    }
