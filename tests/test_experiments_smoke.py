"""Every experiment, all its variants, at the smoke scale: without data, in seconds."""

import json
import math

import pytest

from fusionnet import experiments
from fusionnet.corpora import synthetic
from fusionnet.experiments import Plan, reproduce
from fusionnet.report import html_page
from fusionnet.report.chapters import chapter


@pytest.fixture(scope="session")
def work(tmp_path_factory):
    """Data sets that experiments share are made once."""
    return tmp_path_factory.mktemp("work")


@pytest.fixture(autouse=True)
def few_commands(monkeypatch):
    """Of which the data sets of this scale take a few dozen."""
    monkeypatch.setattr(synthetic, "CORPUS_SIZE", 300)


@pytest.mark.parametrize("name", experiments.names())
def test_an_experiment_runs_at_the_smoke_scale_and_is_reported(name, tmp_path, work):
    experiment = experiments.load(name)
    records = reproduce(experiment, Plan(scale="smoke", results=tmp_path / "results", work=work))
    assert {v.name for v in experiment.variants("smoke")} <= {r.variant.name for r in records}
    for record in records:
        assert {experiment.metric, "executed_success"} & set(record.metrics)
        assert all(math.isfinite(value) for value in record.metrics.values())
        json.dumps(record.configuration), json.dumps(record.details)
    for file in (tmp_path / "results").rglob("*.json"):
        assert file.stat().st_size < 60_000, "keep a run's record small"
    page = html_page([chapter(experiment, tmp_path / "results")])
    assert experiment.title.split(":")[0] in page and "<svg" in page
