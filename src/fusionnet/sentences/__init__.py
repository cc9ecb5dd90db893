"""Sentences: tokens and words, vocabularies and character n-grams, and the eight perturbations."""

from fusionnet.sentences.perturbations import Perturbation, Perturbed, perturb, variants
from fusionnet.sentences.tokens import (
    MOST_WORDS,
    Token,
    Words,
    plain,
    readable_words,
    shortened,
    tokenize,
    words_of,
)
from fusionnet.sentences.vocabulary import PADDING, UNKNOWN, Vocabulary, edits, ngrams, unjoined

__all__ = [
    "MOST_WORDS",
    "PADDING",
    "UNKNOWN",
    "Perturbation",
    "Perturbed",
    "Token",
    "Vocabulary",
    "Words",
    "edits",
    "ngrams",
    "perturb",
    "plain",
    "readable_words",
    "shortened",
    "tokenize",
    "unjoined",
    "variants",
    "words_of",
]
