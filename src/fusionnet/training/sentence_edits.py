"""Single changes to aligned sentences, each true to words and tree alike."""

from collections.abc import Sequence

import numpy as np

from fusionnet.models.tree_symbols import DESTINATION
from fusionnet.rcl import Color, Relation
from fusionnet.sentences.phrases import COLOR_PHRASES, NUMBER_WORDS, singular_or_plural
from fusionnet.training.aligned_sentences import AlignedSentence, Span, entity_parts
from fusionnet.training.sentence_pieces import Piece, Place, exchanged, is_block, whole

_MIRRORED = {"left": "right", "leftmost": "rightmost", "left-most": "right-most"}
_MIRRORED |= {b: a for a, b in _MIRRORED.items()}


def recolored(sentence: AlignedSentence, rng: np.random.Generator) -> AlignedSentence:
    """The sentence with its colours exchanged for others, the same for the same."""
    colors = list(Color)
    order = rng.permutation(len(colors))
    other = {f"color:{a}": colors[i] for a, i in zip(colors, order, strict=True)}
    for index, name in enumerate(sentence.symbols):
        span = sentence.spans[index]
        if name not in other or span is None:
            continue
        color = other[name]
        phrases, weights = COLOR_PHRASES[color]
        phrase = phrases[rng.choice(len(phrases), p=weights)]
        sentence = sentence.with_words(*span, phrase.split()).with_symbol(index, f"color:{color}")
    return sentence


def mirrored(sentence: AlignedSentence) -> AlignedSentence:
    """The sentence with left and right exchanged; unchanged where a "left" says nothing."""
    said = [False] * len(sentence.words)
    symbols = list(sentence.symbols)
    for index, name in enumerate(symbols):
        kind, _, value = name.partition(":")
        span = sentence.spans[index]
        if value in _MIRRORED:
            symbols[index] = f"{kind}:{_MIRRORED[value]}"
            if span is None:
                return sentence
            said[span[0] : span[1] + 1] = [True] * (span[1] - span[0] + 1)
    sided = [place for place, word in enumerate(sentence.words) if word in _MIRRORED]
    if not all(said[place] for place in sided):
        return sentence
    words = tuple(_MIRRORED.get(word, word) for word in sentence.words)
    return sentence._replace(words=words, symbols=tuple(symbols))


def with_pronoun(sentence: AlignedSentence) -> AlignedSentence:
    """A drop of the held block with that block called "it"; other sentences as they are.

    Nobody in the treebank says so, but anybody would.
    """
    actions = [name for name in sentence.symbols if name.startswith("action:")]
    if actions != ["action:drop"] or not sentence.holding:
        return sentence
    place = whole(sentence, entity_parts(sentence.symbols)[0])
    if place is None:
        return sentence
    return exchanged(sentence, place, Piece(("it",), ("type:reference",), ((0, 0),)))


def set_beside(sentence: AlignedSentence, phrase: Sequence[str]) -> AlignedSentence:
    """A block put next to another one instead of upon it; unchanged where there is no such place.

    Nobody in the treebank says so, because it leaves open on which side, but anybody would.

    Args:
        sentence: What to change.
        phrase: The words; the first of them says the relation.
    """
    if DESTINATION not in sentence.symbols:
        return sentence
    relation = sentence.symbols.index(DESTINATION) + 1
    landmark = next((p for p in entity_parts(sentence.symbols) if p.first == relation + 1), None)
    place = None if landmark is None else whole(sentence, landmark)
    span = sentence.spans[relation]
    if landmark is None or place is None or span is None or not is_block(sentence, landmark):
        return sentence
    first = _behind(sentence, relation)
    if not first <= span[0] <= span[1] < place.first:
        return sentence
    changed = sentence.with_words(first, place.first - 1, phrase)
    changed = changed.with_symbol(relation, f"relation:{Relation.ADJACENT}")
    spans = list(changed.spans)
    spans[relation] = (first, first)
    return changed._replace(spans=tuple(spans))


def sent_to(sentence: AlignedSentence, where: Piece) -> AlignedSentence:
    """The sentence with another destination; unchanged where it has none, or none that ends it.

    Args:
        sentence: What to change.
        where: The destination, from its relation on.
    """
    if DESTINATION not in sentence.symbols:
        return sentence
    begin = sentence.symbols.index(DESTINATION) + 1
    own = [s for s in sentence.spans[begin:] if s is not None]
    first = _behind(sentence, begin)
    if not own or min(s[0] for s in own) < first:
        return sentence
    place = Place(begin, len(sentence.symbols), first, len(sentence.words) - 1)
    return exchanged(sentence, place, where)


def renumbered(sentence: AlignedSentence, index: int, number: int) -> AlignedSentence:
    """The sentence with another number of tiles; unchanged where it counts other things."""
    span = sentence.spans[index]
    tile = index + 1
    if span is None or tile >= len(sentence.symbols) or sentence.symbols[tile] != "type:tile":
        return sentence
    sentence = sentence.with_words(*span, (NUMBER_WORDS[number],))
    sentence = sentence.with_symbol(index, f"cardinal:{number}")
    span = sentence.spans[tile]
    if span is not None:
        word = singular_or_plural(sentence.words[span[1]], plural=number != 1)
        sentence = sentence.with_words(span[1], span[1], (word,))
    return sentence


def relocated(sentence: AlignedSentence, place: int, goal: int) -> AlignedSentence:
    """The sentence with one word moved to another place.

    A leaf whose words are torn apart keeps the longest part that still stands together.
    """
    order = list(range(len(sentence.words)))
    order.insert(goal, order.pop(place))
    now = {old: new for new, old in enumerate(order)}

    def moved(span: Span | None) -> Span | None:
        if span is None:
            return None
        runs: list[list[int]] = []
        for at in sorted(now[old] for old in range(span[0], span[1] + 1)):
            if runs and runs[-1][-1] == at - 1:
                runs[-1].append(at)
            else:
                runs.append([at])
        longest: list[int] = max(runs, key=len)
        return longest[0], longest[-1]

    words = tuple(sentence.words[old] for old in order)
    return sentence._replace(words=words, spans=tuple(moved(s) for s in sentence.spans))


def misspelt(word: str, rng: np.random.Generator) -> str:
    """A word with one letter lost, added, doubled or exchanged with its neighbour."""
    if len(word) < 3:
        return word
    at = int(rng.integers(len(word)))
    match int(rng.integers(4)):
        case 0:
            return word[:at] + word[at + 1 :]
        case 1:
            return word[:at] + chr(97 + int(rng.integers(26))) + word[at:]
        case 2:
            return word[: at + 1] + word[at:]
        case _:
            at = min(at, len(word) - 2)
            return word[:at] + word[at + 1] + word[at] + word[at + 2 :]


def opened(sentence: AlignedSentence, opening: str) -> AlignedSentence:
    """The sentence behind a few words that say nothing."""
    words = opening.split()
    n = len(words)
    spans = tuple(None if s is None else (s[0] + n, s[1] + n) for s in sentence.spans)
    return sentence._replace(words=(*words, *sentence.words), spans=spans)


def _behind(sentence: AlignedSentence, symbol: int) -> int:
    """The first word behind all that say what comes before a symbol."""
    return max((s[1] for s in sentence.spans[:symbol] if s is not None), default=-1) + 1
