"""Draw figures like the thesis's 3.4 and 3.5: overlays on many views, and under noise.

    python benchmarks/overlay_figures.py OUT [--views NAME_OR_FOLDER]

`OUT/overlay-views.jpg` has one layout in every view, `OUT/overlay-noise.jpg` one view under
level-one noise (a row each at strength 0.15, 0.5 and the thesis's 1), then under level two with
its boxes and the mapped outline of the board, then cropped (6.1) with sensor noise. Boxes are
red where less than a quarter of a block is visible. Without views the robot's own eyes and
the external camera look at their empty table.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro

from fusionnet.blocks import Layout
from fusionnet.corpora import load_corpus
from fusionnet.geometry import apply
from fusionnet.randomness import generator
from fusionnet.simulation import SceneRenderer, View
from fusionnet.simulation.tabletop import BOARD_SIZE
from fusionnet.views import (
    EnvironmentalView,
    LevelTwo,
    OverlayRenderer,
    SensorNoise,
    crop_around,
    cropped,
    level_one,
    transformed,
)
from fusionnet.views.view_files import load_views

WIDTH = 320
"""Of one picture in a figure, in pixels."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to draw.

    Attributes:
        out: Folder for the figures.
        views: Name of shipped views or a folder of them; the robot's cameras if left out.
        scene: Whose first layout is drawn, of the examples.
        seed: Everything random derives from it.
    """

    out: tyro.conf.Positional[Path]
    views: str | None = None
    scene: int = 3
    seed: int = 0


def robot_views(size: tuple[int, int]) -> tuple[EnvironmentalView, ...]:
    """The empty table by each of the robot's cameras."""
    renderer = SceneRenderer(size=size)
    seen = {name: renderer.view(Layout(()), name, labels=False) for name in renderer.cameras}
    robot_from_board = renderer.robot.robot_from_board
    renderer.close()
    return tuple(
        EnvironmentalView(
            name=name,
            environment="simulation",
            part="val",
            image=view.image,
            matrix=view.camera.matrix,
            camera_from_board=view.camera.camera_from_robot @ robot_from_board,
        )
        for name, view in seen.items()
    )


def sheet(images: list[np.ndarray], columns: int) -> np.ndarray:
    """Pictures side by side, in rows."""
    height = WIDTH * images[0].shape[0] // images[0].shape[1]
    small = [cv2.resize(i, (WIDTH, height), interpolation=cv2.INTER_AREA) for i in images]
    small += [np.full_like(small[0], 255)] * (-len(small) % columns)
    return np.vstack([np.hstack(small[i : i + columns]) for i in range(0, len(small), columns)])


def marked(view: View, robot_from_board: np.ndarray) -> np.ndarray:
    """The picture with the boxes and, by the mapped camera, the outline of the grid."""
    image = view.image.copy()
    for box, hidden in zip(view.boxes.astype(int).tolist(), view.mostly_hidden, strict=True):
        color = (255, 0, 0) if hidden else (0, 255, 0)
        cv2.rectangle(image, (box[0], box[1]), (box[2] - 1, box[3] - 1), color, 2)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * BOARD_SIZE
    outline = np.rint(view.camera.project(apply(robot_from_board, square))).astype(np.int32)
    cv2.polylines(image, [outline[:, None]], True, (255, 160, 0), 2)
    return image


def main(config: Config) -> None:
    """Draw both figures."""
    size = (960, 540)
    views = load_views(config.views) if config.views else robot_views(size)
    layout = load_corpus("examples").layouts[config.scene]
    renderer = OverlayRenderer(size)
    plain = [renderer.view(layout, view).image for view in views]
    rows = []
    for strength in (0.15, 0.5, 1.0):
        looks = [level_one(strength).sample(generator(config.seed, "look", i)) for i in range(5)]
        rows += [renderer.view(layout, views[0], look).image for look in looks]
    for crop in (False, True):
        for index in range(5):
            look = level_one(0.15).sample(generator(config.seed, "look", index))
            seen = renderer.view(layout, views[0], look, masks=True)
            new_from_old = LevelTwo().sample(generator(config.seed, "two", index), size)
            moved = transformed(seen, new_from_old)
            if crop:
                moved = cropped(moved, crop_around(moved.boxes, size), size)
                rows.append(SensorNoise().apply(moved.image, generator(config.seed, "s", index)))
            else:
                rows.append(marked(moved, renderer.robot.robot_from_board))
    config.out.mkdir(parents=True, exist_ok=True)
    for name, images, columns in (
        ("overlay-views", plain, min(5, len(plain))),
        ("overlay-noise", rows, 5),
    ):
        picture = cv2.cvtColor(sheet(images, columns), cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(config.out / f"{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main(tyro.cli(Config))
