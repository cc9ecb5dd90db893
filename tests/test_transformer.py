"""The thesis's Transformer: its sizes, masks and cache, decoding, training, checkpoints."""

import contextlib
import itertools
import json
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.apps import cli
from fusionnet.corpora import load_corpus
from fusionnet.errors import CheckpointError, DataError, InputError, NotUnderstoodError
from fusionnet.evaluation.translation import TranslationEvaluation, evaluate
from fusionnet.models.target_text import text_of
from fusionnet.models.transformer import END, START, Transformer
from fusionnet.models.transformer_config import TransformerConfig, base, thesis
from fusionnet.models.transformer_network import TransformerNetwork, positions
from fusionnet.models.translators import load_translator
from fusionnet.rcl import format, parse
from fusionnet.sentences import PADDING, UNKNOWN, tokenize
from fusionnet.training.loop import LoopConfig
from fusionnet.training.optimizers import OptimizerConfig
from fusionnet.training.schedules import Schedule, ScheduleConfig
from fusionnet.training.transformer import (
    ThesisTranslatorConfig,
    batches,
    measure,
    new_transformer,
    train,
)
from rcl_trees import trees
from tiny_treebank import write_tiny_treebank

# Under test, beartype looks into containers by chance, also while trees are being drawn.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module")

TINY = TransformerConfig(
    source_words=20,
    target_words=12,
    embedding_size=10,
    layers=2,
    heads=3,
    attention_size=4,
    feed_forward_size=16,
    longest=30,
)
SOURCE = torch.tensor([[2, 5, 6, 7, 8], [3, 9, 4, 0, 0]])
GIVEN = torch.tensor([[2, 4, 5, 6, 7, 8, 9], [2, 9, 3, 4, 4, 5, 6]])


@pytest.fixture(scope="module")
def network() -> TransformerNetwork:
    with torch.random.fork_rng():
        torch.manual_seed(1)
        return TransformerNetwork(TINY).eval()


# --- the network -------------------------------------------------------------------------------


def test_the_presets_are_the_thesis_s_tables():
    small, best = base(400, 110), thesis(400, 110)
    assert (small.heads, small.layers, small.attention_size) == (2, 4, 12)
    assert (small.embedding_size, small.feed_forward_size, small.longest) == (50, 128, 200)
    assert (best.heads, best.layers, best.attention_size) == (4, 4, 12)
    assert (best.embedding_size, best.feed_forward_size, best.longest) == (50, 256, 200)
    assert small.dropout == best.dropout == 0.1 and best.fusion_nodes == 4
    made = TransformerNetwork(best)
    assert made.decoder[0].own.query.weight.shape == (48, 50)  # 50 is not divided by the heads
    assert made.output.out_features == 110 and made.fusion.out_features == 4
    assert made.decoder[3].wide_norm.eps == 1e-6


def test_a_training_run_is_the_thesis_s():
    config = ThesisTranslatorConfig()
    assert (config.loop.steps, config.batch, config.noised) == (32_000, 30, 3)
    assert config.embeddings == "skip-gram"
    adam = config.loop.optimizer
    assert (adam.kind, adam.beta_1, adam.beta_2, adam.epsilon) == ("adam", 0.9, 0.98, 1e-9)
    rate = thesis(3, 3).model_size ** -0.5
    schedule = Schedule(config.loop.schedule, peak=rate, steps=config.loop.steps)
    for step in (1, 4000, 9000):  # equation 4.1
        assert schedule.rate(step - 1) == pytest.approx(
            48**-0.5 * min(step**-0.5, step * 4000**-1.5)
        )


def test_weights_begin_as_glorot_says(network):
    for module in network.modules():
        if isinstance(module, torch.nn.Linear):
            bound = math.sqrt(6 / (module.in_features + module.out_features))
            assert module.weight.abs().max() <= bound
            assert module.bias is None or (module.bias == 0).all()
    assert (network.source_words.weight[PADDING] == 0).all()


def test_positions_are_waves():
    table = positions(40, 5)
    assert table[7, 0] == pytest.approx(math.sin(7))
    assert table[7, 1] == pytest.approx(math.cos(7))
    assert table[7, 3] == pytest.approx(math.cos(7 / 10_000 ** (2 / 5)))
    assert table[9, 4] == pytest.approx(math.sin(9 / 10_000 ** (4 / 5)))


def test_no_token_sees_what_follows_it(network):
    with torch.inference_mode():
        logits = network(SOURCE, GIVEN)
        changed = GIVEN.clone()
        changed[:, 4:] = 11
        other = network(SOURCE, changed)
    torch.testing.assert_close(logits[:, :4], other[:, :4])
    assert not torch.allclose(logits[:, 4], other[:, 4])


