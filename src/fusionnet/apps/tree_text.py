"""A tree in the terminal, with the words that each leaf was read from."""

from rich.text import Text
from rich.tree import Tree as Branch

from fusionnet import rcl
from fusionnet.apps.tree_drawing import Part, parts_of
from fusionnet.sentences import tokenize


def tree_text(tree: rcl.Tree, sentence: str) -> Branch:
    """A tree as rich draws it; word positions count the tokens of the sentence."""
    return _branch(parts_of(tree), [token.text for token in tokenize(sentence)])


def _branch(part: Part, words: list[str], branch: Branch | None = None) -> Branch:
    label = Text(part.name, style="cyan")
    if part.value:
        label = Text(f"{part.name} ", style="dim")
        label.append(part.value, style="bold")
        said = " ".join(words[t - 1] for t in part.tokens if t <= len(words))
        label.append(f'  "{said}"' if said else "  (no word)", style="green" if said else "dim")
    below = Branch(label) if branch is None else branch.add(label)
    for child in part.parts:
        _branch(child, words, below)
    return below
