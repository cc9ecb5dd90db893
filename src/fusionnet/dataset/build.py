"""Build a data set: every missing shard, by any number of processes or a cluster.

A shard depends on the plan, the corpus and the views alone, so one worker, two or a cluster
give the same bytes. Shards are written aside and renamed: a build that was killed goes on
with the shards that are missing.
"""

import logging
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed, parallel_config

from fusionnet.corpora import load_corpus
from fusionnet.dataset.card import card
from fusionnet.dataset.folder import building, finish, read_records, write_record
from fusionnet.dataset.plan import BuildPlan, counts_for
from fusionnet.dataset.sample import make_sample
from fusionnet.dataset.shards import ShardRecord, record_of, write_shard
from fusionnet.dataset.sources import Sources, check_plan, corpus_digest, studio, views_digest
from fusionnet.errors import DataError, InputError, OutputError

Progress = Callable[[int, int], None]
"""Called with samples done and samples in all."""

_GENERATOR = "generator_unordered"
_PATIENCE = 10.0
"""Seconds in which a cluster must answer."""

_AT_ONCE = 8
"""Shards that each worker of a cluster is given before the next are handed out."""


def plan_for(scale: str, corpus: str, sources: Sources, **options: Any) -> BuildPlan:
    """The plan of a data set of some scale, with the digests of what it is made from.

    Args:
        scale: smoke, small, thesis, or a number of training samples.
        corpus: Name of the corpus.
        sources: Where its data and the views lie.
        options: Further fields of `BuildPlan`.

    Raises:
        InputError: If the scale is unknown, an option is out of range, or there are no views
            for training or for validation.
        DataError: If the corpus or the views are missing or damaged.
    """
    views = sources.environmental_views()
    names = tuple(tuple(v.name for v in views if v.part == part) for part in ("train", "val"))
    if views and not all(names):
        raise InputError(
            f"The views {sources.views} have {len(names[0])} for training and {len(names[1])} for "
            "validation; at least one of each is needed."
        )
    return BuildPlan(
        counts=tuple(counts_for(scale, views=bool(views)).items()),
        corpus=corpus,
        corpus_digest=corpus_digest(load_corpus(corpus, sources.data)),
        views=(names[0], names[1]),
        views_digest=views_digest(views),
        **options,
    )


def build(
    out: Path,
    plan: BuildPlan,
    sources: Sources,
    *,
    workers: int = 1,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> list[ShardRecord]:
    """Make every shard that is missing, and then the card and the checksums.

    Args:
        out: The data set; a new folder, or one of the same plan to go on with.
        plan: What to build.
        sources: Where its data lies; on a cluster every node must see it, and `out`, there.
        workers: Processes on this machine.
        cluster: Address of a Ray cluster that does the work instead ("auto" for the one here).
        progress: Called with samples done and samples in all.

    Returns:
        The records of the shards that were made now.

    Raises:
        InputError: If `out` holds something else, the corpus has no commands for a split, or the
            cluster cannot be reached.
        UnknownNameError: If there is no such robot, or it has no such eye.
        OutputError: If a shard cannot be written; finished ones are kept.
        DataError: If the corpus or the views are missing, damaged, or not those of the plan.
        RenderingError: If pictures cannot be rendered here.
    """
    if workers < 1:
        raise InputError(f"At least one worker is needed; received {workers}.")
    out, sources = out.resolve(), sources.absolute()
    check_plan(plan, sources)
    with building(out, plan):
        records = _finished(out, plan)
        missing = [s for s in plan.shards if plan.file(*s) not in records]
        total = sum(count for _, count in plan.counts)
        done = total - sum(len(plan.rows(*shard)) for shard in missing)
        made = []
        with _workers(workers, cluster):
            tasks = (delayed(make_shard)(out, plan, sources, *shard) for shard in missing)
            for record in _results(tasks, local=cluster is None):
                records[record.file] = record
                made.append(record)
                done += record.rows
                if progress is not None:
                    progress(done, total)
        finish(out, records, card(plan, records))
        return made


def make_shard(
    out: Path, plan: BuildPlan, sources: Sources, split: str, number: int
) -> ShardRecord:
    """Make one shard; this is what a worker does."""
    here = studio(plan, sources)
    rows = []
    for index in plan.rows(split, number):
        recipe = here.recipes.recipe(split, index)
        rows.append(make_sample(recipe, here.shot(recipe), plan.robot, plan.quality))
    record = write_shard(out, plan.file(split, number), rows)
    write_record(out, record)
    return record


def _finished(out: Path, plan: BuildPlan) -> dict[str, ShardRecord]:
    """The records of the shards that are there; one that was cut short is not."""
    known = read_records(out)
    found = {}
    for shard in plan.shards:
        name = plan.file(*shard)
        file = out / name
        if not file.exists():
            continue
        if name not in known:  # killed between the shard and its record
            try:
                known[name] = record_of(out, name)
            except DataError:
                continue
        if file.stat().st_size == known[name].bytes:
            found[name] = known[name]
    return found


@contextmanager
def _workers(workers: int, cluster: str | None) -> Iterator[None]:
    """Processes of this machine, or of a Ray cluster."""
    if cluster is None:
        with parallel_config(backend="loky", n_jobs=workers, inner_max_num_threads=1):
            yield
        return
    try:
        import ray
        from ray.util.joblib import register_ray
    except ImportError as error:
        raise InputError(
            "A cluster needs Ray, which is not installed: pip install 'fusionnet[cluster]'."
        ) from error
    started = not ray.is_initialized()
    try:
        if cluster != "auto":  # Ray itself waits for minutes
            host, _, port = cluster.removeprefix("ray://").rpartition(":")
            socket.create_connection((host, int(port)), timeout=_PATIENCE).close()
        if started:
            ray.init(address=cluster, logging_level=logging.WARNING, log_to_driver=False)
    except (OSError, ValueError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(f"No Ray cluster answers at {cluster!r}: {reason}") from error
    register_ray()
    try:
        with parallel_config(backend="ray", n_jobs=int(ray.cluster_resources()["CPU"])):
            yield
    finally:
        if started:
            ray.shutdown()


def _results(tasks: Iterator[Any], local: bool) -> Iterator[ShardRecord]:
    """Records as they come; what kills a worker becomes one clear line."""
    try:
        with Parallel(batch_size=1, return_as=_GENERATOR if local else "list") as parallel:
            if local:
                yield from parallel(tasks)
            else:  # Ray's backend gives lists only: some at a time, so that memory stays flat
                while chunk := list(islice(tasks, _AT_ONCE * parallel.n_jobs)):
                    yield from parallel(chunk)
    except (BrokenPipeError, EOFError) as error:
        raise _killed(error) from error
    except Exception as error:
        if type(error).__name__ in ("TerminatedWorkerError", "BrokenProcessPool", "RayActorError"):
            raise _killed(error) from error
        raise


def _killed(error: BaseException) -> OutputError:
    return OutputError(
        f"A worker was killed ({type(error).__name__}; perhaps memory ran out). Start the same "
        "build again, with fewer workers; finished shards are kept."
    )
