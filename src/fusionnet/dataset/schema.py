"""The columns of a stored sample, as Arrow types and as Hugging Face features.

A sample stores causes (layouts, sentence, tree, camera, seeds) as well as labels, so that
a new intermediate representation derives its target without a new build. The shards carry
the features in their metadata, so that `datasets.load_dataset(FOLDER)` decodes the pictures.
"""

import json
from typing import Any

import pyarrow as pa

from fusionnet.blocks import CLASS_NAMES
from fusionnet.errors import DataError

SCHEMA_VERSION = 2
"""Raised whenever a column is added, dropped, or means something else."""

VERSION_KEY = b"fusionnet.schema"
"""Key of the version in the metadata of each shard."""

_IMAGE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
_CELL = pa.list_(pa.int8(), 3)
_ALIGNMENTS = pa.list_(
    pa.struct([("leaf", pa.string()), ("value", pa.string()), ("tokens", pa.list_(pa.int32()))])
)
_VARIANT = pa.struct(
    [
        ("sentence", pa.string()),
        ("applied", pa.list_(pa.string())),
        ("tree", pa.string()),
        ("alignments", _ALIGNMENTS),
    ]
)
_MOVE = pa.struct(
    [("source", _CELL), ("target", _CELL), ("begins_held", pa.bool_()), ("ends_held", pa.bool_())]
)
_CAMERA = pa.struct(
    [
        ("name", pa.string()),
        ("kind", pa.string()),
        ("environment", pa.string()),
        ("matrix", pa.list_(pa.float64(), 9)),
        ("camera_from_board", pa.list_(pa.float64(), 16)),
    ]
)

COLUMNS: dict[str, tuple[pa.DataType, str]] = {
    "id": (pa.string(), "split and number; unique in the data set"),
    "image": (_IMAGE, "JPEG"),
    "width": (pa.int32(), "of the picture, in pixels"),
    "height": (pa.int32(), "of the picture, in pixels"),
    "boxes": (
        pa.list_(pa.list_(pa.float32(), 4)),
        "left, top, right, bottom edge [px] of the visible part of each block that is visible",
    ),
    "classes": (pa.list_(pa.int64()), "shape and colour of the block in each box"),
    "box_blocks": (pa.list_(pa.int32()), "which block of `before` each box belongs to"),
    "box_hidden": (pa.list_(pa.bool_()), "whether less than a quarter of the block is visible"),
    "masks": (
        pa.list_(pa.list_(pa.int64())),
        "visible pixels of the block in each box: COCO's uncompressed run lengths",
    ),
    "block_cells": (pa.list_(pa.int32()), "(8 x + y) 8 + z of the cell of each block of `before`"),
    "block_classes": (pa.list_(pa.int64()), "shape and colour of each block of `before`"),
    "block_pixels": (pa.list_(pa.int32()), "visible pixels of each block of `before`"),
    "block_shares": (pa.list_(pa.float32()), "visible share of each block of `before`, 0 to 1"),
    "block_offsets": (
        pa.list_(pa.list_(pa.float32(), 3)),
        "how far each block of `before` stands beside the middle of its cell along x and y of the "
        "board [m], and its turn about the vertical [rad]",
    ),
    "holding": (pa.bool_(), "whether the gripper holds a block before the move"),
    "sentence": (pa.string(), "what is asked"),
    "tree": (pa.string(), "its meaning in Robot Command Language, with word positions"),
    "alignments": (_ALIGNMENTS, "for each leaf of the tree the 1-based positions of its words"),
    "variants": (pa.list_(_VARIANT), "three perturbed sentences, each with its realigned tree"),
    "before": (pa.string(), "layout before, as JSON: blocks and gripper by cell"),
    "after": (pa.string(), "layout after, as JSON"),
    "move": (_MOVE, "cell of the moved block before and after, and whether it is held there"),
    "joints": (
        pa.list_(pa.float64()),
        "grasp angles, grasp gripper, place angles, place gripper [rad; gripper 0 to 1]",
    ),
    "joints_scaled": (pa.list_(pa.float64()), "the same, 0 at the lower limit to 1 at the upper"),
    "joint_limits": (pa.list_(pa.list_(pa.float64(), 2)), "the limits used for scaling"),
    "camera": (
        _CAMERA,
        "name; kind `eye` or `view`; intrinsics (row by row, whole numbers at pixels' centres); "
        "pose `camera_from_board` (row by row, metres)",
    ),
    "robot": (pa.string(), "name of the robot"),
    "noise": (pa.string(), "what was varied in the picture, as JSON"),
    "seed": (pa.int64(), "of everything random in this sample"),
    "origin": (pa.string(), "`recorded` in the corpus, or `varied` (layout varied or invented)"),
    "corpus": (pa.string(), "corpus of the sentence"),
    "group": (pa.int32(), "group of scenes in the corpus; none for varied layouts"),
    "scene": (pa.int64(), "number of the scene in the corpus; none for varied layouts"),
    "command": (pa.int64(), "number of the command in the corpus; none for varied layouts"),
}
"""Type and meaning of every column, in order."""

