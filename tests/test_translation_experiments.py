"""What the experiments of chapter 5 measure of a Transformer's translations."""

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from fusionnet import experiments
from fusionnet.corpora import synthetic
from fusionnet.experiments import Trial, Variant, final_model
from fusionnet.experiments.translation import decoded, on_words, wrong_tokens
from fusionnet.models.beam_search import Hypothesis
from fusionnet.models.transformer import Transformer
from fusionnet.rcl import format
from fusionnet.sentences import tokenize
from fusionnet.training import thesis_fusion
from fusionnet.training.thesis_fusion_config import SmallThesisFusionConfig
from fusionnet.training.transformer import ThesisTranslatorConfig, new_transformer

COMMANDS = synthetic.read(size=6).commands


@pytest.fixture
def untrained():
    config = ThesisTranslatorConfig(embeddings="random", layers=1, least=1)
    return new_transformer(COMMANDS, config)[0]


def test_attention_counts_on_the_words_that_a_value_is_said_by():
    tokens = "( action : take ( token : 1 2 ) ) ( type : cube ( token : 4 ) )".split()
    attention = np.full((len(tokens), 2, 5), 0.2)
    attention[tokens.index("take")] = [[0.5, 0.3, 0.1, 0.1, 0.0], [0.5, 0.1, 0.4, 0.0, 0.0]]
    attention[tokens.index("cube")] = [[0.0, 0.0, 0.0, 0.9, 0.1], [0.0, 0.0, 0.0, 0.5, 0.5]]
    found = list(on_words(Hypothesis((), 0.0, attention), tokens, 5))
    np.testing.assert_allclose(found, [(0.7, 2 / 5), (0.7, 1 / 5)])


def test_wrong_tokens_are_told_apart(untrained):
    """A network that always writes an opening bracket misses everything else."""
    with torch.no_grad():
        untrained.network.output.bias[untrained.target.number("(")] = 1e4
    tokens = [t.text for c in COMMANDS for t in tokenize(format(c.tree))]
    wrong = [t for t in tokens if t != "("] + ["<end>"] * len(COMMANDS)
    colors = "blue cyan red yellow green magenta gray white".split()
    measured = wrong_tokens(untrained, COMMANDS)
    assert measured["wrong_positions"] == pytest.approx(sum(map(str.isdigit, wrong)) / len(wrong))
    assert measured["wrong_colors"] == pytest.approx(sum(t in colors for t in wrong) / len(wrong))


def test_a_translation_counts_only_whole_but_for_positions_apart(untrained, monkeypatch):
    """Told what to write: the right trees, and one with another word's position."""
    texts = [format(command.tree) for command in COMMANDS]
    texts[0] = texts[0].replace("(token: 1)", "(token: 9)", 1).replace("(token: 1 2)", "(token: 9)")
    assert texts[0] != format(COMMANDS[0].tree)
    rows = [tuple(t.text for t in tokenize(text)) for text in texts]
    lengths = [len(tokenize(command.sentence)) for command in COMMANDS]

    def written(rows_, **_):
        return [
            [
                Hypothesis(
                    tuple(untrained.target.number(t) for t in row),
                    0.0,
                    np.full((len(row), 4, words), 1 / words),
                )
            ]
            for row, words in zip(rows, lengths, strict=True)
        ]

    monkeypatch.setattr(untrained, "hypotheses", written)
    measured = decoded(untrained, COMMANDS)
    assert measured["sentence_accuracy"] == pytest.approx(5 / 6)
    assert measured["without_positions"] == 1
    assert measured["attention_on_words"] == pytest.approx(measured["uniform_attention"], abs=0.02)


@pytest.mark.parametrize("name", ["layers", "regularization", "translation"])
def test_what_is_published_and_claimed_is_run_at_the_thesis_s_scale(name):
    experiment = experiments.load(name)
    names = {variant.name for variant in experiment.variants("thesis")}
    small = {variant.name for variant in experiment.variants("small")}
    assert len(names) == len(experiment.variants("thesis"))
    for stated in experiment.published:
        assert stated.variant in names & small
    for claim in experiment.claims:
        known = names if claim.source == "thesis" else small
        assert {claim.better, claim.worse} <= known | small
    for one, two in itertools.combinations(experiment.variants("thesis"), 2):
        assert replace(one, name="x", label="") != replace(two, name="x", label="")


@pytest.mark.parametrize("writes", ["rcl", "short"])
def test_the_final_models_transformer_says_what_it_writes(untrained, writes, tmp_path, monkeypatch):
    learnt = SimpleNamespace(
        transformer=untrained.network, source=untrained.source, target=untrained.target
    )
    recipe = SmallThesisFusionConfig(dataset=Path("set"), writes=writes)
    monkeypatch.setattr(final_model, "fusion_config", lambda *_, **__: recipe)
    monkeypatch.setattr(thesis_fusion, "run", lambda *_, **__: (learnt, [], {}))
    trial = Trial(
        experiment="final_model",
        variant=Variant(name="final", values={}),
        seed=0,
        scale="small",
        work=tmp_path,
    )
    folder = final_model._trained_transformer(trial)
    assert Transformer.from_folder(folder).writes == writes
