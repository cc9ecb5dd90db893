"""Builds by a cluster, and builds that are killed: minutes long, run by hand."""

import os
import signal
import subprocess
import sys
import time

import pytest

from dataset_fixtures import digests, small_plan, small_sources
from fusionnet.dataset.build import build
from fusionnet.errors import InputError

pytestmark = pytest.mark.slow

COMMAND = """
import sys
from pathlib import Path
from dataset_fixtures import small_plan
from fusionnet.dataset.build import build
from fusionnet.dataset.sources import Sources
if __name__ == "__main__":
    sources = Sources(data=Path(sys.argv[2]), views=sys.argv[3])
    build(Path(sys.argv[1]), small_plan(sources, shard=2), sources, workers=2)
"""


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    return small_sources(tmp_path_factory.mktemp("sources"))


@pytest.mark.filterwarnings("default")  # Ray's own
def test_a_cluster_of_two_nodes_gives_the_same_bytes(tmp_path, sources):
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    plan = small_plan(sources)
    build(tmp_path / "alone", plan, sources)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    try:
        cluster.add_node(num_cpus=1)
        made = build(tmp_path / "cluster", plan, sources, cluster=cluster.address)
    finally:
        cluster.shutdown()
    assert len(made) == len(plan.shards)
    assert digests(tmp_path / "cluster") == digests(tmp_path / "alone")
    with pytest.raises(InputError, match="No Ray cluster answers at '127.0.0.1:1'"):
        build(tmp_path / "none", plan, sources, cluster="127.0.0.1:1")


def test_a_build_killed_again_and_again_ends_with_the_same_bytes(tmp_path, sources):
    plan = small_plan(sources, shard=2)
    build(tmp_path / "whole", plan, sources)
    folder = tmp_path / "killed"
    words = [sys.executable, "-c", COMMAND, str(folder), str(sources.data), str(sources.views)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    finished: set[str] = set()
    for number in range(1, 6):
        process = subprocess.Popen(words, env=environment, start_new_session=True)
        goal = min(len(finished) + number, len(plan.shards))
        end = time.monotonic() + 120
        while process.poll() is None and time.monotonic() < end:
            if len(list((folder / "data").glob("[a-z]*.parquet"))) >= goal:
                break
            time.sleep(0.01)
        # A kill between any two instructions, of the parent and of its workers.
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        there = {file.name for file in (folder / "data").glob("[a-z]*.parquet")}
        assert finished <= there, "a finished shard was lost"
        finished = there
    before = {f.name: f.stat().st_mtime_ns for f in (folder / "data").glob("[a-z]*.parquet")}
    build(folder, plan, sources, workers=2)
    after = {f.name: f.stat().st_mtime_ns for f in (folder / "data").glob("[a-z]*.parquet")}
    assert all(after[name] == moment for name, moment in before.items()), "made twice"
    assert digests(folder) == digests(tmp_path / "whole")