_CLASSES = ("classes", "block_classes")


def schema() -> pa.Schema:
    """The Arrow schema of a shard, with the Hugging Face features in its metadata."""
    features = {name: _feature(kind) for name, (kind, _) in COLUMNS.items()}
    features["image"] = {"_type": "Image"}
    for name in _CLASSES:
        features[name]["feature"] = {"names": list(CLASS_NAMES), "_type": "ClassLabel"}
    described = json.dumps({"info": {"features": features}})
    fields = [(name, kind) for name, (kind, _) in COLUMNS.items()]
    version = str(SCHEMA_VERSION).encode()
    return pa.schema(fields, metadata={b"huggingface": described.encode(), VERSION_KEY: version})


def check_version(metadata: dict[bytes, bytes] | None, name: str) -> None:
    """Accept a shard of this schema.

    Raises:
        DataError: If it is of another version, or of no FusionNet data set.
    """
    found = (metadata or {}).get(VERSION_KEY)
    if found is None:
        raise DataError(f"{name} is no shard of a FusionNet data set.")
    check_version_number(found.decode(errors="replace"), name)


def check_classes(metadata: dict[bytes, bytes] | None, name: str) -> None:
    """Accept a shard whose classes are ours, by name and in order.

    Raises:
        DataError: If they differ, the message says which; or if the metadata are damaged.
    """
    try:
        described = json.loads((metadata or {}).get(b"huggingface", b"{}"))
        features = described.get("info", {}).get("features", {})
        found = [features.get(column, {}).get("feature", {}).get("names") for column in _CLASSES]
        listed = [tuple(map(str, names)) for names in found if names is not None]
    except (ValueError, RecursionError, AttributeError, TypeError) as error:
        raise DataError(f"The metadata of {name} for `datasets` are damaged: {error}.") from error
    for names in listed:
        if names != CLASS_NAMES:
            strange = sorted(set(names) ^ set(CLASS_NAMES)) or ["another order"]
            raise DataError(
                f"The classes of {name} differ from this release's {len(CLASS_NAMES)} "
                f"({', '.join(strange[:4])}); expected {', '.join(CLASS_NAMES)}."
            )


def check_version_number(found: object, name: str) -> None:
    """Accept the version of this schema.

    Raises:
        DataError: If it is another; the message says what to do.
    """
    if str(found) != str(SCHEMA_VERSION):
        raise DataError(
            f"{name} has version {found} of the schema; this FusionNet reads version "
            f"{SCHEMA_VERSION}. Build the data set again, or install the FusionNet that wrote it."
        )


def _feature(kind: pa.DataType) -> Any:
    """The Hugging Face feature of an Arrow type."""
    if pa.types.is_struct(kind):
        return {kind.field(i).name: _feature(kind.field(i).type) for i in range(kind.num_fields)}
    if pa.types.is_fixed_size_list(kind):
        inner = _feature(kind.value_type)
        return {"feature": inner, "length": kind.list_size, "_type": "List"}
    if pa.types.is_list(kind):
        return {"feature": _feature(kind.value_type), "_type": "List"}
    names = {"double": "float64", "float": "float32"}
    return {"dtype": names.get(str(kind), str(kind)), "_type": "Value"}
