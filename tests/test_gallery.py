"""The page of failures: one card a failed episode, everything inside the one file."""

import dataclasses
import re
from html import escape

import numpy as np
import pytest

from fusionnet.apps.gallery import Gallery
from fusionnet.errors import PlanningError
from fusionnet.evaluation import policy as evaluation
from fusionnet.evaluation.policy import EpisodeRecord, PolicyEvaluation, PolicyReport, evaluate
from fusionnet.policy import Policy, load_policy


class Clumsy(Policy):
    """The shipped policy: its first answer places where it grasps, its second is a refusal."""

    def __init__(self):
        vars(self).update(vars(load_policy()))
        self.calls = 0

    def __call__(self, image, sentence):
        self.calls += 1
        if self.calls == 2:
            raise PlanningError("There is no <green> cube here.")
        answer = super().__call__(image, sentence)
        return dataclasses.replace(answer, place=answer.grasp, target_cell=answer.source_cell)


REACHED = EpisodeRecord(1, "reached", "", 0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def watched():
    gallery = Gallery()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "load_policy", lambda *_, **__: Clumsy())
        report = evaluate(PolicyEvaluation(corpus="examples", episodes=2), watch=gallery)
    return gallery, report


def test_failures_are_watched_with_what_they_came_from(watched):
    gallery, report = watched
    assert gallery.episodes == 2 and len(gallery.failures) == 2
    first, second = gallery.failures
    assert first.answer is not None and second.answer is None
    assert [w.record for w in gallery.failures] == report.records
    assert first.record.outcome in ("pointed wrong", "saw wrong", "read wrong")
    assert first.image.dtype == np.uint8 and first.image.ndim == 3


def test_the_page_has_a_card_a_failure_and_needs_nothing_else(watched):
    gallery, report = watched
    page = gallery.page(report.as_json())
    assert page.count('<section class="card">') == 2
    assert "2 of 2 episodes failed" in page and "There is no &lt;green&gt; cube here." in page
    for failure in gallery.failures:
        assert escape(failure.command.sentence) in page and failure.record.outcome in page
    assert page.count("data:image/webp;base64,") == 2 and page.count("<svg") == 3
    outside = re.findall(r'(?:src|href)="(?!data:)([^"]*)"', page)
    assert not outside and "<script" not in page


def test_without_failures_the_page_says_so():
    report = PolicyReport(PolicyEvaluation(strength=0.25), [REACHED])
    page = Gallery().page(report.as_json())
    assert "Nothing failed" in page and "<li>strength <b>0.25</b></li>" in page
