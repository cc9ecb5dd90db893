"""NICO, the child-sized humanoid of the thesis; its left arm has six joints."""

from fusionnet.robots.nico.constants import ROBOT

__all__ = ["ROBOT"]
