"""Environmental views: photographs of a board, blocks drawn into them, noise (thesis 3.2)."""

from fusionnet.views.noise import LevelOne, Look, SensorNoise, level_one
from fusionnet.views.overlay import OverlayRenderer, shared_overlay
from fusionnet.views.transformation import LevelTwo, crop_around, cropped, transformed
from fusionnet.views.view import EnvironmentalView

__all__ = [
    "EnvironmentalView",
    "LevelOne",
    "LevelTwo",
    "Look",
    "OverlayRenderer",
    "SensorNoise",
    "crop_around",
    "cropped",
    "level_one",
    "shared_overlay",
    "transformed",
]
