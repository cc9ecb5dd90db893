"""Films of episodes."""

import cv2
import numpy as np
import pytest

from fusionnet.blocks import Block, Cell, Color, Shape
from fusionnet.errors import OutputError
from fusionnet.simulation import Appearance
from fusionnet.simulation.episode import Recording
from fusionnet.simulation.renderer import shared_renderer
from fusionnet.simulation.video import film


@pytest.fixture(scope="module")
def recording(pictures_here):
    renderer = shared_renderer("nico")
    block = Block(Color.RED, Shape.CUBE, Cell(3, 3, 0))
    place = renderer.robot.cell_position(block.cell)
    frames = 4
    rising = place + np.outer(np.arange(frames), [0.0, 0.0, 0.04])
    return Recording(
        robot="nico",
        blocks=(block,),
        postures=np.tile(renderer.model.qpos0, (frames, 1)),
        positions=rising[:, None],
        rotations=np.tile(np.eye(3), (frames, 1, 1, 1)),
        appearance=Appearance(),
    )


def test_a_film_shows_every_recorded_state(recording, tmp_path):
    path = tmp_path / "new folder" / "film.mp4"
    film(recording, path)
    video = cv2.VideoCapture(str(path))
    frames = []
    while (read := video.read())[0]:
        frames.append(read[1].astype(int))
    assert video.get(cv2.CAP_PROP_FPS) == 25.0
    assert [frame.shape for frame in frames] == [(540, 960, 3)] * len(recording)
    red = [np.argwhere((f[..., 2] > 120) & (f[..., :2].max(axis=2) < 70)) for f in frames]
    heights = [float(pixels[:, 0].mean()) for pixels in red]
    assert np.all(np.diff(heights) < -5)  # the block rises in the picture
    assert [p.name for p in path.parent.iterdir()] == ["film.mp4"]


def test_a_film_that_cannot_be_written_is_said_so(recording, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        film(recording, tmp_path / "file" / "film.mp4")
