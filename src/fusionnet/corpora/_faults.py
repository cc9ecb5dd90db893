"""What readers do about a bad record: refuse the whole, or leave it out and say so."""

import logging

from fusionnet.errors import DataError

_log = logging.getLogger(__name__)


class Faults:
    """Bad records of one corpus.

    Args:
        skip_bad: Whether they are left out, with a warning in the log each,
            instead of refusing the whole.

    Attributes:
        left_out: How many were left out.
    """

    def __init__(self, skip_bad: bool) -> None:
        self.skip_bad = skip_bad
        self.left_out = 0

    def found(self, file: str, line: int, reason: str) -> None:
        """Deal with a bad record.

        Raises:
            DataError: If bad records are not to be left out.
        """
        message = f"{file}, line {line}: {reason}"
        if not self.skip_bad:
            raise DataError(f"{message} (--skip-bad leaves such records out)")
        self.left_out += 1
        _log.warning("%s; left out", message)
