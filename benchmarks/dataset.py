"""How fast stored samples are made and read, and what they take of memory and disk.

    MUJOCO_GL=egl OMP_NUM_THREADS=1 python benchmarks/dataset.py

Prints JSON. Making: whole stored samples (picture with noise, boxes, masks, sentence with
variants, trees, joints, JPEG, Parquet), in processor seconds of one process, in twelve views
and through the robot's eye; the rival draws the same number of layouts by differential
rendering with MuJoCo's default quality and has picture, boxes and JPEG alone
(`benchmarks/overlay.py`). Reading: decoded samples at 512 x 288 with labels, in chance order,
by two processes at once; the rival is `datasets` with its own decoding. Memory: the process's
own peak, after each shard. MUJOCO_GL must be set, or the rival draws in our context.
"""

import json
import multiprocessing
import resource
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from overlay import ByDefault, empty_table, encoded

from fusionnet.blocks import random_layout
from fusionnet.dataset.build import build, make_shard, plan_for
from fusionnet.dataset.framing import whole_frame
from fusionnet.dataset.plan import BuildPlan
from fusionnet.dataset.reader import StoredPictures
from fusionnet.dataset.sources import Sources, studio
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.views import level_one, save_views

INPUT = (512, 288)
"""Width and height of what is read, in pixels."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        shards: Of 50 samples, made in views and as many through the eye.
        seconds: Of reading, for each way.
        corpus: Where layouts and sentences come from.
        data: Folder of the corpus.
        views: Environmental views; without, the robot's own look at its bare table twelve times.
        seed: Everything random derives from it.
    """

    shards: int = 6
    seconds: float = 10.0
    corpus: str = "synthetic"
    data: Path | None = None
    views: str | None = None
    seed: int = 0


def bare_views(folder: Path) -> str:
    """The robot's table as its left eye sees it, as twelve views and three."""
    seen = empty_table((1280, 720))
    matrix = seen.matrix * [[0.7], [0.7], [1.0]] + [[0, 0, 192.0], [0, 0, 60.0], [0, 0, 0]]
    parts = ["train"] * 12 + ["val"] * 3
    views = [
        replace(seen, name=f"view-{i}", part=part, matrix=matrix) for i, part in enumerate(parts)
    ]
    save_views(folder, tuple(views))
    return str(folder)


def making(out: Path, plan: BuildPlan, sources: Sources, shards: int) -> dict[str, Any]:
    """Processor time of whole samples, and the peak of memory after each shard."""
    studio(plan, sources)
    taken, wall, memory, size = [], [], [], 0
    for number in range(shards + 1):
        began, clock = time.process_time(), time.perf_counter()
        record = make_shard(out, plan, sources, "train", number)
        taken.append((time.process_time() - began) / record.rows)
        wall.append((time.perf_counter() - clock) / record.rows)
        memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        size += record.bytes / record.rows
    mean = float(np.mean(taken[1:]))  # the first warms up
    return {
        "milliseconds_of_processor": round(1000 * mean, 1),
        "milliseconds_of_clock": round(1000 * float(np.mean(wall[1:])), 1),
        "samples_a_second_and_core": round(1 / mean, 1),
        "kilobytes_a_sample": round(size / len(taken) / 1000, 1),
        "peak_megabytes_after_each_shard": [round(m) for m in memory],
    }


def rival(samples: int, seed: int, size: tuple[int, int], quality: int) -> float:
    """Processor seconds of a picture with boxes by MuJoCo's defaults."""
    view = empty_table(size)
    default, noise = ByDefault(view, size), level_one(0.15)
    layouts = [random_layout(generator(seed, "layout", i)) for i in range(samples)]
    looks = [noise.sample(generator(seed, "look", i), 64) for i in range(samples)]
    encoded(default.sample(layouts[0], looks[0])[0], quality)
    began = time.process_time()
    for layout, look in zip(layouts, looks, strict=True):
        encoded(default.sample(layout, look)[0], quality)
    return (time.process_time() - began) / samples


