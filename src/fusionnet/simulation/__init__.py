"""The simulated robot at its table: pictures, physics, and the pick-and-place episode.

Nothing here needs OpenGL until a picture is asked for. What is physics and what is a
model of grasping is written at the top of `physics.py`. `inverse_kinematics.py` finds
postures for any position of the hand.
"""

from fusionnet.simulation.appearance import BLOCK_COLORS, Appearance
from fusionnet.simulation.displacement import displacements
from fusionnet.simulation.episode import Episode, Phase
from fusionnet.simulation.renderer import SceneRenderer, View
from fusionnet.simulation.world import World, joint_targets, make_world

__all__ = [
    "BLOCK_COLORS",
    "Appearance",
    "Episode",
    "Phase",
    "SceneRenderer",
    "View",
    "World",
    "displacements",
    "joint_targets",
    "make_world",
]
