"""Tokens, words, vocabularies, n-grams and the eight perturbations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.corpora import load_corpus
from fusionnet.errors import InputError, NotUnderstoodError
from fusionnet.models.tree_symbols import symbols_of
from fusionnet.rcl import format, parse
from fusionnet.sentences import (
    MOST_WORDS,
    UNKNOWN,
    Perturbation,
    Vocabulary,
    edits,
    ngrams,
    perturb,
    plain,
    readable_words,
    shortened,
    tokenize,
    unjoined,
    variants,
    words_of,
)
from fusionnet.sentences.phrases import COLOR_PHRASES, singular_or_plural

SENTENCE = "Move the red prism, on top of the blue-sky cube."


def test_tokens_split_at_spaces_and_around_punctuation():
    texts = [token.text for token in tokenize("Put it, on the red-green tower that's 2 high.")]
    assert texts == (
        ["Put", "it", ",", "on", "the", "red", "-", "green", "tower", "that's", "2", "high", "."]
    )


@given(st.text(max_size=80))
def test_a_token_is_the_text_where_it_stands(sentence):
    tokens = tokenize(sentence)
    for token in tokens:
        assert sentence[token.start : token.end] == token.text
    covered = {i for token in tokens for i in range(token.start, token.end)}
    assert all(sentence[i].isspace() for i in range(len(sentence)) if i not in covered)


def test_words_are_lower_case_without_punctuation_and_know_their_tokens():
    words = words_of("Put it, on the RED-green tower 2 squares left.")
    assert words.texts == (
        ("put", "it", "on", "the", "red", "green", "tower", "two", "squares", "left")
    )
    assert words.positions == (1, 2, 4, 5, 6, 8, 9, 10, 11, 12)
    assert plain("It\u2019s") == "it's"
    assert plain("12345") == "12345"


@pytest.mark.parametrize(
    "sentence, reason",
    [
        ("", "empty"),
        (" \n\t", "empty"),
        ("?!", "no word"),
        ("go " * (MOST_WORDS + 1), "201 words"),
        ("x" * 5000, "5000 characters"),
    ],
)
def test_sentences_that_nobody_can_read_are_refused(sentence, reason):
    with pytest.raises(NotUnderstoodError, match=reason):
        readable_words(sentence)


def test_as_many_words_as_allowed_are_read():
    assert len(readable_words("go " * MOST_WORDS)) == MOST_WORDS


@given(st.text(max_size=200))
def test_a_shortened_sentence_fits_on_one_line(sentence):
    assert shortened(sentence).isprintable()
    assert len(shortened(sentence)) <= 700


def test_every_alignment_of_the_treebank_names_words_that_say_it(data_folder):
    """So our tokens are counted as the treebank counts its own."""
    said = {color: set(phrases) for color, (phrases, _) in COLOR_PHRASES.items()}
    strange = colors = 0
    for command in load_corpus("treebank", data_folder).commands:
        words = words_of(command.sentence)
        text = dict(zip(words.positions, words.texts, strict=True))
        last = len(tokenize(command.sentence))
        for symbol in symbols_of(command.tree):
            assert max(symbol.tokens, default=0) <= last
            if symbol.kind == "color" and symbol.tokens:
                phrase = " ".join(text[t] for t in symbol.tokens if t in text)
                colors += 1
                strange += phrase not in said[symbol.name.removeprefix("color:")]
    assert colors > 4000
    assert strange <= 5  # "greed", and gray where the block is white


def test_a_vocabulary_numbers_words_by_frequency_and_knows_the_nearest():
    vocabulary = Vocabulary.of([["the", "red", "cube"], ["the", "red", "tower"], ["the"]])
    assert vocabulary.words[:2] == ("the", "red")
    assert [vocabulary.number(w) for w in ("the", "red")] == [2, 3]
    assert vocabulary.number("xyzzy") == UNKNOWN
    assert "tower" in vocabulary and "xyzzy" not in vocabulary
    assert vocabulary.nearest("twoer") == "tower"
    assert vocabulary.nearest("xyzzy") is None
    assert vocabulary.nearest("t" * 100_000) is None
    with pytest.raises(ValueError, match="once"):
        Vocabulary(["a", "a"])


@given(st.text(max_size=8), st.text(max_size=8))
def test_edits_are_a_symmetric_distance(word, other):
    assert edits(word, other) == edits(other, word)
    assert (edits(word, other) == 0) == (word == other)
    assert abs(len(word) - len(other)) <= edits(word, other) <= max(len(word), len(other))


def test_words_written_as_one_are_taken_apart():
    vocabulary = Vocabulary(["the", "blue", "cube", "one", "step", "on", "to", "onto"])
    words = unjoined(words_of("onthe bluecube onto 1step xyzzy"), vocabulary)
    assert words.texts == ("on", "the", "blue", "cube", "onto", "one", "step", "xyzzy")
    assert words.positions == (1, 1, 2, 2, 3, 4, 4, 5)
    assert vocabulary.halves("blue") is None and vocabulary.halves("x" * 100) is None


def test_edits_count_an_exchange_as_one():
    assert edits("teh", "the") == 1
    assert edits("kitten", "sitting") == 3


def test_a_misspelt_word_shares_most_ngrams_with_the_one_that_was_meant():
    meant, misspelt, other = (
        set(ngrams(w, 100_000)) for w in ("pyramid", "pyramidd", "parallelipiped")
    )
    assert len(meant & misspelt) > 0.7 * len(meant)
    assert len(meant & other) < 0.3 * len(meant)


@given(st.text(max_size=50))
def test_every_word_has_ngrams(word):
    assert all(0 <= n < 64 for n in ngrams(word, 64)) and ngrams(word, 64)


def test_tiles_have_a_plural():
    assert singular_or_plural("square", plural=True) == "squares"
    assert singular_or_plural("steps", plural=False) == "step"
    assert singular_or_plural("grid", plural=False) == "grid"


@pytest.mark.parametrize("kind", Perturbation)
def test_each_perturbation_does_what_its_label_says(kind):
    rng = np.random.default_rng(3)
    for _ in range(50):
        done = perturb(SENTENCE, rng, kinds=[kind])
        assert done.applied == (kind,)
        before, after = SENTENCE, done.sentence
        assert before != after
        match kind:
            case Perturbation.REMOVE_LETTER:
                assert len(after) == len(before) - 1
            case Perturbation.ADD_LETTER | Perturbation.REPEAT_LETTER:
                assert len(after) == len(before) + 1
            case Perturbation.FLIP_LETTER:
                assert sorted(after) == sorted(before) and edits(before, after) == 1
            case Perturbation.REMOVE_PUNCTUATION:
                assert after in {SENTENCE.replace(mark, "") for mark in ",-."}
            case Perturbation.FLIP_CASE:
                assert after.lower() == before.lower()
            case Perturbation.RELOCATE_WORD:
                letters = [sorted(s.replace(" ", "")) for s in (after, before)]
                assert letters[0] == letters[1]
            case Perturbation.REMOVE_SPACE:
                assert after.replace(" ", "") == before.replace(" ", "")
                assert after.count(" ") == before.count(" ") - 1


@settings(max_examples=200)
@given(st.text(max_size=60), st.integers(0, 2**32 - 1))
def test_a_perturbation_knows_where_each_token_came_from(sentence, seed):
    done = perturb(sentence, np.random.default_rng(seed))
    assert len(done.origins) == len(tokenize(done.sentence))
    clean = len(tokenize(sentence))
    assert all(1 <= position <= clean for origin in done.origins for position in origin)
    assert len(done.applied) == len(set(done.applied)) <= 4
    assert done.applied or done.sentence == sentence


def test_variants_are_three_and_each_is_made_from_the_clean_sentence():
    made = variants(SENTENCE, np.random.default_rng(0))
    assert len(made) == 3
    for variant in made:
        assert 1 <= len(variant.applied) <= 4
    counts = {
        len(v.applied) for s in range(40) for v in variants(SENTENCE, np.random.default_rng(s))
    }
    assert counts == {1, 2, 3, 4}


def test_alignments_follow_a_perturbation():
    tree = parse(
        "(event: (action: take (token: 1 2)) "
        "(entity: (color: red (token: 4)) (type: cube (token: 5))))"
    )
    seen = set()
    for seed in range(200):
        done = perturb("pick up the red cube", np.random.default_rng(seed), count=1)
        moved = done.realigned(tree)
        assert moved == tree
        tokens = tokenize(done.sentence)
        symbol = next(s for s in symbols_of(moved) if s.kind == "color")
        assert len(symbol.tokens) == 1
        text = tokens[symbol.tokens[0] - 1].text
        assert edits(text.lower(), "red") <= 1 or "red" in text
        seen.add(format(moved))
    assert len(seen) > 3


def test_perturbations_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="1 to 1"):
        perturb("go", np.random.default_rng(0), kinds=[Perturbation.FLIP_CASE], count=2)
    untouched = perturb("", np.random.default_rng(0))
    assert untouched.sentence == "" and untouched.applied == ()
