"""`fusionnet corpus show`: one command with all that belongs to it."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.text import Text

from fusionnet import rcl
from fusionnet.apps.board_drawing import boards_svg
from fusionnet.apps.board_text import LEGEND, board_text, boards
from fusionnet.apps.corpus_source import CorpusSource, read_corpus
from fusionnet.apps.tree_text import tree_text
from fusionnet.blocks import Move, move_between, plan
from fusionnet.corpora import Command, Corpus, command_as_json
from fusionnet.errors import InputError, PlanningError, UnknownNameError
from fusionnet.files import write_whole
from fusionnet.randomness import generator
from fusionnet.sentences import Perturbed, variants

NARROW = 110
"""Columns of a terminal in which two boards stand side by side."""


@dataclass(frozen=True, kw_only=True)
class ShowConfig:
    """Which command to show, and how."""

    number: Annotated[
        int | None,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="[NUMBER]", help_behavior_hint=""),
    ] = None
    """The command's number in its corpus; without one, the first."""

    source: tyro.conf.OmitArgPrefixes[CorpusSource] = field(default_factory=CorpusSource)

    perturbed: bool = False
    """Show three perturbed variants of the sentence too, each labelled with what was done."""

    noise_seed: int = 0
    """Seed of the perturbations."""

    picture: Path | None = None
    """A file (.svg) to draw the layouts before and after into, with the move."""

    json: bool = False
    """Print one JSON object instead."""


def show(config: ShowConfig) -> None:
    """Show a command: its sentence, its tree, the layouts before and after, and the move."""
    command = _chosen(read_corpus(config.source), config.number)
    rng = generator(config.noise_seed, "corpus", "show", command.id)
    noised = variants(command.sentence, rng) if config.perturbed else ()
    move = _move(command)
    if config.picture is not None:
        _draw(command, move, config.picture)
    if config.json:
        print(json.dumps(_as_json(command, move, noised)))
        return
    console = Console(highlight=False)
    scene = command.scene
    where = f"command {command.id} of {command.corpus}, scene {scene.id}, group {scene.group}"
    console.print(Text(command.sentence, style="bold"), soft_wrap=True)
    console.print(Text(where, style="dim"), soft_wrap=True)
    for variant in noised:
        line = Text(f"  {variant.sentence}  ")
        line.append(", ".join(variant.applied) or "no place for any", style="magenta")
        console.print(line, soft_wrap=True)
    console.print()
    console.print(tree_text(command.tree, command.sentence), soft_wrap=True)
    console.print(Text(rcl.format(command.tree), style="dim"), soft_wrap=True)
    console.print()
    before, after = board_text(scene.before, "before"), board_text(scene.after, "after")
    drawn = boards(before, after)
    if console.measure(drawn).maximum <= max(console.width, NARROW):
        console.print(drawn, soft_wrap=True)
    else:
        console.print(before, after, sep="\n\n", soft_wrap=True)
    console.print(Text(LEGEND, style="dim"), soft_wrap=True)
    console.print()
    console.print(Text(_said(command, move)), soft_wrap=True)


def _chosen(corpus: Corpus, number: int | None) -> Command:
    if not corpus.commands:
        raise InputError(f"The corpus {corpus.name!r} has no such commands.")
    if number is None:
        return corpus.commands[0]
    for command in corpus.commands:
        if command.id == number:
            return command
    known = [command.id for command in corpus.commands]
    raise UnknownNameError(
        f"No command {number} here; the {len(known)} of {corpus.name!r} have the numbers "
        f"{min(known)} to {max(known)}."
    )


def _move(command: Command) -> Move | None:
    """What the tree asks for; where it cannot be executed, what was recorded."""
    try:
        return plan(command.tree, command.scene.before)
    except PlanningError:
        return move_between(command.scene.before, command.scene.after)


def _said(command: Command, move: Move | None) -> str:
    said = rcl.describe(command.tree)
    try:
        plan(command.tree, command.scene.before)
    except PlanningError as error:
        said += f"\nThe tree cannot be executed in this scene: {error}"
    if move is None:
        return said
    ends = " and stays in the hand" * move.ends_held
    return f"{said}\nThe block at {tuple(move.source)} goes to {tuple(move.target)}{ends}."


def _draw(command: Command, move: Move | None, file: Path) -> None:
    if file.suffix != ".svg":
        raise InputError(f"A picture of a scene is an .svg file, not {file.name!r}.")
    scene = command.scene
    write_whole(file, boards_svg(scene.before, scene.after, move))


def _as_json(command: Command, move: Move | None, noised: tuple[Perturbed, ...]) -> dict[str, Any]:
    document = command_as_json(command)
    if move is not None:
        document["move"] = {
            "source": list(move.source),
            "target": list(move.target),
            "begins_held": move.begins_held,
            "ends_held": move.ends_held,
        }
    if noised:
        document["perturbed"] = [
            {
                "sentence": variant.sentence,
                "applied": list(variant.applied),
                "rcl": rcl.format(variant.realigned(command.tree)),
            }
            for variant in noised
        ]
    return document
