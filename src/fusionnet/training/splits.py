"""Which commands a translator learns from and which it is measured on, by name.

Beside the parts by scene group there is a *hard* split: the commands whose tree,
colours aside, occurs only once in the corpus. On a random split a good translator
is nearly perfect; the hard one still tells translators apart.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Literal, get_args

from fusionnet.corpora import Command, Corpus, part_of
from fusionnet.errors import TreeError, UnknownNameError
from fusionnet.models.tree_symbols import symbols_of

Split = Literal["train", "val", "test", "hard", "easy", "all"]


def commands_of(corpus: Corpus, splits: Sequence[str]) -> list[Command]:
    """The commands of any of some splits, in the corpus's order.

    Raises:
        UnknownNameError: If there is no such split.
    """
    for split in splits:
        if split not in get_args(Split):
            known = ", ".join(get_args(Split))
            raise UnknownNameError(f"No split called {split!r}; available: {known}.")
    unique = hard_numbers(corpus.commands) if {"hard", "easy"} & set(splits) else set()

    def names(command: Command) -> set[str]:
        hard = "hard" if command.id in unique else "easy"
        return {"all", hard, part_of(command.scene.group)}

    return [command for command in corpus.commands if names(command) & set(splits)]


def hard_numbers(commands: Sequence[Command]) -> set[int]:
    """The numbers of the commands whose tree, colours aside, no other command has."""
    forms = {command.id: _without_colors(command) for command in commands}
    counts = Counter(forms.values())
    return {number for number, form in forms.items() if counts[form] == 1}


def _without_colors(command: Command) -> tuple[str, ...]:
    try:
        names = [symbol.name for symbol in symbols_of(command.tree)]
    except TreeError:
        return (str(command.id),)
    return tuple("color" if name.startswith("color:") else name for name in names)
