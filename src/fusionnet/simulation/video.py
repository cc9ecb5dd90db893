"""Films of recorded episodes (mp4), rendered after the fact."""

import os
import tempfile
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from fusionnet.errors import OutputError
from fusionnet.simulation.episode import Recording
from fusionnet.simulation.hand import FRAMES_PER_SECOND
from fusionnet.simulation.renderer import EXTERNAL, shared_renderer
from fusionnet.simulation.tabletop import BlockPoses


def film(recording: Recording, path: Path, camera: str = "external") -> None:
    """Render a recording and write it as mp4 (H.264), whole or not at all.

    Raises:
        RenderingError: If there is no working OpenGL.
        UnknownNameError: If there is no such camera.
        OutputError: If the file cannot be written.
    """
    renderer = shared_renderer(recording.robot)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=".mp4")
        os.close(handle)
    except OSError as error:
        raise OutputError(f"The film {path} cannot be written: {error.strerror}.") from error
    aside = Path(name)
    try:
        writer = imageio_ffmpeg.write_frames(
            name,
            renderer.size,
            fps=FRAMES_PER_SECOND,
            codec="libx264",
            macro_block_size=4,
            ffmpeg_log_level="error",
            output_params=[
                "-preset",
                "veryfast",
                "-crf",
                "21",
                "-threads",
                "1",
                "-movflags",
                "+faststart",
            ],
        )
        writer.send(None)
        try:
            for index in range(len(recording)):
                writer.send(_frame(recording, index, camera))
        finally:
            writer.close()
        os.chmod(aside, 0o644)
        os.replace(aside, path)
    except OSError as error:
        raise OutputError(f"The film {path} cannot be written: {error}.") from error
    finally:
        aside.unlink(missing_ok=True)


def _frame(recording: Recording, index: int, camera: str) -> np.ndarray:
    poses = BlockPoses(
        recording.positions[index].astype(float), recording.rotations[index].astype(float)
    )
    look = recording.appearance
    view = shared_renderer(recording.robot).draw(
        recording.postures[index].astype(float),
        recording.blocks,
        poses,
        camera,
        look.lit_for_film() if camera == EXTERNAL else look,
        labels=False,
    )
    return np.ascontiguousarray(view.image)
