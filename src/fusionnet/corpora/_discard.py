"""The thesis's rules for discarding commands (4.2.2), as far as a machine can apply them."""

import re
from collections import Counter
from dataclasses import replace

from fusionnet.blocks import apply, plan
from fusionnet.corpora._command import Command, Corpus
from fusionnet.errors import PlanningError

_WORD = re.compile(r"[^\W\d_]{2,}")


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
    kept = []
    found: Counter[str] = Counter(corpus.left_out)
    for command in corpus.commands:
        reason = _fault(command)
        if reason is None:
            kept.append(command)
        else:
            found[reason] += 1
    return replace(corpus, commands=tuple(kept), left_out=dict(found))


def _fault(command: Command) -> str | None:
    if len(_WORD.findall(command.sentence)) < 2:
        return "incomplete sentence"
    before = command.scene.before
    try:
        after = apply(plan(command.tree, before), before)
    except PlanningError:
        return "tree cannot be executed in its scene"
    return None if after.same_blocks(command.scene.after) else "tree leads to another layout"
