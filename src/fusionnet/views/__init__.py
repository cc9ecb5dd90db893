"""Environmental views: photographs of a board, blocks drawn into them, noise (thesis 3.2)."""

from fusionnet.views.backdrops import Backdrops
from fusionnet.views.drawn import drawn_view, drawn_views
from fusionnet.views.noise import LevelOne, Look, SensorNoise, level_one
from fusionnet.views.overlay import OverlayRenderer
from fusionnet.views.transformation import LevelTwo, crop_around, cropped, transformed
from fusionnet.views.view import EnvironmentalView, check_view
from fusionnet.views.view_files import load_views, save_views

__all__ = [
    "Backdrops",
    "EnvironmentalView",
    "LevelOne",
    "LevelTwo",
    "Look",
    "OverlayRenderer",
    "SensorNoise",
    "check_view",
    "crop_around",
    "cropped",
    "drawn_view",
    "drawn_views",
    "level_one",
    "load_views",
    "save_views",
    "transformed",
]
