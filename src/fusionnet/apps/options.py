"""A command's options as its configuration; what is wrong with them is said in one line."""

import contextlib
import inspect
import io
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterator
from typing import Any

from fusionnet.errors import InputError

_RULE = re.compile(r"^ *(╭|[│╰]? *[─-]{3})")
_DESCRIBES = " " * 8
_SUGGESTS = "Perhaps you meant:"
"""How the parser's boxes are made: lines across, and what is said below an option."""

_PLAIN = (
    (r"no type matching \{?(.+?)\}? could be instantiated from \[(.*)\]\.", r"expected \1, got \2"),
    (r"invalid literal for int\(\) with base 10: (.*)", r"expected INT, got \1"),
    (r"^invalid choice", "Invalid choice"),
    (r"could not convert string to float: (.*)", r"expected FLOAT, got \1"),
)
"""What the parser says of a value that it cannot read, and how we say it."""


def parsed(
    config_type: type, function: Callable[[Any], Any], name: str, arguments: list[str]
) -> Any:
    """The configuration that the words of a command line ask for; None if help was printed.

    Args:
        config_type: Its class.
        function: What the command does; its docstring stands in the help.
        name: The command, as it is typed.
        arguments: The words after it.

    Raises:
        InputError: If the words are no options of this command, or a value cannot be used.
    """
    import tyro

    said = io.StringIO()
    try:
        with _wide_errors(said, arguments):
            config: Any = tyro.cli(
                config_type,
                args=arguments,
                prog=f"fusionnet {name}",
                description=inspect.getdoc(function),
                config=(tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
            )
    except SystemExit as exit_:
        if exit_.code:
            raise InputError(
                f"{one_line(said.getvalue())} See `fusionnet {name} --help`."
            ) from None
        return None
    except ValueError as error:  # a configuration refuses its values
        raise InputError(str(error)) from error
    print(said.getvalue(), end="", file=sys.stderr)
    return config


@contextlib.contextmanager
def _wide_errors(said: io.StringIO, arguments: list[str]) -> Iterator[None]:
    """Keep what the parser prints to the error stream, its lines unbroken unless it is help."""
    columns = os.environ.get("COLUMNS")
    if not {"-h", "--help"} & set(arguments):
        os.environ["COLUMNS"] = "10000"
    try:
        with contextlib.redirect_stderr(said):
            yield
    finally:
        os.environ.pop("COLUMNS", None)
        if columns is not None:
            os.environ["COLUMNS"] = columns


def one_line(box: str) -> str:
    """What the parser says in a box, without the box, its advice on help, and its inner reasons."""
    lines = box.splitlines()
    rules = [number for number, line in enumerate(lines) if _RULE.match(line)]
    if len(rules) < 2:
        return " ".join(box.split())
    rows = textwrap.dedent("\n".join(line.strip("│") for line in lines[rules[0] + 1 : rules[1]]))
    head = " ".join(row for row in rows.splitlines() if not row.startswith(_DESCRIBES))
    said = " ".join(head.partition("Got errors:")[0].split())
    # A refusal by the configuration itself names its class instead of an option.
    said = re.sub(r"^Error parsing (?:[A-Z]\w*[a-z]\w*: )?", "", said)
    for pattern, plain in _PLAIN:
        said = re.sub(pattern, plain, said)
    said = f"{said.rstrip('.')}."
    suggested = re.search(rf"{_SUGGESTS}[\s│]+(\S+)", box)
    if suggested is not None:
        said += f" Did you mean {suggested[1]!r}?"
    return said
