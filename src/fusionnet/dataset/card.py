"""The card of a data set: what it holds, in words for people and for `datasets`."""

from collections.abc import Mapping

from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset.plan import SPLITS, BuildPlan
from fusionnet.dataset.schema import COLUMNS, SCHEMA_VERSION
from fusionnet.dataset.shards import ShardRecord

_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (10**6, "100K<n<1M"))

_CAMERAS = {
    "train": "views for training (a share through the robot's eyes)",
    "val": "views for validation",
    "eyes": "the robot's eyes, in simulation",
}


def card(plan: BuildPlan, records: Mapping[str, ShardRecord]) -> str:
    """README.md of a data set."""
    total = sum(count for _, count in plan.counts)
    size = next((name for limit, name in _SIZES if total < limit), "n>1M")
    configs = "\n".join(
        f"  - split: {split}\n    path: data/{split}-*.parquet" for split, _ in plan.counts
    )
    splits = "\n".join(
        f"| `{split}` | {count:,} | {SPLITS[split][0]} | {_cameras(plan, split)} |"
        for split, count in plan.counts
    )
    columns = "\n".join(f"| `{name}` | {meaning} |" for name, (_, meaning) in COLUMNS.items())
    megabytes = sum(record.bytes for record in records.values()) / 1e6
    return f"""---
pretty_name: FusionNet pick and place
task_categories:
- object-detection
- robotics
language:
- en
size_categories:
- {size}
configs:
- config_name: default
  data_files:
{configs}
---

# Pick and place: pictures, sentences, trees and joint angles

Made by FusionNet, version {SCHEMA_VERSION} of its schema: {total:,} samples in {len(records)}
files, {megabytes:,.0f} MB. Each is a picture of coloured blocks on a board, a sentence that
asks for one of them to be moved, what the sentence means, and what the arm must do.

```python
from datasets import load_dataset  # 4 or later

samples = load_dataset("this folder", split="{plan.counts[0][0]}")
```

## Splits

By group of scenes and by view: no layout of a held-out group and no view for validation is
trained on.

| split | samples | groups of the corpus | seen through |
| --- | --- | --- | --- |
{splits}

## Where it comes from

Corpus `{plan.corpus}`; robot `{plan.robot}`; seed {plan.seed}. Of the training samples
{plan.varied:.0%} show a varied or invented layout, with a sentence of FusionNet's own grammar,
and {plan.eyes_share if plan.views[0] else 1:.0%} are seen through the robot's eyes. `plan.json` \
has everything, `checksums.json` the SHA-256 of
each file.

## Columns

| column | meaning |
| --- | --- |
{columns}

Classes, by number from 0: {", ".join(CLASS_NAMES)}.

Frames: `board` has its origin at the outer corner of cell (0, 0) on the table top and its axes
along x, y and z of the grid (squares of 26.3 mm); `camera` is OpenCV's (x right, y down,
z forward). `camera_from_board` takes points of the board to the camera.
"""


def _cameras(plan: BuildPlan, split: str) -> str:
    cameras = SPLITS[split][1] if plan.views[0] or split != "train" else "eyes"
    return _CAMERAS[cameras]
