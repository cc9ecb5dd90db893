"""How long the thesis's data set takes to build and to check, from a measured tenth of it.

    MUJOCO_GL=egl OMP_NUM_THREADS=1 python benchmarks/dataset_scale.py --data DIR > FILE

Prints JSON. A data set in the shipped views with a tenth of the thesis's training samples is
built by two workers and then checked, label by label, by one process: seconds by the clock, and
of the processor, all workers included. What the whole thesis scale takes is extrapolated.
"""

import json
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from fusionnet.dataset.build import build, plan_for
from fusionnet.dataset.check import check
from fusionnet.dataset.plan import SCALES
from fusionnet.dataset.sources import Sources
from fusionnet.provenance import provenance


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to build, and with how many hands.

    Attributes:
        samples: For training; every other split gets a tenth of it.
        workers: Processes.
        corpus: Where layouts and sentences come from.
        data: Folder of the corpus.
        views: Environmental views.
        seed: Everything random derives from it.
    """

    samples: int = SCALES["thesis"]["train"] // 10
    workers: int = 2
    corpus: str = "treebank"
    data: Path | None = None
    views: str = "rooms"
    seed: int = 0


def processor_seconds() -> float:
    """Used so far by this process and by all that it started and that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def measure(config: Config) -> dict[str, Any]:
    """Build it, check it, and reckon with the thesis's number of samples."""
    from joblib.externals.loky import get_reusable_executor

    sources = Sources(data=config.data, views=config.views)
    plan = plan_for(str(config.samples), config.corpus, sources, seed=config.seed)
    total = sum(count for _, count in plan.counts)
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "set"
        began, used = time.perf_counter(), processor_seconds()
        records = build(out, plan, sources, workers=config.workers)
        clock = time.perf_counter() - began
        get_reusable_executor().shutdown(wait=True)  # a worker's time counts once it has ended
        processor = processor_seconds() - used
        began = time.process_time()
        faults = check(out)
        checking = time.process_time() - began
    megabytes = sum(record.bytes for record in records) / 1e6
    whole = sum(SCALES["thesis"].values())
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return {
        "samples": dict(plan.counts),
        "files": len(records),
        "megabytes": round(megabytes, 1),
        "workers": config.workers,
        "seconds_by_the_clock": round(clock, 1),
        "seconds_of_processor": round(processor, 1),
        "milliseconds_of_processor_a_sample": round(1000 * processor / total, 1),
        "peak_megabytes_of_a_worker": round(peak),
        "faults": len(faults),
        "seconds_of_processor_to_check_all_labels": round(checking, 1),
        "thesis_extrapolated": {
            "samples": whole,
            "minutes_by_the_clock": round(clock / total * whole / 60, 1),
            "minutes_of_processor": round(processor / total * whole / 60, 1),
            "gigabytes": round(megabytes / total * whole / 1000, 2),
        },
        "command": f"python benchmarks/dataset_scale.py --samples {config.samples} --data DIR",
        "seed": config.seed,
        **provenance(),
    }


if __name__ == "__main__":
    print(json.dumps(measure(tyro.cli(Config)), indent=1))
