"""What readers do about a bad record: refuse the whole, or leave it out and say so."""

import logging
from collections import Counter

from fusionnet.errors import DataError

WITHOUT_TREE = "without a tree"
WITHOUT_LAYOUTS = "without layouts"
"""Why a command is left out (thesis 4.2.2)."""

_log = logging.getLogger(__name__)


class Faults:
    """Bad records of one corpus.

    Args:
        skip_bad: Whether they are left out, with a warning in the log each,
            instead of refusing the whole.

    Attributes:
        left_out: How many were left out, by the reason.
    """

    def __init__(self, skip_bad: bool) -> None:
        self.skip_bad = skip_bad
        self.left_out: Counter[str] = Counter()

    def found(self, file: str, line: int, reason: str, kind: str = "unreadable") -> None:
        """Deal with a bad record.

        Args:
            file: Name of its file.
            line: Where it is in it, from 1.
            reason: What is wrong with it.
            kind: Under which reason it is counted.

        Raises:
            DataError: If bad records are not to be left out.
        """
        message = f"{file}, line {line}: {reason}"
        if not self.skip_bad:
            raise DataError(f"{message} (--skip-bad leaves such records out)")
        self.left_out[kind] += 1
        _log.warning("%s; left out", message)
