"""The files of a data set beside its shards.

- `README.md`: the card, which also tells `datasets` the splits
- `plan.json`: schema version and plan
- `checksums.json`: all shards; written last, it says that the data set is whole
- `data/train-00000-of-00008.parquet` ...: the shards
- `.records/`: one record a finished shard, while it is being built
"""

import fcntl
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fusionnet.dataset.plan import BuildPlan
from fusionnet.dataset.schema import SCHEMA_VERSION, check_version_number
from fusionnet.dataset.shards import ShardRecord
from fusionnet.errors import DataError, InputError, OutputError
from fusionnet.files import write_whole

CARD_FILE, PLAN_FILE, CHECKSUM_FILE = "README.md", "plan.json", "checksums.json"
_RECORDS, _LOCK = ".records", ".building"
LARGEST_FILE = 500_000_000
"""Bytes of JSON that are read; the checksums of 400,000 shards take 80 million."""


@contextmanager
def building(folder: Path, plan: BuildPlan) -> Iterator[None]:
    """The folder while it is being built to a plan, by nobody else.

    Raises:
        InputError: If the folder holds other files, or a data set of another plan.
        OutputError: If it cannot be written, or is being built by another process.
    """
    with _explained(folder):
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder} is a file; name a folder for the data set.")
        new = not (folder / PLAN_FILE).exists()
        if new and folder.exists() and any(f.name[0] != "." for f in folder.iterdir()):
            raise InputError(
                f"The folder {folder} holds other files; name a new one, or a data set to go "
                "on with."
            )
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / _LOCK).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise OutputError(f"Another process is building {folder}; wait for it.") from None
            if new:
                described = {"schema": SCHEMA_VERSION, "plan": plan.as_json()}
                write_whole(folder / PLAN_FILE, json.dumps(described, indent=1) + "\n")
            else:
                _check_same(folder, plan)
            for left in (folder / "data").glob(".*.part"):
                left.unlink()
            yield
            (folder / _LOCK).unlink(missing_ok=True)


def read_plan(folder: Path) -> BuildPlan:
    """The plan of a data set.

    Raises:
        DataError: If there is none, it is damaged, or of another schema.
    """
    document = _read_json(folder / PLAN_FILE, f"{folder} is no data set: it has no {PLAN_FILE}.")
    try:
        version, plan = document["schema"], document["plan"]
    except (KeyError, TypeError) as error:
        raise DataError(f"{folder / PLAN_FILE} is no plan of a data set.") from error
    check_version_number(version, f"The data set {folder}")
    return BuildPlan.from_json(plan)


def read_checksums(folder: Path) -> dict[str, ShardRecord]:
    """The records of all shards, by file.

    Raises:
        DataError: If the data set is not finished, or the file is damaged.
    """
    file = folder / CHECKSUM_FILE
    document = _read_json(
        file, f"The data set {folder} is not finished; start the same build again to go on."
    )
    try:
        for name, record in document.items():
            if type(record.get("rows")) is not int or type(record.get("bytes")) is not int:
                raise TypeError(f"rows and bytes of {name} are no numbers")
        return {name: ShardRecord(file=name, **record) for name, record in document.items()}
    except (TypeError, AttributeError) as error:
        raise DataError(f"{file} is damaged: {error}.") from error


def read_records(folder: Path) -> dict[str, ShardRecord]:
    """The records of the shards that are finished so far, by file."""
    records: dict[str, ShardRecord] = {}
    if (folder / CHECKSUM_FILE).exists():
        records |= read_checksums(folder)
    for file in (folder / _RECORDS).glob("*.json"):
        record = ShardRecord(**_read_json(file, f"{file} vanished."))
        records[record.file] = record
    return records


def write_record(folder: Path, record: ShardRecord) -> None:
    """Keep what is known of a finished shard until all are finished."""
    with _explained(folder):
        (folder / _RECORDS).mkdir(exist_ok=True)
        name = Path(record.file).with_suffix(".json").name
        write_whole(folder / _RECORDS / name, json.dumps(record.as_json()))


def finish(folder: Path, records: Mapping[str, ShardRecord], text: str) -> None:
    """Write the card and then the checksums; the data set is whole."""
    listed = {
        name: {k: v for k, v in records[name].as_json().items() if k != "file"}
        for name in sorted(records)
    }
    with _explained(folder):
        write_whole(folder / CARD_FILE, text)
        write_whole(folder / CHECKSUM_FILE, json.dumps(listed, indent=1) + "\n")
        shutil.rmtree(folder / _RECORDS, ignore_errors=True)


def _check_same(folder: Path, plan: BuildPlan) -> None:
    there = read_plan(folder).as_json()
    differing = [name for name, value in plan.as_json().items() if there[name] != value]
    if differing:
        name = differing[0]
        raise InputError(
            f"{folder} holds a data set of another plan: {name.replace('_', ' ')} is "
            f"{_short(there[name])} there and {_short(plan.as_json()[name])} here. Name a new "
            "folder, or give the same options as before."
        )


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _read_json(file: Path, missing: str) -> Any:
    try:
        with file.open("rb") as stream:
            content = stream.read(LARGEST_FILE)
        return json.loads(content)
    except FileNotFoundError:
        raise DataError(missing) from None
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{file} is damaged: {error}.") from error


@contextmanager
def _explained(folder: Path) -> Iterator[None]:
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"The data set {folder} cannot be written: {error.strerror or error}. Mend that and "
            "start the same build again; finished shards are kept."
        ) from error
