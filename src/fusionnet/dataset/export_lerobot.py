"""Executed episodes as a LeRobot data set, version 3.0.

Each sample's joint values are executed in the simulator; a row is one of 25 frames a second,
its state the arm's joints and the hand, its action the state of the next frame, and the
robot's left eye films it. The sentence is the task.

    meta/info.json, meta/stats.json, meta/tasks.parquet
    meta/episodes/chunk-000/file-000.parquet
    data/chunk-000/file-000.parquet ...          one file an episode
    videos/observation.images.left_eye/chunk-000/file-000.mp4 ...

References:
    LeRobotDataset v3.0, https://huggingface.co/docs/lerobot/lerobot-dataset-v3
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float

from fusionnet import robots
from fusionnet.blocks import layout_from_json
from fusionnet.dataset.reader import StoredSamples
from fusionnet.errors import InputError
from fusionnet.files import folder_whole
from fusionnet.robots import Robot
from fusionnet.simulation import Episode, World
from fusionnet.simulation.hand import FRAMES_PER_SECOND
from fusionnet.simulation.renderer import shared_renderer

VERSION = "v3.0"
CAMERA = "left_eye"
VIDEO = f"observation.images.{CAMERA}"
CHUNK = 1000
"""Files a folder."""

_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEOS = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_EVERY = 10
"""Of the film's frames, every one of this many counts for its statistics."""

Progress = Callable[[int, int], None]
Stats = dict[str, Any]


