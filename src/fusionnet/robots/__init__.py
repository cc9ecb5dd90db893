"""Robots: one folder each, holding its MJCF, its constants and its cell-to-joint table.

`load("nico")` imports `robots/nico` and returns its public object `ROBOT`, a `Robot`.
A newcomer's robot is one more folder; see `docs/add-your-robot.md`.
"""

from fusionnet.catalogue import Catalogue
from fusionnet.robots._joint_table import (
    TableQuality,
    make_joint_table,
    measure_joint_table,
    save_joint_table,
)
from fusionnet.robots._kinematics import ArmKinematics
from fusionnet.robots._model import CollisionBit, compiled, model_errors
from fusionnet.robots._robot import Robot, TableTop

_CATALOGUE = Catalogue("fusionnet.robots", kind="robot", attribute="ROBOT")


def names() -> list[str]:
    """The names of all robots, sorted."""
    return _CATALOGUE.names()


def load(name: str) -> Robot:
    """The robot called `name`.

    Raises:
        UnknownNameError: If there is none; the message lists what there is.
    """
    robot: Robot = _CATALOGUE.load(name)
    return robot


__all__ = [
    "ArmKinematics",
    "CollisionBit",
    "Robot",
    "TableQuality",
    "TableTop",
    "compiled",
    "load",
    "make_joint_table",
    "measure_joint_table",
    "model_errors",
    "names",
    "save_joint_table",
]
