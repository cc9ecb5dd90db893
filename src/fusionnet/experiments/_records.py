"""One whole JSON file a run: what was run, on what, how long, and what came out."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from fusionnet.errors import DataError
from fusionnet.experiments._experiment import Outcome, Trial, Variant
from fusionnet.files import write_whole
from fusionnet.provenance import provenance

SCHEMA = 1
"""Version of the files; raised when their meaning changes."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """A finished run.

    Attributes:
        experiment, scale, seed: Of the trial.
        variant: Its name, values and label.
        command: Makes this run again, and those beside it.
        metrics, configuration, curves, details: Of the outcome.
        seconds: Wall time.
        provenance: Commit, versions, machine.
        setup: How the run differed from the thesis's, in the experiment's words of its time;
            empty in records from before these were kept.
    """

    experiment: str
    scale: str
    seed: int
    variant: Variant
    command: str
    metrics: dict[str, float]
    configuration: dict[str, Any]
    curves: dict[str, list[float]]
    details: dict[str, Any]
    seconds: float
    provenance: dict[str, Any]
    setup: str = ""


def record_file(results: Path, trial: Trial) -> Path:
    """Where a trial's record is kept."""
    name = f"{trial.variant.name}-seed{trial.seed}.json"
    return results / trial.experiment / trial.scale / name


def write_record(
    file: Path, trial: Trial, outcome: Outcome, seconds: float, setup: str = ""
) -> Record:
    """Write a run's record, whole or not at all.

    Raises:
        ValueError: If a metric is no finite number.
        OutputError: If it cannot be written.
    """
    lost = [name for name, value in outcome.metrics.items() if not isfinite(value)]
    if lost:
        raise ValueError(f"{trial.variant.name} measured no finite {', '.join(lost)}")
    record = Record(
        experiment=trial.experiment,
        scale=trial.scale,
        seed=trial.seed,
        variant=trial.variant,
        command=f"fusionnet reproduce {trial.experiment} --scale {trial.scale}",
        configuration=dict(outcome.configuration),
        metrics={name: float(value) for name, value in outcome.metrics.items()},
        curves={name: [float(v) for v in values] for name, values in outcome.curves.items()},
        details=dict(outcome.details),
        seconds=round(seconds, 2),
        provenance=provenance(),
        setup=setup,
    )
    lines = [
        f"{json.dumps(name)}: {json.dumps(value)}"
        for name, value in {"schema": SCHEMA, **asdict(record)}.items()
    ]
    write_whole(file, "{\n" + ",\n".join(lines) + "\n}\n")
    return record


def read_record(file: Path) -> Record:
    """Read one record.

    Raises:
        DataError: If it is damaged or of another version; the message names the file.
    """
    try:
        values = json.loads(file.read_text("utf-8"))
        schema = values.pop("schema", None)
        if schema != SCHEMA:
            raise DataError(f"{file} has schema {schema}; this version reads {SCHEMA}. Run again.")
        return Record(**{**values, "variant": Variant(**values["variant"])})
    except (OSError, ValueError, KeyError, TypeError, AssertionError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(
            f"{file} is not a whole record ({error}); delete it and run again."
        ) from error


def of_one_setup(records: Sequence[Record], today: str) -> list[Record]:
    """The records that may stand in one mean: those of today's set-up, or else of the commonest.

    Args:
        records: Of an experiment at a scale.
        today: The set-up in the experiment's words now; records without any count as made by it.
    """
    counts = Counter(record.setup or today for record in records)
    kept = today if today in counts else max(counts, key=lambda text: counts[text], default=today)
    return [record for record in records if (record.setup or today) == kept]


def read_records(results: Path, experiment: str, scale: str) -> list[Record]:
    """All finished runs of an experiment at a scale, by variant and seed."""
    return list(_records(results / experiment / scale))


def _records(folder: Path) -> Iterator[Record]:
    for file in sorted(folder.glob("*.json")):
        yield read_record(file)
