"""Commands that are left out: by the thesis's rules (4.2.2), or because they cannot be done."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from fusionnet.blocks import Layout, apply, plan
from fusionnet.corpora._command import Command, Corpus
from fusionnet.errors import PlanningError

_WORD = re.compile(r"[^\W\d_]{2,}")

NOT_EXECUTABLE = "tree cannot be executed in its scene"


def discard(corpus: Corpus) -> Corpus:
    """The corpus without the commands that the thesis would not train on.

    Left out, and counted in `Corpus.left_out` by reason, are incomplete sentences
    (fewer than two words) and those whose tree does not correspond to the scene: that
    cannot be executed in it, or lead to another layout than the recorded one. What is
    marked as spam, and commands without a tree or layouts, the readers leave out and
    count already.

    References:
        Thesis, section 4.2.2.
    """
    return _without(corpus, _fault)


def executable(corpus: Corpus) -> Corpus:
    """The corpus without the commands that nothing can be compared with.

    Left out, and counted in `Corpus.left_out`, are those whose tree cannot be executed in their
    scene.
    """
    return _without(corpus, lambda command: NOT_EXECUTABLE if _reached(command) is None else None)


def _without(corpus: Corpus, fault: Callable[[Command], str | None]) -> Corpus:
    kept = []
    found: Counter[str] = Counter(corpus.left_out)
    for command in corpus.commands:
        reason = fault(command)
        if reason is None:
            kept.append(command)
        else:
            found[reason] += 1
    return replace(corpus, commands=tuple(kept), left_out=dict(found))


def _fault(command: Command) -> str | None:
    if len(_WORD.findall(command.sentence)) < 2:
        return "incomplete sentence"
    after = _reached(command)
    if after is None:
        return NOT_EXECUTABLE
    return None if after.same_blocks(command.scene.after) else "tree leads to another layout"


def _reached(command: Command) -> Layout | None:
    """The layout that its tree leads to; None if it cannot be executed in its scene."""
    before = command.scene.before
    try:
        return apply(plan(command.tree, before), before)
    except PlanningError:
        return None
