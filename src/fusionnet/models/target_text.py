"""What the thesis's FusionNet reads and writes, as tokens.

- `rcl`: the tree's text, split around brackets and colons as in section 3.4, positions included
- `short`: the tree's values in preorder, as the translator that we ship writes it
- `english`: the sentence itself, which makes the Transformer an autoencoder (7.3)
"""

from typing import Literal

from fusionnet.models.tree_symbols import symbols_of
from fusionnet.rcl import parse
from fusionnet.sentences import tokenize

START, END = "<start>", "<end>"
Writes = Literal["rcl", "short", "english"]


def source_tokens(sentence: str) -> list[str]:
    """The tokens of a sentence, as they are written (3.4)."""
    return [token.text for token in tokenize(sentence)]


def target_tokens(writes: Writes, sentence: str, tree: str) -> list[str]:
    """The tokens that are to be written for a sentence and its tree's text, without marks.

    Raises:
        TreeError: If the short form is asked for and the text is no tree.
    """
    if writes == "short":
        return [symbol.name for symbol in symbols_of(parse(tree))]
    return source_tokens(sentence if writes == "english" else tree)
