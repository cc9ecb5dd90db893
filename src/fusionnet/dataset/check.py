"""Look through a stored data set for damage, and name what is wrong.

Each shard's checksum and schema first; then, in every sample, whether the labels agree with
each other: the picture decodes, boxes are those of the masks, the move leads from one layout
to the other, the joints are those of its cells, and the split is the scene group's.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq

from fusionnet import robots
from fusionnet.blocks import CLASS_NAMES, Cell, Layout, Move, apply, layout_from_json
from fusionnet.corpora import part_of
from fusionnet.dataset.folder import read_checksums, read_plan
from fusionnet.dataset.frame import decoded
from fusionnet.dataset.masks import mask_extent
from fusionnet.dataset.plan import SPLITS, BuildPlan
from fusionnet.dataset.recipes import VIEW
from fusionnet.dataset.schema import schema
from fusionnet.dataset.shards import damaged, open_shard, record_of
from fusionnet.errors import DataError, FusionNetError
from fusionnet.rcl import parse
from fusionnet.simulation import joint_targets

MOST_FAULTS = 100
"""A check ends when it has found as many."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        file: Shard, within the data set.
        sample: Its identity; None if the whole shard is meant.
        what: What is wrong, and what to do where something can be done.
    """

    file: str
    sample: str | None
    what: str

    def __str__(self) -> str:
        return f"{self.file}{f', sample {self.sample}' if self.sample else ''}: {self.what}"


def check(folder: Path, *, labels: bool = True, progress: Progress | None = None) -> list[Fault]:
    """All faults of a data set, up to `MOST_FAULTS`.

    Args:
        folder: The data set.
        labels: Whether to look into the samples, too, rather than at checksums alone.
        progress: Called with samples looked at and samples in all.

    Raises:
        DataError: If it is no finished data set, or of another schema.
    """
    plan, records = read_plan(folder), read_checksums(folder)
    total = sum(count for _, count in plan.counts)
    faults: list[Fault] = []
    done = 0
    for shard in plan.shards:
        name = plan.file(*shard)
        for fault in _shard_faults(folder, name, plan, shard, records, labels):
            faults.append(fault)
            if len(faults) >= MOST_FAULTS:
                return faults
        done += len(plan.rows(*shard))
        if progress is not None:
            progress(done, total)
    return faults


def _shard_faults(
    folder: Path,
    name: str,
    plan: BuildPlan,
    shard: tuple[str, int],
    records: Mapping[str, Any],
    labels: bool,
) -> Iterator[Fault]:
    if name not in records:
        yield Fault(file=name, sample=None, what="It is missing from checksums.json; build again.")
        return
    try:
        found = record_of(folder, name)
        if found != records[name]:
            differs = "size" if found.bytes != records[name].bytes else "checksum"
            error = ValueError(f"its {differs} is another one")
            yield Fault(file=name, sample=None, what=str(damaged(folder / name, error)))
            return
        with open_shard(folder / name) as opened:
            if opened.schema_arrow != schema():
                yield Fault(file=name, sample=None, what="Its columns are not those of the schema.")
                return
            if labels:
                yield from _row_faults(opened, name, plan, shard[0])
    except DataError as error:
        yield Fault(file=name, sample=None, what=str(error))


def _row_faults(opened: pq.ParquetFile, name: str, plan: BuildPlan, split: str) -> Iterator[Fault]:
    for group in range(opened.num_row_groups):
        for sample in opened.read_row_group(group, use_threads=False).to_pylist():
            try:
                said = list(sample_faults(sample, plan, split))
            except (FusionNetError, ValueError, TypeError, IndexError, KeyError) as error:
                said = [f"A label cannot be read: {error}"]
            yield from (Fault(file=name, sample=sample["id"], what=what) for what in said)


def sample_faults(sample: Mapping[str, Any], plan: BuildPlan, split: str) -> Iterator[str]:
    """What is wrong in one sample."""
    size = (sample["width"], sample["height"])
    image = decoded(sample["image"]["bytes"], cv2.IMREAD_COLOR)
    if image is None or image.shape[1::-1] != size or size != plan.size:
        yield f"The picture is no JPEG of {plan.size[0]} x {plan.size[1]} pixels."
    yield from _box_faults(sample, size)
    before = layout_from_json(json.loads(sample["before"]))
    after = layout_from_json(json.loads(sample["after"]))
    cells = [block.cell.index for block in before.blocks]
    kinds = [block.class_index for block in before.blocks]
    if (cells, kinds) != (sample["block_cells"], sample["block_classes"]):
        yield "The blocks are not those of the layout before."
    yield from _move_faults(sample, before, after)
    for said in (sample, *sample["variants"]):
        if parse(said["tree"]) != parse(sample["tree"]):
            yield f"The tree of {said['sentence']!r} means something else."
    part, cameras = SPLITS[split]
    camera = sample["camera"]
    if sample["origin"] == "recorded" and part_of(sample["group"]) != part:
        yield f"Group {sample['group']} does not belong to {split}."
    if split != "train" and sample["origin"] != "recorded":
        yield f"A {sample['origin']} layout does not belong to {split}."
    allowed = plan.views[cameras == "val"] if camera["kind"] == VIEW else plan.eyes
    if camera["name"] not in allowed or (cameras == "eyes" and camera["kind"] == VIEW):
        yield f"The camera {camera['name']!r} does not belong to {split}."


def _box_faults(sample: Mapping[str, Any], size: tuple[int, int]) -> Iterator[str]:
    columns = ("classes", "box_blocks", "box_hidden", "masks")
    if any(len(sample[name]) != len(sample["boxes"]) for name in columns):
        yield "There are not as many classes or masks as boxes."
        return
    boxes = zip(sample["boxes"], sample["box_blocks"], sample["masks"], strict=True)
    for number, (box, block, lengths) in enumerate(boxes):
        edges, pixels = mask_extent(lengths, size)
        if box != edges:
            yield f"Box {number} is {box}; its mask's is {edges}."
        if pixels == 0 or pixels != sample["block_pixels"][block]:
            yield f"Mask {number} has {pixels} pixels, not {sample['block_pixels'][block]}."
        kind = sample["classes"][number]
        if not 0 <= kind < len(CLASS_NAMES) or kind != sample["block_classes"][block]:
            yield f"The class of box {number} is {kind}; its block's is another one."


def _move_faults(sample: Mapping[str, Any], before: Layout, after: Layout) -> Iterator[str]:
    said = sample["move"]
    move = Move(
        Cell(*said["source"]), Cell(*said["target"]), said["begins_held"], said["ends_held"]
    )
    if not apply(move, before).same_blocks(after):
        yield "The move does not lead from the layout before to the layout after."
    robot = robots.load(sample["robot"])
    joints = np.array(sample["joints"])
    if not np.allclose(joints, joint_targets(robot, move), atol=1e-6):
        yield "The joint values are not those of the move's cells."
    low, high = np.array(sample["joint_limits"]).T
    if not np.allclose(low + np.array(sample["joints_scaled"]) * (high - low), joints):
        yield "The scaled joint values do not fit the limits."
