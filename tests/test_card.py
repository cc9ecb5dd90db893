"""Model cards: written by the code, understood by the hub, honest about data and licence."""

from pathlib import Path

import pytest
import torch
from huggingface_hub import ModelCard

from fusionnet.corpora import CATALOGUE, TERMS
from fusionnet.models.card import CARD_FILE, model_card, policy_card
from fusionnet.models.checkpoint import load_checkpoint, read_document, save_checkpoint
from fusionnet.models.fusionnet import FusionNet, compact
from fusionnet.models.policy_folder import PARTS, weights_folder
from fusionnet.models.retinanet import RetinaNet
from fusionnet.models.translator import Translator

COMPACT = weights_folder("compact")


def documents():
    return {part: read_document(COMPACT / part) for part in PARTS}


@pytest.mark.parametrize("part", PARTS)
def test_the_shipped_cards_are_what_the_code_writes(part):
    assert (COMPACT / part / CARD_FILE).read_text() == model_card(documents()[part])


def test_the_shipped_policy_card_is_what_the_code_writes():
    assert (COMPACT / CARD_FILE).read_text() == policy_card("compact", documents())


@pytest.mark.parametrize("card", sorted(COMPACT.rglob(CARD_FILE)), ids=lambda c: c.parent.name)
def test_the_hub_understands_licence_and_numbers(card):
    data = ModelCard.load(card).data
    assert data.license == "apache-2.0" and data.library_name == "fusionnet"
    assert data.eval_results
    for result in data.eval_results:
        assert result.dataset_name == "treebank" and 0 < result.metric_value <= 1
        assert result.dataset_split in ("val", "test")


def test_a_card_names_its_data_with_their_terms():
    text = (COMPACT / CARD_FILE).read_text()
    assert "SemEval-2014 task 6, free for research" in text and "synthetic commands" in text
    assert "all blocks are rendered" in text and "no sentence, tree, layout or picture" in text
    assert "Apache-2.0" in text


@pytest.mark.parametrize("corpus", CATALOGUE.names())
def test_every_corpus_states_its_terms(corpus):
    assert len(TERMS.load(corpus)) > 30


def test_weights_of_ones_own_state_no_licence(tmp_path):
    compact().save(tmp_path / "mine", {"training": {"corpus": "etr"}, "metrics": {"loss": 0.5}})
    text = (tmp_path / "mine" / CARD_FILE).read_text()
    assert ModelCard(text).data.license is None
    assert "No licence is stated" in text and "University of Leeds" in text and "| loss |" in text


def test_a_card_does_not_say_more_than_it_knows():
    text = model_card({"kind": "toy", "config": {}, "metadata": {"training": {"corpus": "mine"}}})
    assert "a checkpoint of the kind toy" in text and "`mine`: a corpus of which" in text
    assert "the checkpoint does not say" in model_card({"kind": "toy"})


@pytest.mark.parametrize(
    ("model", "part"), [(FusionNet, "fusion"), (RetinaNet, "detector"), (Translator, "translator")]
)
def test_whatever_is_saved_has_a_card(model, part, tmp_path: Path):
    metadata = load_checkpoint(COMPACT / part, read_document(COMPACT / part)["kind"]).metadata
    loaded = model.from_folder(COMPACT / part)
    given = {"metadata": metadata, "half": True} if model is Translator else {"metadata": metadata}
    loaded.save(tmp_path / part, **given)
    assert (tmp_path / part / CARD_FILE).read_text() == (COMPACT / part / CARD_FILE).read_text()


def test_a_checkpoint_that_is_replaced_gets_a_new_card(tmp_path):
    for corpus in ("etr", "synthetic"):
        save_checkpoint(
            tmp_path / "a",
            kind="toy",
            config={},
            tensors={"x": torch.zeros(1)},
            metadata={"training": {"corpus": corpus}},
        )
    assert "`synthetic`" in (tmp_path / "a" / CARD_FILE).read_text()
    assert sorted(file.name for file in (tmp_path / "a").iterdir()) == [
        "README.md",
        "config.json",
        "model.safetensors",
    ]
