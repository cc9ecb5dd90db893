"""The command line: one table of commands, each a function with one typed configuration.

A command's module is imported only when it is asked for, so that `fusionnet --help`
answers at once. tyro turns the configuration into options; the work is in the library.
"""

import dataclasses
import importlib
import json
import logging
import os
import sys
import traceback
import typing
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from fusionnet.apps.options import parsed
from fusionnet.catalogue import did_you_mean
from fusionnet.errors import FusionNetError, UnknownNameError

EXIT_REACHED = 0
EXIT_MISSED = 1
EXIT_BAD_INPUT = 2
EXIT_BUG = 3
EXIT_INTERRUPTED = 130


class Entry(NamedTuple):
    """One command: what it does, and the function that does it as `module:name`."""

    summary: str
    function: str
    presets: str = ""
    """Name in the same module of a table of configurations that `--preset` chooses from; the
    first is the default."""


COMMANDS = {
    "run": Entry("look, read, and move a block: the main job", "fusionnet.apps.run:run"),
    "translate": Entry(
        "a sentence to its tree, and what that would do", "fusionnet.apps.translate:translate"
    ),
    "simulate": Entry(
        "let the arm do a move, given values, or a run again", "fusionnet.apps.simulate:simulate"
    ),
    "doctor": Entry("say what works on this machine", "fusionnet.apps.doctor:doctor"),
    "detect": Entry("the blocks in pictures, and the layout", "fusionnet.apps.detect:detect"),
    "evaluate policy": Entry(
        "executed success and joint error of a policy", "fusionnet.apps.evaluate:policy"
    ),
    "evaluate translator": Entry(
        "sentences read exactly, and read well enough", "fusionnet.apps.evaluate:translator"
    ),
    "evaluate detector": Entry(
        "blocks found through the robot's eyes", "fusionnet.apps.evaluate:detector"
    ),
    "corpus show": Entry("one command, drawn", "fusionnet.apps.corpus_show:show"),
    "corpus stats": Entry("what is in a corpus, in tables", "fusionnet.apps.corpus:stats"),
    "corpus export": Entry(
        "as JSON lines, or in the treebank's form", "fusionnet.apps.corpus:export"
    ),
    "corpus vectors": Entry("vectors of a corpus's words", "fusionnet.apps.corpus:vectors"),
    "train policy": Entry("everything, one after the other", "fusionnet.apps.train:policy"),
    "train detector": Entry(
        "pictures to blocks", "fusionnet.apps.train:detector", "DETECTOR_PRESETS"
    ),
    "train translator": Entry(
        "sentences to trees", "fusionnet.apps.train:translator", "TRANSLATOR_PRESETS"
    ),
    "train fusion": Entry("both to joint angles", "fusionnet.apps.train:fusion", "FUSION_PRESETS"),
    "reproduce": Entry(
        "run the experiments of the thesis, and ours", "fusionnet.apps.reproduce:reproduce"
    ),
    "report": Entry("all results beside the thesis's, one page", "fusionnet.apps.report:report"),
    "views calibrate": Entry(
        "a camera, from photographs of a checkerboard", "fusionnet.apps.views:calibrate"
    ),
    "views import": Entry("your photographs, to draw blocks into", "fusionnet.apps.views:import_"),
    "views rooms": Entry("six rendered rooms, photographed", "fusionnet.apps.views:rooms"),
    "views draw": Entry("drawn views, each unlike the others", "fusionnet.apps.views:draw"),
    "views show": Entry("where the grid is in each view", "fusionnet.apps.views:show"),
    "dataset build": Entry(
        "pictures, sentences, trees and joint angles", "fusionnet.apps.dataset:build"
    ),
    "dataset info": Entry("say what a data set holds", "fusionnet.apps.dataset:info"),
    "dataset check": Entry("look for damage in a data set", "fusionnet.apps.dataset:check"),
    "dataset show": Entry("draw some samples on one sheet", "fusionnet.apps.dataset:show"),
    "dataset export": Entry("a data set as COCO or LeRobot", "fusionnet.apps.dataset:export"),
    "anchors": Entry("boxes that a detector should start from", "fusionnet.apps.anchors:anchors"),
    "robot table": Entry("make a robot's table of joint angles", "fusionnet.apps.robot:table"),
    "robot look": Entry("pictures of what a robot sees, and of it", "fusionnet.apps.robot:look"),
}

