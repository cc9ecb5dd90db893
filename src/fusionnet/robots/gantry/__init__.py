"""A three-axis gantry with a two-finger gripper: the teaching example of a second robot."""

from fusionnet.robots.gantry.constants import ROBOT

__all__ = ["ROBOT"]
