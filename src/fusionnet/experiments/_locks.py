"""Locks between processes that the system lets go when their holder ends, however it ends."""

import fcntl
import hashlib
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

PAUSE = 0.5
"""Seconds between looks at whether another process has done what is done alone."""


class Lock:
    """The right to do one thing alone.

    Args:
        work: Folder that the processes share, also under different names on several
            machines; the lock's file goes to its `locks`.
        what: Names what may be done, apart from where: a path below the results.
    """

    def __init__(self, work: Path, what: Path) -> None:
        key = hashlib.blake2b(what.as_posix().encode(), digest_size=12).hexdigest()
        self._file = work / "locks" / key
        self._open: IO[Any] | None = None

    def acquire(self) -> bool:
        """Take it, if nobody holds it."""
        self._file.parent.mkdir(parents=True, exist_ok=True)
        opened = self._file.open("w")
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            opened.close()
            return False
        self._open = opened
        return True

    def release(self) -> None:
        """Let it go."""
        if self._open is not None:
            self._open.close()
            self._open = None

    def __enter__(self) -> "Lock":
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


@contextmanager
def alone(work: Path, what: Path) -> Iterator[None]:
    """Do one thing at a time, waiting while another process is at it.

    Whoever comes in looks first whether it is done by then.

    Args:
        work: Folder that the processes share.
        what: Names what is done, apart from where.
    """
    lock = Lock(work, what)
    while not lock.acquire():
        time.sleep(PAUSE)
    with lock:
        yield