HELP = """\
usage: fusionnet COMMAND [options]

A robot looks at a table of coloured blocks, reads one English sentence, and moves
the block. It shows why: what it saw, what it understood, where it will reach.

  fusionnet run "put the red pyramid on the blue cube"

commands:
{commands}

fusionnet COMMAND --help    the options of one command
fusionnet --version         the version of this package

exit status: 0 done; 1 the block did not end where it was asked to; 2 an input cannot
be used (one line says why); 3 a bug of ours.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit status is returned, never raised.

    Args:
        arguments: The words after `fusionnet`; by default those of this process.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s")
    try:
        return _main(arguments)
    except FusionNetError as error:
        print(f"fusionnet: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("fusionnet: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of our output went away, as in `fusionnet ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_REACHED
    except Exception:
        traceback.print_exc()
        print("fusionnet: this is a bug in FusionNet, please report it", file=sys.stderr)
        return EXIT_BUG


def _main(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(_help(), end="")
        return EXIT_REACHED
    if arguments[0] == "--version":
        print(f"fusionnet {importlib.import_module('importlib.metadata').version('fusionnet')}")
        return EXIT_REACHED
    name, rest = _command(arguments)
    if name is None:
        return EXIT_BAD_INPUT
    _open_graphics_later()
    module_name, _, function_name = COMMANDS[name].function.partition(":")
    module = importlib.import_module(module_name)
    function = getattr(module, function_name)
    if COMMANDS[name].presets:
        config_type, rest = _preset(getattr(module, COMMANDS[name].presets), rest)
    else:
        config_type = typing.get_type_hints(function)["config"]
    return _call(function, config_type, name, rest)


def _preset(presets: dict[str, type], arguments: list[str]) -> tuple[type, list[str]]:
    """The configuration that `--preset NAME` chooses, and the other words.

    Raises:
        UnknownNameError: If there is no such preset.
    """
    rest, chosen = list(arguments), next(iter(presets))
    for place, word in enumerate(arguments):
        if word == "--preset" or word.startswith("--preset="):
            given = word.partition("=")[2] or " ".join(arguments[place + 1 : place + 2])
            rest = arguments[:place] + arguments[place + (1 if "=" in word else 2) :]
            chosen = given
            break
    if chosen not in presets:
        raise UnknownNameError(
            f"No preset called {chosen!r}; available: {', '.join(presets)}."
            + did_you_mean(chosen, list(presets))
        )
    return presets[chosen], rest


def _open_graphics_later() -> None:
    """Keep `import mujoco` from opening the backend that MUJOCO_GL names.

    Where that backend is missing the import would end in a traceback, also of commands that
    need no picture; `simulation.offscreen` opens it when one is needed and fails in one line.
    """
    if "MUJOCO_GL" in os.environ and "mujoco" not in sys.modules:
        os.environ["FUSIONNET_GL"] = os.environ.pop("MUJOCO_GL")


def _help() -> str:
    width = max(map(len, COMMANDS)) + 2
    lines = (f"  {name:<{width}}{entry.summary}" for name, entry in COMMANDS.items())
    return HELP.format(commands="\n".join(lines))


def _command(arguments: list[str]) -> tuple[str | None, list[str]]:
    """The command that the words begin with (one or two of them), and the words after it."""
    for length in (2, 1):
        name = " ".join(arguments[:length])
        if name in COMMANDS:
            return name, arguments[length:]
    first = arguments[0]
    family = [name for name in COMMANDS if name.startswith(f"{first} ")]
    if family:
        wanted = arguments[1] if len(arguments) > 1 and arguments[1][0] != "-" else ""
        known = [name.partition(" ")[2] for name in family]
        said = f"cannot {first} {wanted!r}" if wanted else f"{first} what?"
        hint = did_you_mean(wanted, known)
    else:
        known = list(dict.fromkeys(name.partition(" ")[0] for name in COMMANDS))
        said, hint = f"no command called {first!r}", did_you_mean(first, known)
    print(f"fusionnet: {said}; available: {', '.join(known)}.{hint}", file=sys.stderr)
    return None, []


def _call(
    function: Callable[[Any], Any], config_type: type, name: str, arguments: list[str]
) -> int:
    """Make the function's configuration from the options, and call it.

    A function that returns a number returned its exit status; what else one returns
    (a metric, a path) is printed as JSON.
    """
    config = parsed(config_type, function, name, arguments)
    if config is None:
        return EXIT_REACHED
    result = function(config)
    if isinstance(result, int):
        return result
    if result is not None:
        print(json.dumps(_as_json(result), indent=1))
    return EXIT_REACHED


def _as_json(result: Any) -> Any:
    if hasattr(result, "as_json"):
        return result.as_json()
    if dataclasses.is_dataclass(result) and not isinstance(result, type):
        return dataclasses.asdict(result)
    return result if isinstance(result, dict | list | float) else str(result)