def export_lerobot(
    folder: Path, out: Path, split: str, episodes: int, progress: Progress | None = None
) -> dict[str, int]:
    """Execute the first samples of a split and write them as episodes.

    Args:
        folder: The data set.
        out: A new folder, which is there whole or not at all.
        split: One of its splits.
        episodes: How many; at most the samples that there are.
        progress: Called with episodes written and episodes in all.

    Returns:
        Numbers of episodes, of frames, and of episodes that succeeded.

    Raises:
        DataError: If the data set is damaged or not finished.
        InputError: If no episodes are asked for.
        OutputError: If `out` holds files already or cannot be written.
        RenderingError: If nothing can be filmed here.
    """
    samples = StoredSamples(folder, split)
    number = min(episodes, len(samples))
    if number < 1:
        raise InputError(f"At least one episode is needed; asked for {episodes}.")
    robot = robots.load(samples.plan.robot)
    tasks: dict[str, int] = {}
    rows: list[dict[str, Any]] = []
    whole: dict[str, list[np.ndarray]] = {}
    first = succeeded = 0
    with folder_whole(out) as aside:
        for index in range(number):
            sample = samples[index]
            task = tasks.setdefault(sample["sentence"], len(tasks))
            episode = _execute(robot, sample)
            succeeded += bool(episode.success)
            columns = _columns(robot, episode, index, first, task)
            place = {"chunk_index": index // CHUNK, "file_index": index % CHUNK}
            _write_table(aside / _DATA.format(**place), columns)
            film = aside / _VIDEOS.format(video_key=VIDEO, **place)
            episode.video(film, CAMERA)
            arrays = {name: np.array(values) for name, values in columns.items()}
            stats = {name: _stats(_as_rows(values)) for name, values in arrays.items()}
            pixels = np.concatenate([frame.reshape(-1, 3) for frame in _frames(film)]) / 255.0
            stats[VIDEO] = {
                name: [[[v]] for v in value] if name != "count" else value
                for name, value in _stats(pixels[:: len(pixels) // 20_000 + 1]).items()
            }
            for name, values in (*arrays.items(), (VIDEO, pixels[::997])):
                whole.setdefault(name, []).append(_as_rows(values))
            length = len(columns["index"])
            rows.append(_episode_row(sample, index, first, length, place, stats))
            first += length
            if progress is not None:
                progress(index + 1, number)
        _write_meta(aside, robot, tasks, rows, whole, first)
    return {"episodes": number, "frames": first, "succeeded": succeeded}


def _execute(robot: Robot, sample: Mapping[str, Any]) -> Episode:
    before = layout_from_json(json.loads(sample["before"]))
    after = layout_from_json(json.loads(sample["after"]))
    return World(robot, before).execute(np.array(sample["joints"]), expected=after, record=True)


def _columns(
    robot: Robot, episode: Episode, index: int, first: int, task: int
) -> dict[str, list[Any]]:
    assert episode.recording is not None
    states = _states(robot, episode.recording.postures)
    length = len(states)
    last = np.arange(length) == length - 1
    return {
        "observation.state": states.tolist(),
        "action": np.concatenate([states[1:], states[-1:]]).tolist(),
        "next.done": last.tolist(),
        "next.success": (last & bool(episode.success)).tolist(),
        "timestamp": (np.arange(length) / FRAMES_PER_SECOND).tolist(),
        "frame_index": list(range(length)),
        "episode_index": [index] * length,
        "index": list(range(first, first + length)),
        "task_index": [task] * length,
    }


def _states(robot: Robot, postures: Float[np.ndarray, "t q"]) -> Float[np.ndarray, "t n"]:
    """The arm's joints [rad] and how far the hand is closed, 0 to 1, in each frame."""
    model = shared_renderer(robot.name).model

    def column(joint: str) -> Float[np.ndarray, " t"]:
        return postures[:, model.joint(joint).qposadr[0]]

    arm = [column(name) for name in robot.joint_names]
    finger, (opened, shut) = next(iter(robot.finger_positions.items()))
    closed = np.clip((column(finger) - opened) / (shut - opened), 0.0, 1.0)
    return np.stack([*arm, closed], axis=1).astype(np.float32)


def _frames(film: Path) -> Iterator[np.ndarray]:
    """Some frames of a film."""
    reader = cv2.VideoCapture(str(film))
    try:
        for number in count():
            read, frame = reader.read()
            if not read:
                return
            if number % _EVERY == 0:
                yield frame[..., ::-1]
    finally:
        reader.release()


def _as_rows(values: np.ndarray) -> np.ndarray:
    return values.reshape(len(values), -1).astype(float)


def _stats(rows: Float[np.ndarray, "n k"]) -> Stats:
    measured = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    return {name: value.tolist() for name, value in measured.items()} | {"count": [len(rows)]}


def _episode_row(
    sample: Mapping[str, Any],
    index: int,
    first: int,
    length: int,
    place: Mapping[str, int],
    stats: Mapping[str, Stats],
) -> dict[str, Any]:
    row = {
        "episode_index": index,
        "tasks": [sample["sentence"]],
        "length": length,
        "data/chunk_index": place["chunk_index"],
        "data/file_index": place["file_index"],
        "dataset_from_index": first,
        "dataset_to_index": first + length,
        f"videos/{VIDEO}/chunk_index": place["chunk_index"],
        f"videos/{VIDEO}/file_index": place["file_index"],
        f"videos/{VIDEO}/from_timestamp": 0.0,
        f"videos/{VIDEO}/to_timestamp": length / FRAMES_PER_SECOND,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    named = {f"stats/{n}/{kind}": v for n, kinds in stats.items() for kind, v in kinds.items()}
    return row | named


def _features(robot: Robot, size: tuple[int, int]) -> dict[str, Any]:
    names = [*robot.joint_names, "gripper"]
    vector = {"dtype": "float32", "shape": [len(names)], "names": names}
    film = {
        "dtype": "video",
        "shape": [size[1], size[0], 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": size[1],
            "video.width": size[0],
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": FRAMES_PER_SECOND,
            "video.channels": 3,
            "has_audio": False,
        },
    }

    def single(kind: str) -> dict[str, Any]:
        return {"dtype": kind, "shape": [1], "names": None}

    whole = ("frame_index", "episode_index", "index", "task_index")
    return {
        "observation.state": vector,
        "action": vector,
        VIDEO: film,
        "next.done": single("bool"),
        "next.success": single("bool"),
        "timestamp": single("float32"),
        **{name: single("int64") for name in whole},
    }


def _write_meta(
    aside: Path,
    robot: Robot,
    tasks: Mapping[str, int],
    rows: Sequence[Mapping[str, Any]],
    whole: Mapping[str, list[np.ndarray]],
    frames: int,
) -> None:
    info = {
        "codebase_version": VERSION,
        "robot_type": robot.name,
        "total_episodes": len(rows),
        "total_frames": frames,
        "total_tasks": len(tasks),
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": FRAMES_PER_SECOND,
        "splits": {"train": f"0:{len(rows)}"},
        "data_path": _DATA,
        "video_path": _VIDEOS,
        "features": _features(robot, shared_renderer(robot.name).size),
    }
    stats = {name: _stats(np.concatenate(values)) for name, values in whole.items()}
    for kind in ("min", "max", "mean", "std"):
        stats[VIDEO][kind] = [[[value]] for value in stats[VIDEO][kind]]
    (aside / "meta").mkdir(exist_ok=True)
    for name, document in (("info", info), ("stats", stats)):
        text = json.dumps(document, indent=4) + "\n"
        (aside / "meta" / f"{name}.json").write_text(text, encoding="utf-8")
    _write_table(aside / _EPISODES, {name: [row[name] for row in rows] for name in rows[0]})
    _write_tasks(aside / "meta" / "tasks.parquet", tasks)


def _write_tasks(file: Path, tasks: Mapping[str, int]) -> None:
    """A table whose index, as pandas reads it, are the sentences."""
    table = pa.table({"task_index": pa.array(tasks.values(), pa.int64()), "task": list(tasks)})
    kinds = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    columns = [
        {"name": n, "field_name": n, "pandas_type": p, "numpy_type": k, "metadata": None}
        for n, p, k in kinds
    ]
    about = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(about)}), file)


_TYPES = {
    "observation.state": pa.list_(pa.float32()),
    "action": pa.list_(pa.float32()),
    "timestamp": pa.float32(),
}


def _write_table(file: Path, columns: Mapping[str, list[Any]]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    arrays = {name: pa.array(values, _TYPES.get(name)) for name, values in columns.items()}
    pq.write_table(pa.table(arrays), file, compression="SNAPPY")
