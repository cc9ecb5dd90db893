import dataclasses
import re

import pytest

from fusionnet.apps.cli import main
from fusionnet.evaluation.intervals import paired_difference
from fusionnet.experiments import Figure, Plan, reproduce
from fusionnet.report import html_page, markdown_page
from fusionnet.report.chapters import chapter
from fusionnet.report.figures import draw, draw_answer
from fusionnet.report.reading import multiplicity, reading, verdict_sentence
from toy_experiment import toy


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("toy")
    reproduce(toy(), Plan(scale="small", results=folder / "results", work=folder / "work"))
    return chapter(toy(), folder / "results")


def test_the_reading_says_what_is_best_and_how_often_the_thesis_is_borne_out(run):
    said = reading(run)
    assert "At the small scale, x2 has the best error" in said and "over 5 seeds" in said
    assert (
        "Of the thesis's claims it agrees with 1 of 3, differs from 1 of 3, cannot tell 1" in said
    )
    assert "holds zero over 5 seeds" in said


def test_the_best_is_one_that_was_repeated(run):
    lucky = dataclasses.replace(run.summaries[0], values=(-9.0,), mean=-9.0, low=-9.0, high=-9.0)
    tried = dataclasses.replace(run, summaries=(lucky, *run.summaries[1:]))
    assert "x2 has the best error" in reading(tried)


def test_a_verdict_is_printed_with_the_interval_that_decides_it(run):
    for judged in run.judgements:
        said = verdict_sentence(judged)
        low, high = map(float, re.search(r"t interval \[(\S+), (\S+)\]", said).groups())
        assert (low <= 0 <= high) == said.startswith("cannot tell"), said


def test_a_difference_of_few_seeds_needs_the_wide_interval_of_students_t():
    judged = paired_difference([1.0, 2.0, 3.0], [0.0, 0.0, 0.0])
    assert (judged.low, judged.high) == pytest.approx((-0.4841377, 4.4841377))
    assert not judged.clear and paired_difference([1.0, 1.1, 1.2], [0.0, 0.0, 0.0]).clear
    assert not paired_difference([1.0, 1.0], [0.0, 0.0]).clear


def test_the_report_says_how_many_verdicts_chance_gives(run):
    assert "Of 3 claims, each judged by itself at 95 %, 2 are borne out" in multiplicity([run])
    few = dataclasses.replace(run, judgements=())
    assert multiplicity([few]) == ""
    assert (
        multiplicity([run]) in html_page([run])
        and multiplicity([run]) in markdown_page([run], "")[0]
    )


def test_a_page_needs_no_other_file(run):
    page = html_page([run])
    assert page.count("<svg") == 1 and "<script" not in page
    assert not re.findall(r"""(?:src|href)=["'](?!#)(?!http://www\.w3\.org)""", page)
    assert "0 ± 0.1 (nowhere)" in page and "difference -1" in page
    assert ">the thesis<" in page and ">ours (small)<" in page


def test_markdown_names_every_figure_that_it_gives(run):
    text, figures = markdown_page([run], "results")
    assert set(re.findall(r"\(results/([^)]+)\)", text)) == set(figures) == {"toy-1.svg"}
    assert "| x2 | error | " in text


@pytest.mark.parametrize(
    "figure",
    [
        Figure(),
        Figure(logarithmic=True),
        Figure(kind="ranked"),
        Figure(kind="lines", x="x"),
        Figure(kind="scatter", x="x"),
        Figure(kind="curves", metric="loss"),
        Figure(kind="matrix", metric="table"),
        Figure(kind="matrix", metric="of no run"),
    ],
)
def test_every_kind_of_figure_is_drawn_the_same_twice(run, figure):
    assert draw(run, figure) == draw(run, figure)
    assert "NaN" not in draw(run, figure)


def test_an_interval_that_rounding_turned_over_is_drawn(run):
    one = run.summaries[0]
    turned = dataclasses.replace(one, low=one.mean + 1e-16, high=one.mean - 1e-16)
    chapter = dataclasses.replace(run, summaries=(turned,))
    for kind in ("bars", "lines", "scatter"):
        assert draw(chapter, Figure(kind=kind, x="x")).startswith("<svg")


def test_the_answer_shows_several_metrics(run):
    assert draw_answer(run, [("error", "error"), ("nothing", "")]).startswith("<svg")


def test_a_network_without_a_metric_has_no_panel_of_it(run):
    records = []
    for record in run.records:
        pointing = record.variant.name == "x2"
        values = {"network": "pointing" if pointing else "other"}
        variant = dataclasses.replace(record.variant, values=record.variant.values | values)
        metrics = record.metrics | ({"more": 1.0} if pointing else {})
        records.append(dataclasses.replace(record, variant=variant, metrics=metrics))
    some = dataclasses.replace(run, records=tuple(records))
    drawn = draw_answer(some, [("error", "error"), ("more", "share that is right")])
    assert drawn.count("share that is right") == 1


def test_what_was_not_run_says_how_to_run_it(tmp_path, capsys):
    missing = chapter(toy(), tmp_path)
    assert "fusionnet reproduce toy" in reading(missing)
    assert "toy" in html_page([missing])
    assert main(["report", "--results", str(tmp_path), "--out", str(tmp_path / "r.html")]) == 0
    typo = ["report", "--results", str(tmp_path / "typo"), "--out", str(tmp_path / "r.html")]
    before = (tmp_path / "r.html").read_bytes()
    assert main(typo) == 2 and (tmp_path / "r.html").read_bytes() == before
    assert (
        "There is no answer yet" in (tmp_path / "r.html").read_text()
        or "no answer yet" in (tmp_path / "r.html").read_text()
    )
    (tmp_path / "file").write_text("")
    assert main(["report", "--out", str(tmp_path / "file" / "r.html")]) == 2
