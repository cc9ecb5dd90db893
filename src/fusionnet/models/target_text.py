"""What the thesis's FusionNet reads and writes, as tokens.

- `rcl`: the tree's text, split around brackets and colons as in section 3.4, positions included
- `short`: the tree's values in preorder, as the translator that we ship writes it
- `english`: the sentence itself, which makes the Transformer an autoencoder (7.3)
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

from fusionnet.errors import TreeError
from fusionnet.models.tree_symbols import Symbol, symbols_of, tree_of
from fusionnet.rcl import Tree, parse
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


def written_tree(writes: Writes, tokens: Sequence[str]) -> Tree:
    """The tree that was written, without marks; its short form tells no word positions.

    Raises:
        TreeError: If the tokens are no whole tree, as those of a sentence never are.
    """
    if writes == "english":
        raise TreeError("What was written is a sentence, not a tree.")
    if writes == "short":
        return tree_of([Symbol(token) for token in tokens])
    return parse(text_of(tokens))


def text_of(tokens: Sequence[str]) -> str:
    """A tree's text from its tokens: a space stands only between two words."""
    gaps = (" " if a[-1].isalnum() and b[0].isalnum() else "" for a, b in pairwise([*tokens, ")"]))
    return "".join(token + gap for token, gap in zip(tokens, gaps, strict=True))
