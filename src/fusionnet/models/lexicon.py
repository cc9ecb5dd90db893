"""What each word was seen to say: the check that a reading rests on the words it claims.

Alignments tell which words said which symbol. "Cube" always says something, "the"
never does; "black" never said blue. A reading that leaves a telling word unsaid, or
reads a symbol off words that never said it, is no reading of the sentence.
"""

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fusionnet.errors import CheckpointError
from fusionnet.models.tree_symbols import SYMBOLS

ALWAYS = 0.95
"""Share of its occurrences in which a telling word says something."""

OFTEN = 5
"""Occurrences from which that share counts."""

NAMING = ("color", "type", "cardinal", "indicator")
"""Kinds of leaves whose words name something; a preposition in a wrong place changes less."""

SELDOM = 0.005
"""Share below which what was seen is taken for a slip of the annotators."""


@dataclass(frozen=True)
class Lexicon:
    """What words say.

    Attributes:
        says: For each word the symbols that it was seen to say.
        telling: Verbs and words that name something, wherever they stand.
        silent: Symbols that need no word.
    """

    says: Mapping[str, frozenset[str]]
    telling: frozenset[str]
    silent: frozenset[str]

    @classmethod
    def of(
        cls,
        sentences: Iterable[tuple[Sequence[str], Sequence[str], Sequence[tuple[int, int] | None]]],
        phrases: Iterable[tuple[str, Sequence[str]]] = (),
        idle: Collection[str] = (),
    ) -> "Lexicon":
        """Learn from sentences.

        Args:
            sentences: Words, symbols, and each symbol's first and last word.
            phrases: Further symbols with words that say them.
            idle: Words that may say nothing, however often they say something in the sentences:
                "you" in "could you take it".
        """
        met, telling, naming = Counter[str](), Counter[str](), Counter[str]()
        said: dict[str, Counter[str]] = defaultdict(Counter)
        written, unsaid = Counter[str](), Counter[str]()
        for words, symbols, spans in sentences:
            covered = set[int]()
            for name, span in zip(symbols, spans, strict=True):
                if ":" not in name:
                    continue
                written[name] += 1
                if span is None:
                    unsaid[name] += 1
                    continue
                covered |= set(range(span[0], span[1] + 1))
                kind = name.partition(":")[0]
                for at in range(span[0], span[1] + 1):
                    said[words[at]][name] += 1
                    if kind in NAMING or (kind == "action" and at == span[0]):
                        naming[words[at]] += 1
            met.update(words)
            telling.update(words[at] for at in covered)
        says = {w: {s for s, n in c.items() if n >= SELDOM * met[w]} for w, c in said.items()}
        for name, words in phrases:
            for word in words:
                if telling[word] >= met[word] / 2:
                    says.setdefault(word, set()).add(name)
        always = (w for w, n in met.items() if n >= OFTEN and telling[w] >= ALWAYS * n)
        return cls(
            {word: frozenset(names) for word, names in says.items() if names},
            frozenset(w for w in always if w not in idle and naming[w] >= met[w] / 2),
            frozenset(s for s, n in written.items() if unsaid[s] >= SELDOM * n),
        )

    def kept(self, words: Iterable[str]) -> "Lexicon":
        """The lexicon of these words alone."""
        known = set(words)
        says = {word: names for word, names in self.says.items() if word in known}
        return Lexicon(says, self.telling & known, self.silent)

    def supports(self, words: Iterable[str], symbol: str) -> bool:
        """Whether any of some words was seen to say a symbol."""
        return any(symbol in self.says.get(word, ()) for word in words)

    def as_json(self) -> dict[str, Any]:
        """The document that `from_json` reads."""
        return {
            "says": {word: sorted(names) for word, names in sorted(self.says.items())},
            "telling": sorted(self.telling),
            "silent": sorted(self.silent),
        }

    @classmethod
    def from_json(cls, document: Any) -> "Lexicon":
        """Read what a checkpoint holds.

        Raises:
            CheckpointError: If it is no lexicon.
        """
        try:
            says = {str(word): frozenset(names) for word, names in document["says"].items()}
            telling, silent = frozenset(document["telling"]), frozenset(document["silent"])
            known = silent.union(*says.values()) <= set(SYMBOLS)
        except (TypeError, KeyError, AttributeError) as error:
            raise CheckpointError("The checkpoint's lexicon is damaged.") from error
        if not known:
            raise CheckpointError("The checkpoint's lexicon names symbols that there are not.")
        return cls(says, telling, silent)
