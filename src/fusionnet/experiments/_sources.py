"""What experiments learn from, and what is said when it is not there."""

from pathlib import Path

from fusionnet.corpora import Corpus, executable, load_corpus, synthetic
from fusionnet.errors import DataError
from fusionnet.experiments._experiment import Trial

SMOKE_COMMANDS = 250
"""Commands of our own at the smoke scale: two a group, so that every part has some."""


def corpus_for(trial: Trial) -> Corpus:
    """The treebank's executable commands; at the smoke scale our own, which need no data.

    Its parts are `split("train")`, `split("val")` and `split("test")`, by scene group. Choose
    on val; the test groups are for the final numbers alone.

    Raises:
        DataError: If the treebank was not given, or is missing or damaged; the message says
            how to give it.
    """
    if trial.scale == "smoke":
        return synthetic.read(size=SMOKE_COMMANDS)
    if trial.data is None:
        raise DataError(
            f"The experiment {trial.experiment!r} at the scale {trial.scale!r} needs the treebank,"
            " which is not part of this package: run `fusionnet reproduce"
            f" {trial.experiment} --scale {trial.scale} --data DIR`, where DIR holds commands.txt,"
            " annotation.txt and configuration.txt."
        )
    return executable(load_corpus("treebank", trial.data))


def require(path: Path, trial: Trial, command: str) -> Path:
    """The path of data or weights that a run needs, if it is there.

    Args:
        path: File or folder.
        trial: That needs it.
        command: Makes it.

    Raises:
        DataError: If it is missing; the message says which command makes it.
    """
    if not path.exists():
        raise DataError(
            f"The experiment {trial.experiment!r} at the scale {trial.scale!r} needs {path}, which"
            f" is missing; `{command}` makes it."
        )
    return path
