"""Draw figures like the thesis's 3.3 to 3.5: an overlay step by step, on many views, under noise.

    python benchmarks/overlay_figures.py OUT [--views NAME_OR_FOLDER] [--photographs FOLDER]

`OUT/overlay-steps.jpg` has a photograph of a room as its fisheye lens takes it, undistorted, with
the mesh of the grasping region, and with blocks. `OUT/overlay-views.jpg` has one layout in every
view, `OUT/overlay-lamps.jpg` one view in nominal light and in that of the lamps that its room's
photographs tell of. `OUT/overlay-noise.jpg` has one view under level-one noise (a row each at
strength 0.15, 0.5 and the thesis's 1), then under level two with its boxes and the mapped outline
of the board, then cropped (6.1) with sensor noise. Boxes are red where less than a quarter of a
block is visible. Without views the robot's own eyes and the external camera look at their empty
table. With photographs of a checkerboard `OUT/overlay-real.jpg` has low layouts upon them, whether
or not the whole grid is in the picture.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import tyro

from fusionnet.blocks import BLOCK_SIZE, GRID, Layout, random_layout
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
from fusionnet.views.calibration import calibrate
from fusionnet.views.checkerboard import Checkerboard
from fusionnet.views.glints import NO_LAMPS
from fusionnet.views.importing import view_of
from fusionnet.views.photographing import photograph_pose
from fusionnet.views.photographs import find_boards
from fusionnet.views.pose import draw_region
from fusionnet.views.rooms import ROOMS, RoomPhotographer
from fusionnet.views.view_files import load_views

WIDTH = 320
"""Of one picture in a figure, in pixels."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to draw.

    Attributes:
        out: Folder for the figures.
        views: Name of shipped views or a folder of them; the robot's cameras if left out.
        noised: Number of the view that is drawn under noise.
        photographs: Folder of photographs of one checkerboard by one camera.
        board: Squares along that board's long and short side.
        scene: Whose first layout is drawn, of the examples.
        seed: Everything random derives from it.
    """

    out: tyro.conf.Positional[Path]
    views: str | None = None
    noised: int = 0
    photographs: Path | None = None
    board: tuple[int, int] = (10, 7)
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


def steps(layout: Layout, name: str = "round-white-mixed-robot") -> list[np.ndarray]:
    """A photograph of a room, undistorted, with the grasping region, with blocks (figure 3.3)."""
    view = next(view for view in load_views("rooms") if view.name == name)
    room = next(room for room in ROOMS if room.name == view.environment)
    size = (view.image.shape[1], view.image.shape[0])
    photographer = RoomPhotographer(room, size)
    shot = name.removeprefix(f"{room.name}-")
    pose = photograph_pose(room, shot, size, 0)
    raw = photographer.take(pose, generator(0, "sensor noise", room.name, shot))
    photographer.close()
    region = draw_region(view.image, view.camera, GRID)
    return [raw, view.image, region, OverlayRenderer(size).view(layout, view).image]


def lamps(layout: Layout, name: str = "round-white-mixed-view-2") -> list[np.ndarray]:
    """The table of a shipped view with blocks, lit by nominal lamps and by those that were found.

    Half the picture's width: shadows are to be compared with those of toys.
    """
    view = next(view for view in load_views("rooms") if view.name == name)
    height, width = view.image.shape[:2]
    renderer = OverlayRenderer((width, height))
    drawn = [
        renderer.view(layout, each).image
        for each in (replace(view, light_directions=NO_LAMPS), view)
    ]
    return [image[height // 2 - 20 :, width // 4 : 3 * width // 4] for image in drawn]


def real_photographs(folder: Path, squares: tuple[int, int], seed: int) -> list[np.ndarray]:
    """Every photograph of a folder in which the board was found, undistorted, with low blocks."""
    board = Checkerboard(*squares, BLOCK_SIZE)
    calibration = calibrate([find_boards(folder, board)], board)
    environment, renderer = calibration.environments[0], OverlayRenderer(calibration.size)
    drawn = []
    for photograph in environment.used:
        view = view_of(calibration, environment, photograph)
        layout = random_layout(generator(seed, "real", photograph.name))
        low = tuple(b for b in layout.blocks if b.cell.z < 3 and b is not layout.held)
        drawn.append(renderer.view(Layout(low), view).image)
    return drawn


def sheet(images: list[np.ndarray], columns: int) -> np.ndarray:
    """Pictures side by side, in rows; smaller if they are more than two."""
    width = WIDTH if len(images) > 2 else images[0].shape[1]
    height = width * images[0].shape[0] // images[0].shape[1]
    small = [cv2.resize(i, (width, height), interpolation=cv2.INTER_AREA) for i in images]
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
    """Draw all figures."""
    size = (960, 540)
    views = load_views(config.views) if config.views else robot_views(size)
    layout = load_corpus("examples").layouts[config.scene]
    renderer = OverlayRenderer(size)
    plain = [renderer.view(layout, each).image for each in views]
    view = views[config.noised]
    rows = []
    for strength in (0.15, 0.5, 1.0):
        looks = [level_one(strength).sample(generator(config.seed, "look", i)) for i in range(5)]
        rows += [renderer.view(layout, view, look).image for look in looks]
    for crop in (False, True):
        for index in range(5):
            look = level_one(0.15).sample(generator(config.seed, "look", index))
            seen = renderer.view(layout, view, look, masks=True)
            new_from_old = LevelTwo().sample(generator(config.seed, "two", index), size)
            moved = transformed(seen, new_from_old)
            if crop:
                moved = cropped(moved, crop_around(moved.boxes, size), size)
                rows.append(SensorNoise().apply(moved.image, generator(config.seed, "s", index)))
            else:
                rows.append(marked(moved, renderer.robot.robot_from_board))
    config.out.mkdir(parents=True, exist_ok=True)
    figures = [
        ("overlay-steps", steps(layout), 4),
        ("overlay-views", plain, min(5, len(plain))),
        ("overlay-lamps", lamps(layout), 2),
        ("overlay-noise", rows, 5),
    ]
    if config.photographs:
        real = real_photographs(config.photographs, config.board, config.seed)
        figures.append(("overlay-real", real, 4))
    for name, images, columns in figures:
        picture = cv2.cvtColor(sheet(images, columns), cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(config.out / f"{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main(tyro.cli(Config))
