"""Shards: Parquet files that are there whole or not at all, each with its checksum.

Pictures are stored uncompressed (they are JPEGs) in small row groups, so that single
samples can be read from a memory map; everything else is compressed.
"""

import errno
import hashlib
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from fusionnet.dataset.schema import COLUMNS, check_classes, check_version, schema
from fusionnet.errors import DataError, OutputError

ROW_GROUP = 10
"""Samples a row group: what is read from disk at once."""


@dataclass(frozen=True, kw_only=True)
class ShardRecord:
    """What is known of a finished shard.

    Attributes:
        file: Path within the data set.
        rows: Samples in it.
        bytes: Its size.
        sha256: Its checksum.
    """

    file: str
    rows: int
    bytes: int
    sha256: str

    def as_json(self) -> dict[str, Any]:
        """As JSON values."""
        return asdict(self)


def write_shard(folder: Path, name: str, rows: Sequence[dict[str, Any]]) -> ShardRecord:
    """Write samples as one shard, aside first; the same samples give the same bytes.

    Args:
        folder: The data set.
        name: Path of the shard within it.
        rows: Values of all columns for each sample.

    Raises:
        OutputError: If it cannot be written; nothing half-written remains under its name.
    """
    file = folder / name
    aside = file.with_name(f".{file.name}.{os.getpid()}.part")
    table = pa.Table.from_pylist(list(rows), schema=schema())
    compression = {c: "ZSTD" for c in COLUMNS} | {"image": "NONE"}
    leaves = _leaf_compression(table.schema, compression)
    try:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with aside.open("wb") as stream:
                pq.write_table(
                    table,
                    stream,
                    row_group_size=ROW_GROUP,
                    compression=leaves,
                    use_dictionary=False,
                    write_statistics=False,
                    store_schema=True,
                )
                stream.flush()
                os.fsync(stream.fileno())
            record = record_of(folder, name, aside)
            os.replace(aside, file)
        finally:
            aside.unlink(missing_ok=True)
    except OSError as error:
        why = error.strerror or str(error)
        remedy = "Free some space" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "Mend that"
        raise OutputError(
            f"The shard {file} cannot be written: {why}. {remedy} and start the same build "
            "again; finished shards are kept."
        ) from error
    return record


def record_of(folder: Path, name: str, file: Path | None = None) -> ShardRecord:
    """What is known of a shard, read anew from disk.

    Raises:
        DataError: If it is missing or damaged.
    """
    file = file or folder / name
    with open_shard(file) as opened:
        rows = opened.metadata.num_rows
    digest = hashlib.sha256()
    with file.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return ShardRecord(file=name, rows=rows, bytes=file.stat().st_size, sha256=digest.hexdigest())


def open_shard(file: Path) -> pq.ParquetFile:
    """A shard, memory-mapped, after a look at its version.

    Raises:
        DataError: If it is missing, cut short, of another schema, or has other classes.
    """
    try:
        opened = pq.ParquetFile(file, memory_map=True)
    except FileNotFoundError:
        raise DataError(f"The shard {file} is missing; build the data set again to make it.") from (
            None
        )
    except (OSError, pa.ArrowException) as error:
        raise damaged(file, error) from error
    check_version(opened.schema_arrow.metadata, str(file))
    check_classes(opened.schema_arrow.metadata, str(file))
    return opened


def damaged(file: Path, error: Exception) -> DataError:
    """The error that names a damaged shard and what to do."""
    return DataError(
        f"The shard {file} is damaged ({_short(error)}); delete it and start the same build again: "
        "only this shard is made anew."
    )


def _short(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return (text[0] if text else type(error).__name__)[:160].rstrip(".")


def _leaf_compression(written: pa.Schema, wanted: dict[str, str]) -> dict[str, str]:
    """Compression by leaf of the nested columns, as Parquet's writer wants it."""
    return {
        leaf: wanted[leaf.partition(".")[0]]
        for field in written
        for leaf in _leaves(field.name, field.type)
    }


def _leaves(path: str, kind: pa.DataType) -> list[str]:
    if pa.types.is_struct(kind):
        parts = [kind.field(i) for i in range(kind.num_fields)]
        return [leaf for part in parts for leaf in _leaves(f"{path}.{part.name}", part.type)]
    if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        return _leaves(f"{path}.list.element", kind.value_type)
    return [path]
