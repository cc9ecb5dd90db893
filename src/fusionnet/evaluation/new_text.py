"""Which commands say what no other part of the corpus says in the same words.

Parts are split by scene group, so no layout of one is in another; but people say "pick up the red
pyramid" of many scenes. What is measured on the other sentences alone cannot have been learnt by
heart.
"""

from collections.abc import Sequence

from fusionnet.corpora import Command, Corpus
from fusionnet.sentences import words_of


def new_text(corpus: Corpus, commands: Sequence[Command]) -> list[bool]:
    """Of every command, whether no other part of the corpus has its words.

    Args:
        corpus: All commands.
        commands: Those of one part; the others are taken to have been learnt from.
    """
    part = {command.id for command in commands}
    elsewhere = {words_of(c.sentence).texts for c in corpus.commands if c.id not in part}
    return [words_of(command.sentence).texts not in elsewhere for command in commands]
