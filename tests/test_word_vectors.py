"""Word vectors: the thesis's tables, the same again for a seed, files that execute nothing."""

import json
from itertools import islice

import numpy as np
import pytest
from safetensors.numpy import save_file

from fusionnet.corpora import synthetic
from fusionnet.errors import DataError, InputError, OutputError, UnknownNameError
from fusionnet.sentences import PADDING, UNKNOWN, Vocabulary
from fusionnet.sentences.word_vectors import (
    WordVectorConfig,
    WordVectors,
    cbow,
    noised_sentences,
    skip_gram,
    train_word_vectors,
    tree_sentences,
)

FEW = WordVectorConfig(size=16, epochs=4)


@pytest.fixture(scope="module")
def sentences():
    return noised_sentences(islice(synthetic.commands(3), 150))


@pytest.fixture(scope="module")
def trained(sentences) -> WordVectors:
    return train_word_vectors(sentences, FEW)


def test_the_tables_of_the_thesis() -> None:
    assert cbow() == WordVectorConfig(
        model="cbow",
        size=50,
        epochs=200,
        negatives=5,
        negative_exponent=0.75,
        window=1 + 4 * 2,
        least=5,
        learning_rate=0.025,
        least_learning_rate=0.001,
        mean=True,
    )
    assert skip_gram().model == "skip-gram"


def test_a_sentence_and_its_three_variants_are_learnt_from(sentences) -> None:
    commands = list(islice(synthetic.commands(3), 2))
    assert len(sentences) == 4 * 150
    assert "".join(sentences[0]) == commands[0].sentence.replace(" ", "")
    assert all(sentences[i] != sentences[0] for i in (1, 2, 3))
    assert noised_sentences(commands) == sentences[:8]
    assert tree_sentences(commands)[0][:5] in (("(", "event", ":", "(", "action"),
                                               ("(", "sequence", ":", "(", "event"))  # fmt: skip


@pytest.mark.parametrize("model", ["skip-gram", "cbow"])
def test_a_seed_gives_the_same_vectors_again(sentences, trained, model) -> None:
    config = WordVectorConfig(model=model, size=16, epochs=2)
    seen = []
    one = train_word_vectors(sentences, config, progress=lambda *done: seen.append(done))
    again = train_word_vectors(sentences, config)
    assert one.words == again.words and np.array_equal(one.vectors, again.vectors)
    assert seen == [(1, 2), (2, 2)]
    other = train_word_vectors(sentences, WordVectorConfig(model=model, size=16, epochs=2, seed=1))
    assert not np.array_equal(one.vectors, other.vectors)


@pytest.mark.parametrize("model", ["skip-gram", "cbow"])
def test_words_in_like_places_have_like_vectors(model) -> None:
    colors, tools = ("red", "blue", "green", "white"), ("hammer", "saw", "file", "plane")
    said = [("paint", "it", c, "again") for c in colors] + [("use", "a", t, "here") for t in tools]
    trained = train_word_vectors(said * 100, WordVectorConfig(model=model, size=8, epochs=40))
    near = trained.nearest("red", 3)
    assert len({word for word, _ in near} & set(colors)) >= 2
    assert not {word for word, _ in near} & {*tools, "use", "a", "here"}
    cosines = [cosine for _, cosine in near]
    assert cosines == sorted(cosines, reverse=True) and cosines[0] <= 1.0001
    with pytest.raises(UnknownNameError, match="xyzzy"):
        trained.nearest("xyzzy")


def test_rare_words_have_no_vector_and_a_network_gets_a_row_for_each_number(trained) -> None:
    vocabulary = Vocabulary(["red", "xyzzy", "cube"])
    matrix = trained.matrix(vocabulary)
    assert matrix.shape == (len(vocabulary), 16) and matrix.dtype == np.float32
    assert not matrix[PADDING].any() and matrix[UNKNOWN].any()
    row = trained.vectors[trained.words.index("red")]
    assert np.array_equal(matrix[vocabulary.number("red")], row)
    assert "xyzzy" not in trained.words and matrix[vocabulary.number("xyzzy")].any()
    assert np.array_equal(matrix, trained.matrix(vocabulary))


def test_vectors_are_read_as_they_were_written(trained, tmp_path) -> None:
    file = tmp_path / "words.safetensors"
    trained.save(file)
    again = WordVectors.load(file)
    assert again.words == trained.words and again.config == trained.config
    assert np.array_equal(again.vectors, trained.vectors)
    assert [f.name for f in tmp_path.iterdir()] == ["words.safetensors"]
    with pytest.raises(OutputError, match="Cannot write"):
        trained.save(file / "words.safetensors")


def test_damaged_files_are_refused(trained, tmp_path) -> None:
    file = tmp_path / "words.safetensors"
    with pytest.raises(DataError, match="cannot be read"):
        WordVectors.load(file)
    file.write_bytes(b"\x80\x04nonsense")
    with pytest.raises(DataError, match="holds no word vectors"):
        WordVectors.load(file)
    vectors = {"vectors": np.zeros((2, 16), np.float32)}
    config = json.dumps({"size": 16})
    for said in ({}, {"words": "[", "config": config}, {"words": '["a"]', "config": config},
                 {"words": '["a", "b"]', "config": '{"window": 0}'}):  # fmt: skip
        save_file(vectors, file, metadata=said)
        with pytest.raises(DataError, match="word vectors|damaged"):
            WordVectors.load(file)


def test_configurations_that_cannot_train_are_refused() -> None:
    with pytest.raises(InputError, match="learning rate does not rise"):
        WordVectorConfig(learning_rate=0.0001)
    with pytest.raises(InputError, match="No word occurs 5 times"):
        train_word_vectors([["a", "b"]], FEW)
