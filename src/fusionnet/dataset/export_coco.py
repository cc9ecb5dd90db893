"""A data set as COCO: pictures in a folder, boxes and masks in one JSON file a split.

References:
    https://cocodataset.org/#format-data
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Any

from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset.folder import read_plan
from fusionnet.dataset.reader import StoredSamples
from fusionnet.files import folder_whole

Progress = Callable[[int, int], None]


def export_coco(
    folder: Path, out: Path, splits: Iterable[str] | None = None, progress: Progress | None = None
) -> None:
    """Write `OUT/images/SPLIT/SPLIT-NUMBER.jpg`, annotations and captions of each split.

    The annotations are `OUT/annotations/instances_SPLIT.json`. A sample's own id names no file:
    a stranger's may be a path.

    Args:
        folder: The data set.
        out: A new folder, which is there whole or not at all.
        splits: Which splits; all by default.
        progress: Called with samples written and samples in all.

    Raises:
        DataError: If the data set is damaged or not finished.
        UnknownNameError: If it has no such split.
        OutputError: If `out` holds files already or cannot be written.
    """
    chosen = {s: StoredSamples(folder, s) for s in splits or dict(read_plan(folder).counts)}
    total, done = sum(map(len, chosen.values())), 0
    with folder_whole(out) as aside:
        (aside / "annotations").mkdir()
        for split, samples in chosen.items():
            (aside / "images" / split).mkdir(parents=True)
            instances, captions = _document(split), _document(split)
            del captions["categories"]
            numbers = count(1)
            for number, sample in enumerate(samples, 1):
                name = f"{split}-{number - 1:08d}.jpg"
                (aside / "images" / split / name).write_bytes(sample["image"]["bytes"])
                image = {
                    "id": number,
                    "file_name": f"{split}/{name}",
                    "width": sample["width"],
                    "height": sample["height"],
                }
                for document in (instances, captions):
                    document["images"].append(image)
                instances["annotations"] += list(_annotations(sample, number, numbers))
                captions["annotations"].append(
                    {"id": number, "image_id": number, "caption": sample["sentence"]}
                )
                done += 1
                if progress is not None:
                    progress(done, total)
            for kind, document in (("instances", instances), ("captions", captions)):
                file = aside / "annotations" / f"{kind}_{split}.json"
                file.write_text(json.dumps(document) + "\n", encoding="utf-8")


def _document(split: str) -> dict[str, Any]:
    kinds = [
        {"id": number, "name": name, "supercategory": name.partition("_")[0]}
        for number, name in enumerate(CLASS_NAMES, 1)
    ]
    about = {"description": f"FusionNet pick and place, {split}", "version": "1"}
    return {"info": about, "licenses": [], "images": [], "annotations": [], "categories": kinds}


def _annotations(
    sample: Mapping[str, Any], image: int, numbers: Iterator[int]
) -> Iterator[dict[str, Any]]:
    """One for each box; a category's number is the class index plus one."""
    columns = (sample[name] for name in ("boxes", "classes", "masks", "box_blocks"))
    for (left, top, right, bottom), kind, lengths, block in zip(*columns, strict=True):
        yield {
            "id": next(numbers),
            "image_id": image,
            "category_id": kind + 1,
            "bbox": [left, top, right - left, bottom - top],
            "area": sample["block_pixels"][block],
            "segmentation": {"size": [sample["height"], sample["width"]], "counts": lengths},
            "iscrowd": 0,
            "visible_share": round(sample["block_shares"][block], 4),
        }