def test_a_sentence_is_read_alike_alone_and_among_longer_ones(network):
    with torch.inference_mode():
        together = network(SOURCE, GIVEN)[1]
        alone = network(SOURCE[1:, :3], GIVEN[1:])[0]
    torch.testing.assert_close(together, alone, atol=1e-5, rtol=1e-4)


def test_the_cache_changes_nothing_beyond_its_first_room(network):
    given = torch.randint(4, 12, (2, 29), generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        for rows in (1, 2):
            memory = network.encode(SOURCE[:rows])
            whole = network.output(network.decode(memory, given[:rows]))
            cache = network.start(memory)
            for place in range(given.shape[1]):
                logits, _, cache = network.step(given[:rows, place], cache, memory)
                torch.testing.assert_close(logits, whole[:, place], atol=1e-4, rtol=1e-4)


def test_the_cache_changes_nothing(network):
    with torch.inference_mode():
        memory = network.encode(SOURCE)
        whole = network.output(network.decode(memory, GIVEN))
        cache = network.start(memory)
        for place in range(GIVEN.shape[1]):
            logits, scores, cache = network.step(GIVEN[:, place], cache, memory)
            torch.testing.assert_close(logits, whole[:, place], atol=1e-5, rtol=1e-4)
    assert scores.shape == (2, 3, 5)
    assert (scores.softmax(-1)[1, :, 3:] == 0).all()  # padding is not looked at


def test_dropout_stands_on_the_sum_and_before_every_normalisation(network):
    """Where it is certain, what reaches each normalisation is the residual alone."""
    sure = TransformerNetwork(replace(TINY, dropout=0.5))
    for module in sure.modules():
        if isinstance(module, torch.nn.Dropout):
            module.p = 1.0
        elif isinstance(module, torch.nn.Linear) and module.bias is not None:
            torch.nn.init.normal_(module.bias)
    sure.train()
    found = sure.decode(sure.encode(SOURCE), GIVEN)
    assert torch.isfinite(found).all()
    torch.testing.assert_close(found, torch.zeros_like(found))  # the norm of nothing is its bias


def test_the_fusion_sublayer_is_the_output_layer_with_few_nodes(network):
    with torch.inference_mode():
        given = GIVEN.clone()
        given[1, 5:] = PADDING
        decoded = network.decode(network.encode(SOURCE), given)
        nodes = network.nodes(decoded, given)
        assert nodes.shape == (2, 30, 4)
        torch.testing.assert_close(nodes[0, :7], network.fusion(decoded[0]))
    assert (nodes[1, 5:] == 0).all() and (nodes[0, 7:] == 0).all()
    network(SOURCE, GIVEN).sum().backward()
    assert network.fusion.weight.grad is None  # its loss is FusionNet's alone
    network.zero_grad()


@pytest.mark.parametrize(
    "changed", [{"heads": 0}, {"embedding_size": -4}, {"dropout": 1.0}, {"dropout": -0.1}]
)
def test_sizes_that_build_nothing_are_refused(changed):
    with pytest.raises(CheckpointError, match="got"):
        replace(TINY, **changed)


# --- tokens ------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(trees)
def test_a_tree_is_its_tokens(tree):
    tokens = [token.text for token in tokenize(format(tree))]
    assert parse(text_of(tokens)) == tree
    assert format(parse(text_of(tokens))) == format(tree)
    assert text_of([]) == ""


# --- training and translating ------------------------------------------------------------------


def tiny_config(folder: Path, **changed) -> ThesisTranslatorConfig:
    how = {
        "out": folder / "checkpoint",
        "work": folder / "work",
        "data": folder / "data",
        "embeddings": "random",
        "embedding_size": 30,
        "layers": 1,
        "heads": 2,
        "attention_size": 8,
        "feed_forward_size": 32,
        "longest": 90,
        "dropout": 0.0,
        "batch": 16,
        "least": 1,
        "loop": LoopConfig(
            steps=250,
            learning_rate=2.0,
            schedule=ScheduleConfig(kind="inverse-root", warm_up_steps=100),
            optimizer=OptimizerConfig(kind="adam", weight_decay=0.0, beta_2=0.98, epsilon=1e-9),
            clip=0.0,
            tensorboard=False,
        ),
    }
    return ThesisTranslatorConfig(**how | changed)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with a tiny treebank and a Transformer that has learnt it."""
    folder = tmp_path_factory.mktemp("transformer")
    write_tiny_treebank(folder / "data")
    metrics = train(tiny_config(folder, noised=1))
    (folder / "metrics.json").write_text(json.dumps(metrics))
    return folder


@pytest.fixture(scope="module")
def translator(folder) -> Transformer:
    found = load_translator(folder / "checkpoint")
    assert isinstance(found, Transformer)
    return found


def test_a_few_sentences_are_learnt(folder, translator):
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["commands"] == 24 and metrics["pairs"] == 48
    assert metrics["word_accuracy"] > 0.99 and metrics["cross_entropy"] < 0.1
    assert metrics["sentence_accuracy"] > 0.9  # the same sentences in other scenes
    commands = load_corpus("treebank", folder / "data").commands
    assert measure(translator, commands, beam=4)["sentence_accuracy"] > 0.9
    best = translator.translate(commands[0].sentence)[0]
    assert format(best.tree) == format(commands[0].tree)
    assert best.attention.shape == (len(best.symbols), len(best.words))
    np.testing.assert_allclose(best.attention.sum(1), 1, atol=1e-5)


def test_it_answers_where_the_shipped_translator_does(folder, translator, capsys):
    measured = evaluate(
        TranslationEvaluation(data=folder / "data", split="test", checkpoint=folder / "checkpoint")
    )
    assert measured["exact"] == measured["exact_with_alignments"] > 0.9
    words = ["--checkpoint", str(folder / "checkpoint")]
    assert cli.main(["translate", "move the red cube onto the blue cube", *words]) == 0
    assert "Move the red cube onto the blue cube." in capsys.readouterr().out
    many = translator.translate_many(["put the red cube onto the green cube", "why", ""])
    assert many[0][0].tree == translator.translate("put the red cube onto the green cube")[0].tree
    assert all(isinstance(answer, NotUnderstoodError) for answer in many[1:])
    features = translator.features("move the red cube onto the blue cube")
    assert features.ndim == 2 and features.shape[1] == 4 and torch.isfinite(features).all()


def test_greedy_decoding_takes_the_most_probable_token(translator):
    row = "put the blue cube onto the red cube".split()
    [[found]] = translator.hypotheses([row])
    given, wanted = translator.targets([translator.written(found)])
    with torch.inference_mode():
        source = torch.tensor([[translator.source.number(word) for word in row]])
        gains = translator.network(source, given)[0]
    gains = gains.clone()
    gains[:, [PADDING, UNKNOWN, translator.alphabet.start]] = -torch.inf
    assert (gains.argmax(-1) == wanted[0]).all()
    total = gains.log_softmax(-1).gather(1, wanted[0].unsqueeze(1)).sum()
    assert found.log_probability == pytest.approx(float(total), abs=1e-3)


@pytest.mark.parametrize("beam", [1, 2, 5, 12])
def test_beams_of_any_width_find_nothing_less_probable(translator, beam):
    rows = [f"move the {c} {s} onto it".split() for c, s in (("red", "cube"), ("odd", "pyramid"))]
    greedy = translator.hypotheses(rows)
    wide = translator.hypotheses(rows, beam=beam, count=min(beam, 3))
    for one, many in zip(greedy, wide, strict=True):
        totals = [h.log_probability for h in many]
        assert totals == sorted(totals, reverse=True)
        assert not one or totals[0] >= one[0].log_probability - 1e-4
    [alone] = translator.hypotheses(rows[:1], beam=beam)
    assert alone[0].numbers == wide[0][0].numbers


def test_batches_are_the_same_for_a_resumed_run_and_noise_is_in_the_source_alone(folder):
    config = tiny_config(folder, noised=3, least=2)
    commands = load_corpus("treebank", folder / "data").commands
    made, pairs = new_transformer(commands, config)
    assert len(pairs) == 4 * len(commands)
    for command, start in zip(commands, itertools.count(0, 4), strict=False):
        target = tuple(token.text for token in tokenize(format(command.tree)))
        assert all(pair.target == target for pair in pairs[start : start + 4])
        clean = tuple(token.text for token in tokenize(command.sentence))
        assert pairs[start].source == clean
        assert any(pair.source != clean for pair in pairs[start + 1 : start + 4])
    whole, resumed = (batches(pairs, made, config, first) for first in (0, 14))
    for _ in range(14):
        next(whole)
    for one, two in itertools.islice(zip(whole, resumed, strict=False), 5):
        assert torch.equal(one.source, two.source) and torch.equal(one.wanted, two.wanted)
        assert (one.given[:, 0] == made.target.number(START)).all()
        assert ((one.wanted == made.target.number(END)).sum(1) == 1).all()
    assert UNKNOWN in torch.cat([b.source.flatten() for b in itertools.islice(whole, 20)])


def test_embeddings_begin_with_word_vectors(folder):
    config = tiny_config(folder, embeddings="cbow", vector_epochs=2)
    commands = load_corpus("treebank", folder / "data").commands
    random, _ = new_transformer(commands, replace(config, embeddings="random"))
    filled, _ = new_transformer(commands, config)
    for name in ("source_words", "target_words"):
        one, two = (getattr(t.network, name).weight for t in (random, filled))
        assert one.shape == two.shape and not torch.allclose(one, two)
        assert (two[PADDING] == 0).all()
    torch.testing.assert_close(random.network.output.weight, filled.network.output.weight)


def test_english_may_be_written_instead(tmp_path):
    write_tiny_treebank(tmp_path / "data")
    loop = tiny_config(tmp_path).loop
    config = tiny_config(tmp_path, writes="english", noised=0, loop=replace(loop, steps=120))
    metrics = train(config)
    assert metrics["word_accuracy"] > 0.9 and metrics["sentence_accuracy"] > 0.4
    again = Transformer.from_folder(tmp_path / "checkpoint")
    assert again.writes == "english"
    with pytest.raises(InputError, match="not trees"):
        again.translate("move the red cube onto the blue cube")
    assert again.features("move the red cube onto the blue cube").shape[1] == 4


def test_of_several_processes_the_first_alone_measures_and_saves(tmp_path, monkeypatch):
    monkeypatch.setattr("fusionnet.training.transformer.is_first_process", lambda: False)
    write_tiny_treebank(tmp_path / "data")
    config = tiny_config(tmp_path, loop=LoopConfig(steps=1))
    assert train(config) == {} and not config.out.exists()


def test_what_cannot_be_learnt_is_refused(tmp_path):
    write_tiny_treebank(tmp_path / "data")
    with pytest.raises(DataError, match="fewer than 9 tokens"):
        train(tiny_config(tmp_path, longest=9))
    with pytest.raises(InputError, match="batch"):
        tiny_config(tmp_path, batch=0)


# --- checkpoints and refusals ------------------------------------------------------------------


def test_a_damaged_checkpoint_is_refused(translator, tmp_path, capsys):
    translator.save(tmp_path / "t", metadata={})
    file = tmp_path / "t" / "config.json"
    document = json.loads(file.read_text())
    assert str(tmp_path) not in json.dumps(document)
    for key, value, reason in (
        ("source", None, "no source vocabulary"),
        ("target", ["a", "a"], "once"),
        ("target", ["a"], "damaged"),
        ("writes", "french", "damaged"),
        ("network", {"colour": 3}, "does not fit"),
        ("network", {"source_words": -3, "target_words": 4}, "whole numbers"),
    ):
        changed = document | {"config": document["config"] | {key: value}}
        file.write_text(json.dumps(changed))
        with pytest.raises(CheckpointError, match=reason):
            load_translator(tmp_path / "t")
    file.write_text(json.dumps(document | {"kind": "retinanet"}))
    assert cli.main(["translate", "drop it", "--checkpoint", str(tmp_path / "t")]) == 2
    assert "expected one of: translator, transformer" in capsys.readouterr().err


ANYTHING = st.one_of(
    st.text(max_size=60),
    st.binary(max_size=40).map(lambda b: b.decode("utf-8", "surrogateescape")),
    st.lists(
        st.sampled_from("move put the red Blue cube onto pyramid , . ! 3 xyzzy green".split()),
        max_size=14,
    ).map(" ".join),
)


@settings(max_examples=50)
@given(ANYTHING)
def test_no_sentence_ends_in_a_traceback_or_takes_two_seconds(translator, sentence):
    began = time.process_time()
    try:
        readings = translator.translate(sentence)
    except NotUnderstoodError as error:
        assert "\n" not in str(error)
    else:
        for reading in readings:
            assert parse(format(reading.tree)) == reading.tree
            assert reading.attention.shape == (len(reading.symbols), len(reading.words))
    assert time.process_time() - began < 2


@pytest.mark.parametrize(
    "sentence",
    ["and " * 200, "move the red cube onto the blue cube " * 25, "x!" * 100, "!" * 3999 + "x"],
    ids=["and", "good", "marks", "too many marks"],
)
def test_the_longest_sentences_take_less_than_two_seconds(sentence):
    """Of the thesis's own size, untrained, so that every run is followed to its end."""
    config = ThesisTranslatorConfig(embeddings="random", corpus="examples", least=1)
    made, _ = new_transformer(load_corpus("examples").commands, config)
    began = time.process_time()
    with contextlib.suppress(NotUnderstoodError):
        made.translate(sentence)
    assert time.process_time() - began < 2