def read_ours(folder: str, seconds: float, seed: int) -> np.ndarray:
    """Samples a second of one process."""
    cv2.setNumThreads(1)
    pictures = StoredPictures(Path(folder), "train", frame=whole_frame((960, 540), INPUT))
    return _rate(seconds, seed, pictures.order, pictures.__getitem__)


def read_full(folder: str, seconds: float, seed: int) -> np.ndarray:
    """The same with the whole grid cropped and decoded at full scale."""
    cv2.setNumThreads(1)
    pictures = StoredPictures(Path(folder), "train")
    return _rate(seconds, seed, pictures.order, pictures.__getitem__)


def read_theirs(folder: str, seconds: float, seed: int) -> np.ndarray:
    """Samples a second of one process with `datasets`, decoded and resized by Pillow."""
    import datasets

    datasets.disable_progress_bars()
    with tempfile.TemporaryDirectory() as cache:
        loaded = datasets.load_dataset(folder, split="train", cache_dir=cache)
        loaded = loaded.select_columns(
            ["image", "boxes", "classes", "block_cells", "block_classes", "camera"]
        )

        def order(seed: int, epoch: int) -> np.ndarray:
            return generator(seed, epoch).permutation(len(loaded))

        def get(index: int) -> Any:
            sample = loaded[index]
            return np.asarray(sample["image"].resize(INPUT)), np.array(sample["boxes"])

        return _rate(seconds, seed, order, get)


def _rate(seconds: float, seed: int, order: Any, get: Any) -> np.ndarray:
    """Samples a second of the clock, and of the processor."""
    count, epoch = 0, 0
    get(0)
    began, worked = time.perf_counter(), time.process_time()
    while True:
        for index in order(seed, epoch):
            get(int(index))
            count += 1
            if time.perf_counter() - began > seconds:
                clock = time.perf_counter() - began
                return np.array([count / clock, count / (time.process_time() - worked)])
        epoch += 1


def measure(config: Config) -> dict[str, Any]:
    """Everything, one after the other."""
    begun = time.perf_counter()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        views = config.views or bare_views(folder / "views")
        sources = Sources(data=config.data, views=views)
        scale = str(50 * (config.shards + 1))
        options = {"varied": 0.5, "noised": 1.0, "shard": 50, "seed": config.seed}
        made: dict[str, Any] = {}
        for kind, share in (("in_views", 0.0), ("through_the_eye", 1.0)):
            plan = plan_for(scale, config.corpus, sources, eyes_share=share, **options)
            made[kind] = making(folder / kind, plan, sources, config.shards)
        theirs = rival(50, config.seed, plan.size, plan.quality)
        out = folder / "set"
        plan = plan_for(scale, config.corpus, sources, **options)
        build(out, plan, sources)
        rates = {}
        for way in (read_ours, read_full, read_theirs):
            jobs = [(str(out), config.seconds, config.seed + i) for i in range(2)]
            with multiprocessing.get_context("spawn").Pool(2) as pool:
                clock, worked = np.sum(pool.starmap(way, jobs), axis=0).round().tolist()
            rates[way.__name__] = {"by_the_clock": clock, "by_processor_time": worked}
    return {
        "making": made,
        "mujoco_default_samples_a_second_and_core": round(1 / theirs, 1),
        "times_as_fast_as_mujoco_default": round(
            1000 * theirs / made["in_views"]["milliseconds_of_processor"], 2
        ),
        "blenderproc_published_images_a_second": [0.25, 1.0],
        "reading_samples_a_second_on_two_cores": {
            "ours_512x288": rates["read_ours"],
            "ours_crop_at_full_scale": rates["read_full"],
            "datasets_512x288": rates["read_theirs"],
            "times_as_fast": round(
                rates["read_ours"]["by_processor_time"] / rates["read_theirs"]["by_processor_time"],
                2,
            ),
        },
        "corpus": config.corpus,
        "seed": config.seed,
        "duration_seconds": round(time.perf_counter() - begun, 1),
        **provenance(),
    }


if __name__ == "__main__":
    print(json.dumps(measure(tyro.cli(Config)), indent=1))
