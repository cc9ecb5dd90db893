"""The simulated robot at its table: pictures, physics, and the pick-and-place episode.

Nothing here needs OpenGL until a picture is asked for.
"""

from fusionnet.simulation.appearance import BLOCK_COLORS, Appearance
from fusionnet.simulation.renderer import SceneRenderer, View

__all__ = ["BLOCK_COLORS", "Appearance", "SceneRenderer", "View"]
