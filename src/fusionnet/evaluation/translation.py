"""How well sentences are read: exactly, with the scene's help, and well enough to act on.

A sentence counts only whole. `fusionnet evaluate translator` prints what `evaluate`
returns; with the split "all" it measures any folder in the treebank's form.
"""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fusionnet.blocks import Layout, Move, Scene, apply
from fusionnet.corpora import Command, load_corpus
from fusionnet.errors import InputError, NotUnderstoodError, PlanningError
from fusionnet.evaluation.new_text import new_text
from fusionnet.models.grounded_reading import grounded
from fusionnet.models.reading import Reading
from fusionnet.models.sentence_reader import SentenceReader
from fusionnet.models.translators import load_translator
from fusionnet.randomness import generator
from fusionnet.rcl import Entity, Event, SpatialRelation, Tree, format
from fusionnet.rcl import Sequence as EventSequence
from fusionnet.sentences import perturb
from fusionnet.training.splits import Split, commands_of


@dataclass(frozen=True, kw_only=True)
class TranslationEvaluation:
    """What to measure.

    Attributes:
        corpus: Where the commands come from.
        data: Folder of the corpus.
        split: Which of its commands; "all" for a corpus that was never learnt from.
        checkpoint: Folder of the translator, or the shipped name compact (the default).
        beam: Width of the search.
        skip_bad: Leave unreadable records out instead of refusing the whole corpus.
        perturbations: How many of the eight perturbations each sentence suffers, 0 to 8.
        failures: How many misread sentences to list in the result.
    """

    corpus: str = "treebank"
    data: Path | None = None
    split: Split = "test"
    checkpoint: Path | None = None
    beam: int = 10
    skip_bad: bool = False
    perturbations: int = 0
    failures: int = 0

    def __post_init__(self) -> None:
        """Refuse what cannot be measured."""
        if not (1 <= self.beam <= 100 and 0 <= self.perturbations <= 8 and self.failures >= 0):
            raise InputError(
                "beam goes from 1 to 100, perturbations from 0 to 8, failures from 0; received "
                f"{self.beam}, {self.perturbations} and {self.failures}."
            )


def evaluate(config: TranslationEvaluation) -> dict[str, Any]:
    """Measure a translator on a split of a corpus.

    Returns:
        n: Commands.
        exact: Share whose most probable tree is the right one, ids included.
        exact_with_planner: The same for the first tree that can be executed in the scene.
        exact_ignoring_ids: `exact` where ids do not count.
        exact_with_alignments: `exact` where every leaf must also name the right words.
        exact_without_state: `exact` when the translator is not told whether the gripper
            holds a block.
        refused: Share that the translator would not have taken for a command; the other
            numbers take its reading all the same.
        layout_reached: Share whose executed tree leads to the recorded layout.
        word_accuracy: Share of right symbols, given the right ones before each.
        cross_entropy: Mean over all symbols, in nats, given the right ones before each.
        new_text: n, exact, exact_with_planner and layout_reached of the commands whose words,
            before any perturbation, no other split's command has, if some are not new.
        sentences_per_second: Read one after the other, with the beam.
        failures: Sentences, right trees and trees read, if asked for.
        left_out: Commands that the reader left out, by the reason, if there are any.
    """
    corpus = load_corpus(config.corpus, config.data, skip_bad=config.skip_bad)
    commands = commands_of(corpus, [config.split])
    if not commands:
        raise InputError(f"The corpus {config.corpus!r} has no commands in split {config.split!r}.")
    new = new_text(corpus, commands)  # as people wrote them
    if config.perturbations:
        commands = [perturbed(command, config.perturbations) for command in commands]
    translator = load_translator(config.checkpoint)
    measured = measure(translator, commands, beam=config.beam, new=new)
    if not config.failures:
        measured.pop("failures")
    else:
        measured["failures"] = measured["failures"][: config.failures]
    if corpus.left_out:
        measured["left_out"] = dict(corpus.left_out)
    said = {"corpus": config.corpus, "split": config.split}
    return said | {"perturbations": config.perturbations} | measured


def perturbed(command: Command, count: int) -> Command:
    """The command with a perturbed sentence, always the same, and its tree's words moved."""
    rng = generator(0, "evaluation", "perturbed", command.id)
    done = perturb(command.sentence, rng, count=count)
    return dataclasses.replace(command, sentence=done.sentence, tree=done.realigned(command.tree))


