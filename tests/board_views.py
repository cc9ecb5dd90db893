"""Environmental views rendered by us: the bare board as the robot's eye sees it, a little wider."""

from dataclasses import replace

import numpy as np

from fusionnet.blocks import Layout
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.views import EnvironmentalView


def board_views(
    size: tuple[int, int] = (640, 360), train: int = 2, val: int = 1
) -> tuple[EnvironmentalView, ...]:
    """Views of one room, numbered: for training, then for validation."""
    renderer = SceneRenderer("nico", size)
    views = []
    for number in range(train + val):
        turn = 0.04 * np.array([1.0, -1.0, 2.0]) * number / (train + val)
        look = replace(Appearance(), view_scale=1.3, camera_rotation=turn)
        seen = renderer.view(Layout(()), appearance=look, labels=False)
        views.append(
            EnvironmentalView(
                name=f"room-{number}",
                environment="room",
                part="train" if number < train else "val",
                image=seen.image,
                matrix=seen.camera.matrix,
                camera_from_board=seen.camera.camera_from_robot @ renderer.robot.robot_from_board,
            )
        )
    renderer.close()
    return tuple(views)
