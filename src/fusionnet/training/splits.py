"""Which commands a translator learns from and which it is measured on, by name.

Beside the parts by scene group there is a *hard* split: the commands whose tree,
colours aside, occurs only once in the corpus. On a random split a good translator
is nearly perfect; the hard one still tells translators apart. *random* is a seeded
tenth of all commands, whatever their group; *rest* is what is not in it, as *easy* is
what is not in hard. *tune* is a second seeded tenth, drawn from the rest: what is
chosen is chosen on it, so that the random one is looked at once. Both are tenths of one
shuffled order, *fold-0* and *fold-1* of its ten.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Literal, get_args

from fusionnet.corpora import Command, Corpus, part_of
from fusionnet.errors import TreeError, UnknownNameError
from fusionnet.models.tree_symbols import symbols_of
from fusionnet.randomness import generator

Split = Literal[
    "train",
    "val",
    "test",
    "hard",
    "easy",
    "random",
    "rest",
    "tune",
    "all",
    "fold-0",
    "fold-1",
    "fold-2",
    "fold-3",
    "fold-4",
    "fold-5",
    "fold-6",
    "fold-7",
    "fold-8",
    "fold-9",
]

FOLDS = 10
"""Parts of equal size, but for a command or so, that the shuffled commands fall into."""


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
    folds = fold_numbers(corpus.commands)

    def names(command: Command) -> set[str]:
        hard = "hard" if command.id in unique else "easy"
        fold = folds[command.id]
        random = "random" if fold == 0 else "rest"
        tune = {"tune"} if fold == 1 else set()
        return {"all", hard, random, f"fold-{fold}", part_of(command.scene.group)} | tune

    return [command for command in corpus.commands if names(command) & set(splits)]


def hard_numbers(commands: Sequence[Command]) -> set[int]:
    """The numbers of the commands whose tree, colours aside, no other command has."""
    forms = {command.id: _without_colors(command) for command in commands}
    counts = Counter(forms.values())
    return {number for number, form in forms.items() if counts[form] == 1}


def fold_numbers(commands: Sequence[Command]) -> dict[int, int]:
    """For the number of every command its fold, 0 to 9; always the same ones of a corpus."""
    numbers = sorted(command.id for command in commands)
    shuffled: list[int] = generator(0, "splits", "random").permutation(numbers).tolist()
    return {number: FOLDS * place // len(shuffled) for place, number in enumerate(shuffled)}


def _without_colors(command: Command) -> tuple[str, ...]:
    try:
        names = [symbol.name for symbol in symbols_of(command.tree)]
    except TreeError:
        return (str(command.id),)
    return tuple("color" if name.startswith("color:") else name for name in names)