def measure(
    translator: SentenceReader,
    commands: Sequence[Command],
    *,
    beam: int = 10,
    new: Sequence[bool] = (),
) -> dict[str, Any]:
    """The numbers of `evaluate` for any commands, `new` of which say what is said nowhere else."""
    held = [command.scene.before.held is not None for command in commands]
    began = time.perf_counter()
    readings = [
        translator.read([c.sentence], [h], beam=beam)[0]
        for c, h in zip(commands, held, strict=True)
    ]
    seconds = time.perf_counter() - began
    stateless = _read(translator, commands, beam)
    rows = [_judge(c, r) for c, r in zip(commands, readings, strict=True)]
    refused = [_refused(translator, c, r) for c, r in zip(commands, readings, strict=True)]
    exact_without_state = [
        bool(r) and r[0].tree == c.tree for c, r in zip(commands, stateless, strict=True)
    ]
    accuracy, entropy = translator.teacher_forced(
        [c.sentence for c in commands], held, [c.tree for c in commands]
    )
    failures = [
        {
            "id": c.id,
            "sentence": c.sentence,
            "holding": h,
            "right": format(c.tree, tokens=False),
            "read": format(r[0].tree, tokens=False) if r else None,
            "probability": r[0].probability if r else None,
            "layout_reached": row["layout_reached"],
            "exact_with_planner": row["exact_with_planner"],
        }
        for c, h, r, row in zip(commands, held, readings, rows, strict=True)
        if not row["exact"]
    ]
    found: dict[str, Any] = {"n": len(commands), **_shares(rows)}
    if not all(new):
        unheard = [row for row, is_new in zip(rows, new, strict=True) if is_new]
        names = ("exact", "exact_with_planner", "layout_reached")
        shares = _shares(unheard) if unheard else {}
        found["new_text"] = {"n": len(unheard)} | {n: shares[n] for n in names if n in shares}
    return {
        **found,
        "refused": float(np.mean(refused)),
        "exact_without_state": float(np.mean(exact_without_state)),
        "word_accuracy": accuracy,
        "cross_entropy": entropy,
        "sentences_per_second": len(commands) / seconds,
        "failures": failures,
    }


def _shares(rows: Sequence[dict[str, bool]]) -> dict[str, float]:
    """The share of rows in which each thing is true."""
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def _read(
    translator: SentenceReader, commands: Sequence[Command], beam: int, size: int = 32
) -> list[tuple[Reading, ...]]:
    """All commands in batches, the gripper's state hidden."""
    found: list[tuple[Reading, ...]] = []
    for start in range(0, len(commands), size):
        said = [c.sentence for c in commands[start : start + size]]
        found += translator.read(said, [None] * len(said), beam=beam, count=1)
    return found


def _refused(translator: SentenceReader, command: Command, readings: Sequence[Reading]) -> bool:
    """Whether a person would have been told that the sentence was not understood."""
    try:
        translator.refuse(command.sentence, translator.readable(command.sentence), readings)
    except NotUnderstoodError:
        return True
    return False


def _judge(command: Command, readings: Sequence[Reading]) -> dict[str, bool]:
    best = readings[0].tree if readings else None
    chosen, move = best, None
    try:
        picked = grounded(readings, command.scene.before)
        chosen, move = picked.reading.tree, picked.move
    except PlanningError:
        pass
    return {
        "exact": best == command.tree,
        "exact_with_planner": chosen == command.tree,
        "exact_ignoring_ids": best is not None and _nameless(best) == _nameless(command.tree),
        "exact_with_alignments": best is not None and format(best) == format(command.tree),
        "layout_reached": move is not None and reaches(move, command.scene),
    }


def reaches(move: Move, scene: Scene) -> bool:
    """Whether a move leads to the recorded layout.

    All blocks must stand where they were recorded; of a held block only which one it
    is counts, because the height at which it was recorded follows no rule.
    """
    try:
        after = apply(move, scene.before)
    except PlanningError:
        return False
    return _standing(after) == _standing(scene.after) and _held(after) == _held(scene.after)


def _standing(layout: Layout) -> set[tuple[Any, ...]]:
    held = layout.held
    return {(b.color, b.shape, b.cell) for b in layout.blocks if b != held}


def _held(layout: Layout) -> tuple[Any, ...] | None:
    return None if layout.held is None else (layout.held.color, layout.held.shape)


def _nameless(tree: Tree) -> Tree:
    """A tree without its ids and references to them."""

    def entity(e: Entity) -> Entity:
        relations = tuple(relation(r) for r in e.relations)
        return dataclasses.replace(e, id=None, reference_id=None, relations=relations)

    def relation(r: SpatialRelation) -> SpatialRelation:
        return dataclasses.replace(r, entity=None if r.entity is None else entity(r.entity))

    def event(e: Event) -> Event:
        where = None if e.destination is None else relation(e.destination)
        return Event(e.action, entity(e.entity), where)

    if isinstance(tree, EventSequence):
        return EventSequence(tuple(event(e) for e in tree.events))
    return event(tree)
