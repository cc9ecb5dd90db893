"""Sentences that another part of the corpus has as well are told from new ones."""

from dataclasses import replace

from fusionnet.corpora import load_corpus
from fusionnet.evaluation import translation
from fusionnet.evaluation.new_text import new_text
from fusionnet.evaluation.policy import EpisodeRecord, PolicyEvaluation, PolicyReport
from fusionnet.evaluation.translation import TranslationEvaluation
from tiny_treebank import write_tiny_treebank


def test_what_is_said_elsewhere_is_not_new():
    corpus = load_corpus("examples")
    first, second, *others = corpus.commands
    part = [
        replace(first, sentence="Take the RED cube."),
        replace(second, sentence="take the red cube carefully"),
    ]
    others[0] = replace(others[0], sentence="take the red cube")
    changed = replace(corpus, commands=(*part, *others))
    assert new_text(changed, part) == [False, True]
    assert all(new_text(changed, changed.commands))  # there is no other part


def test_typos_make_no_text_new(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(translation, "load_translator", lambda _: None)
    monkeypatch.setattr(
        translation,
        "measure",
        lambda translator, commands, beam, new: asked.append((commands, new)) or {"failures": []},
    )
    data = write_tiny_treebank(tmp_path)
    for perturbations in (0, 4):
        config = TranslationEvaluation(data=data, split="test", perturbations=perturbations)
        translation.evaluate(config)
    (commands, clean), (changed, noisy) = asked
    assert [c.sentence for c in commands] != [c.sentence for c in changed]
    assert clean == noisy and not all(clean)


def test_each_command_counts_once():
    rows = [(1, "reached"), (2, "read wrong"), (1, "slipped"), (2, "read wrong")]
    records = [EpisodeRecord(c, o, "", 0.0, 0.0, 0.0, 1.0) for c, o in rows]
    numbers = PolicyReport(PolicyEvaluation(), records).as_json()
    assert numbers["executed_success"] == 0.25
    assert numbers["each_command_once"]["n"] == 2
    assert numbers["each_command_once"]["executed_success"] == 0.5
