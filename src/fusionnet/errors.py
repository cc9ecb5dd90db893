"""Every error that FusionNet raises on purpose.

One base class, so that a caller (the command line, the web page) can tell a
mistake of the user's, which gets one clear line, from a bug of ours, which
gets a traceback. Each subclass also inherits the natural built-in.

A message says what was wrong, what was received, what is valid and what to do.
"""


class FusionNetError(Exception):
    """Base of all errors that FusionNet raises on purpose."""


class InputError(FusionNetError, ValueError):
    """Something that a person gave (a file, a number, a sentence) cannot be used."""


class UnknownNameError(FusionNetError, LookupError):
    """A name that no catalogue, corpus or folder knows."""


class DataError(FusionNetError, ValueError):
    """A data file is missing, damaged or not in the expected form."""


class CheckpointError(FusionNetError, ValueError):
    """A checkpoint is missing, damaged, or of another version, robot or schema."""


class TreeError(FusionNetError, ValueError):
    """A Robot Command Language text is malformed; the message names the position."""


class PlanningError(FusionNetError, ValueError):
    """A tree cannot be executed in a layout; the message says why in a sentence."""


class NotUnderstoodError(FusionNetError, ValueError):
    """A sentence could not be read as a command; the message names what was not known."""


class DoubtError(FusionNetError, ValueError):
    """The neural and the symbolic answer disagree, and the policy was told not to move then."""


class UnreachableError(FusionNetError, ValueError):
    """Inverse kinematics found no solution.

    Attributes:
        residual: Remaining distance at the best attempt, in metres.
        attempts: Number of start postures tried.
    """

    def __init__(self, message: str, *, residual: float, attempts: int) -> None:
        super().__init__(message)
        self.residual = residual
        self.attempts = attempts


class RenderingError(FusionNetError, RuntimeError):
    """No picture can be rendered here (usually: no EGL); the message says how to mend it."""


class OutputError(FusionNetError, OSError):
    """Results could not be written (full disk, no permission)."""
