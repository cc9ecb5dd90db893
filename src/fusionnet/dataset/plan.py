"""What a data set holds: how many samples of which split, from what, through which cameras.

The plan is stored with the data set. Together with the corpus and the views it determines
every byte.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from fusionnet.corpora import Part
from fusionnet.errors import DataError, InputError

SPLITS: Mapping[str, tuple[Part, str]] = {
    "train": ("train", "train"),
    "val": ("val", "val"),
    "test": ("test", "val"),
    "sim_val": ("val", "eyes"),
    "sim": ("test", "eyes"),
}
"""For each split the part of the corpus's groups and the part of the views (or the eyes)."""

SCALES: Mapping[str, Mapping[str, int]] = {
    "smoke": {"train": 24, "val": 8, "test": 8, "sim_val": 8, "sim": 8},
    "small": {"train": 2_000, "val": 200, "test": 200, "sim_val": 200, "sim": 200},
    "thesis": {"train": 30_000, "val": 3_750, "test": 3_750, "sim_val": 500, "sim": 500},
}
"""Samples by split. The thesis has 625 layouts in 15 views, clean and thrice noised: 37,500."""

_PLAIN = {str: (str,), bool: (bool,), int: (int,), float: (float, int)}
"""For the types of a plan's plain fields those that their JSON may have."""

LARGEST = 1_000_000_000
"""Training samples that may be asked for."""

MOST_SHARDS = 2_000_000
"""Files of a data set; the checksums of more could not be read."""


def counts_for(scale: str, views: bool) -> dict[str, int]:
    """Samples a split.

    Args:
        scale: smoke, small, thesis, or a number of training samples; every other split then
            gets a tenth of it, at least 1 and at most 1,000.
        views: Whether there are environmental views; without, only splits through the eyes.

    Raises:
        InputError: If the scale is none of these.
    """
    if scale in SCALES:
        counts = dict(SCALES[scale])
    elif scale.isascii() and scale.isdigit() and 0 < int(scale[:12]) <= LARGEST:
        tenth = min(max(int(scale) // 10, 1), 1_000)
        counts = {split: int(scale) if split == "train" else tenth for split in SPLITS}
    else:
        raise InputError(
            f"The scale {scale!r} is none of {', '.join(SCALES)} or a number of training "
            f"samples, 1 to {LARGEST}."
        )
    return {s: n for s, n in counts.items() if views or s == "train" or SPLITS[s][1] == "eyes"}


@dataclass(frozen=True, kw_only=True)
class BuildPlan:
    """What to build.

    Attributes:
        counts: Split and number of samples, in the order of `SPLITS`.
        corpus: Name of the corpus of scenes and sentences.
        corpus_digest: Of its commands, so that no other data is mixed in on resuming.
        views: Names of the environmental views: of training, of validation.
        views_digest: Of their pictures and poses; empty without views.
        robot: Name of the robot.
        eyes: Cameras of the robot that are used, by turns.
        eyes_share: Share of the training samples seen through the robot's eyes.
        varied: Share of the training samples whose layout is varied or invented.
        invented: Share of those whose layout is invented.
        displaced: Share of the training samples through the robot's eyes in which top blocks stand
            up to 1 cm beside the middle of their cells.
        noised: Share of the training samples in views with level-1 noise (thesis: 3 of 4).
        strength: Of that noise's displacements, 0 to 1; at 1, as in the thesis, blocks stray into
            the next cell (see `views.level_one`).
        sensor: Whether pictures with that noise are blurred, white balanced and grained, too.
        seed: Source of all randomness.
        size: Width and height of pictures, in pixels.
        quality: Of the JPEGs, 1 to 100.
        shard: Samples a file.
    """

    counts: tuple[tuple[str, int], ...]
    corpus: str
    corpus_digest: str
    views: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    views_digest: str = ""
    robot: str = "nico"
    eyes: tuple[str, ...] = ("left_eye",)
    eyes_share: float = 0.25
    varied: float = 0.0
    invented: float = 0.3
    displaced: float = 0.0
    noised: float = 0.75
    strength: float = 0.15
    sensor: bool = True
    seed: int = 0
    size: tuple[int, int] = (960, 540)
    quality: int = 90
    shard: int = 250

    def __post_init__(self) -> None:
        """Refuse what cannot be built."""
        for split, count in self.counts:
            if not 0 < count <= LARGEST:
                raise InputError(f"A split has 1 to {LARGEST} samples; {split!r} has {count}.")
        shares = ("eyes_share", "varied", "invented", "displaced", "noised", "strength")
        for name in shares:
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"{name} is a share, from 0 to 1; received {getattr(self, name)}.")
        if not 1 <= self.shard <= 10_000:
            raise InputError(f"A shard has 1 to 10000 samples; received {self.shard}.")
        files = sum(-(-count // self.shard) for _, count in self.counts)
        if files > MOST_SHARDS:
            raise InputError(
                f"A data set has up to {MOST_SHARDS} shards, not {files}; put more samples into "
                "each (--shard)."
            )
        if not 1 <= self.quality <= 100:
            raise InputError(f"The quality of a JPEG goes from 1 to 100; received {self.quality}.")
        if not all(32 <= side <= 4096 for side in self.size):
            raise InputError(f"A picture has 32 to 4096 pixels a side; received {self.size}.")
        if not self.eyes:
            raise InputError("At least one of the robot's cameras is needed.")

    @property
    def shards(self) -> list[tuple[str, int]]:
        """All shards: split, and number in the split."""
        return [(s, n) for s, count in self.counts for n in range(-(-count // self.shard))]

    def rows(self, split: str, number: int) -> range:
        """The samples of a shard, by their number in the split."""
        first = number * self.shard
        return range(first, min(first + self.shard, dict(self.counts)[split]))

    def file(self, split: str, number: int) -> str:
        """Path of a shard within the data set."""
        count = -(-dict(self.counts)[split] // self.shard)
        return f"data/{split}-{number:05d}-of-{count:05d}.parquet"

    def as_json(self) -> dict[str, Any]:
        """JSON values that rebuild it."""
        values = asdict(self)
        values["counts"] = dict(self.counts)
        values["views"] = {"train": list(self.views[0]), "val": list(self.views[1])}
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "BuildPlan":
        """The inverse of `as_json`.

        Raises:
            DataError: If the values are not those of a plan.
        """
        try:
            older = {"sensor": True, "displaced": 0.0}  # which older plans do not mention
            known = older | dict(values)
            read = {f.name: known[f.name] for f in fields(cls)}
            read["counts"] = tuple((str(s), int(n)) for s, n in read["counts"].items())
            read["views"] = (tuple(read["views"]["train"]), tuple(read["views"]["val"]))
            read["eyes"], read["size"] = tuple(read["eyes"]), tuple(map(int, read["size"]))
            for f in fields(cls):
                if f.type in _PLAIN and type(read[f.name]) not in _PLAIN[f.type]:
                    raise TypeError(f"{f.name} is {read[f.name]!r}")
            if len(read["size"]) != 2:
                raise ValueError(f"size is {read['size']}")
            unknown = {split for split, _ in read["counts"]} - set(SPLITS)
            if unknown:
                raise ValueError(f"unknown split {min(unknown)!r}")
            return cls(**read)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(f"This is no plan of a data set: {error!r}.") from error
