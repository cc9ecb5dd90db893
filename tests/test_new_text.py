"""Sentences that another part of the corpus has as well are told from new ones."""

from dataclasses import replace

from fusionnet.corpora import load_corpus
from fusionnet.evaluation.new_text import new_text


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
