"""A folder is a catalogue: `robots.load("nico")` imports `robots/nico` and reads its one object.

A newcomer adds a robot, backbone, head, fuser, corpus or experiment by adding one
file (or folder) whose module defines the object under the catalogue's attribute
name. Nothing has to be registered.
"""

import difflib
import importlib
import pkgutil
import traceback
from typing import Any

from fusionnet.errors import DataError, FusionNetError, UnknownNameError


def did_you_mean(name: str, known: list[str]) -> str:
    """`" Did you mean 'nico'?"`, or nothing when no known name is near."""
    near = difflib.get_close_matches(name, known, n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


class Catalogue:
    """The modules of one package, each offering one public object.

    Args:
        package: Import path of the folder, for example `"fusionnet.robots"`.
        kind: What one entry is, for messages: `"robot"`.
        attribute: Name under which a module offers its object: `"ROBOT"`.
        parts: Modules of the folder that are no entries of their own.
    """

    def __init__(
        self, package: str, *, kind: str, attribute: str, parts: tuple[str, ...] = ()
    ) -> None:
        self.package = package
        self.kind = kind
        self.attribute = attribute
        self.parts = parts

    def names(self) -> list[str]:
        """The names of all entries, sorted."""
        folder = importlib.import_module(self.package)
        found = (m.name for m in pkgutil.iter_modules(folder.__path__))
        return sorted(n for n in found if not n.startswith("_") and n not in self.parts)

    def load(self, name: str) -> Any:
        """The object called `name`.

        Raises:
            UnknownNameError: If there is none; the message lists what there is.
            DataError: If its module is broken or lacks the object; the message has the file, the
                line and the reason. An error of ours that the module raises passes as it is.
        """
        known = self.names()
        if name not in known:
            raise UnknownNameError(
                f"No {self.kind} called {name!r}; available: {', '.join(known)}."
                + did_you_mean(name, known)
            )
        module_name = f"{self.package}.{name}"
        try:
            module = importlib.import_module(module_name)
        except FusionNetError:
            raise
        except Exception as error:  # a stranger's file may raise anything
            raise DataError(
                f"The {self.kind} {name!r} cannot be loaded: {_reason(error)}."
            ) from error
        if not hasattr(module, self.attribute):
            raise DataError(
                f"The {self.kind} {name!r} cannot be loaded: {module.__file__} lacks"
                f" {self.attribute}; define it there."
            )
        return getattr(module, self.attribute)


def _reason(error: Exception) -> str:
    """What went wrong while a module was imported, and in which line."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.msg} ({error.filename}, line {error.lineno})"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "<frozen" not in f.filename]
    said = repr(error) if isinstance(error, KeyError) or not str(error) else str(error)
    return f"{said} ({frames[-1].filename}, line {frames[-1].lineno})"
