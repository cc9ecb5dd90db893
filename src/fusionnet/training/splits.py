"""Which commands a translator learns from and which it is measured on, by name.

Beside the parts by scene group there is a *hard* split: the commands whose tree,
colours aside, occurs only once in the corpus. On a random split a good translator
is nearly perfect; the hard one still tells translators apart. *random* is a seeded
tenth of all commands, whatever their group; *rest* is what is not in it, as *easy* is
what is not in hard. *tune* is a second seeded tenth, drawn from the rest: what is
chosen is chosen on it, so that the random one is looked at once.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Literal, get_args

from fusionnet.corpora import Command, Corpus, part_of
from fusionnet.errors import TreeError, UnknownNameError
from fusionnet.models.tree_symbols import symbols_of
from fusionnet.randomness import generator

Split = Literal["train", "val", "test", "hard", "easy", "random", "rest", "tune", "all"]

RANDOM_SHARE = 0.1
"""Share of the commands that are in the random split."""


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
    drawn = random_numbers(corpus.commands) if {"random", "rest"} & set(splits) else set()
    tuned = tune_numbers(corpus.commands) if "tune" in splits else set()

    def names(command: Command) -> set[str]:
        hard = "hard" if command.id in unique else "easy"
        random = "random" if command.id in drawn else "rest"
        tune = {"tune"} if command.id in tuned else set()
        return {"all", hard, random, part_of(command.scene.group)} | tune

    return [command for command in corpus.commands if names(command) & set(splits)]


def hard_numbers(commands: Sequence[Command]) -> set[int]:
    """The numbers of the commands whose tree, colours aside, no other command has."""
    forms = {command.id: _without_colors(command) for command in commands}
    counts = Counter(forms.values())
    return {number for number, form in forms.items() if counts[form] == 1}


def random_numbers(commands: Sequence[Command], share: float = RANDOM_SHARE) -> set[int]:
    """The numbers of a random share of the commands; always the same ones of a corpus."""
    return set(_shuffled(commands)[: round(share * len(commands))])


def tune_numbers(commands: Sequence[Command], share: float = RANDOM_SHARE) -> set[int]:
    """The numbers of as many other commands as are in the random split."""
    size = round(share * len(commands))
    return set(_shuffled(commands)[size : 2 * size])


def _shuffled(commands: Sequence[Command]) -> list[int]:
    numbers = sorted(command.id for command in commands)
    shuffled: list[int] = generator(0, "splits", "random").permutation(numbers).tolist()
    return shuffled


def _without_colors(command: Command) -> tuple[str, ...]:
    try:
        names = [symbol.name for symbol in symbols_of(command.tree)]
    except TreeError:
        return (str(command.id),)
    return tuple("color" if name.startswith("color:") else name for name in names)
