"""Locks between processes, which the operating system releases however a process ends."""

import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

log = logging.getLogger("slapshot")


@contextmanager
def held(path: Path, doing: str) -> Iterator[None]:
    """Hold the lock on a file, after waiting for the process that holds it; the file is removed afterwards.

    Args:
        path: of the file, in an existing folder.
        doing: what the holder does, for the message while waiting.
    """
    file = _acquire(path, doing)
    try:
        yield
    finally:
        with file:
            path.unlink(missing_ok=True)


def _acquire(path: Path, doing: str) -> TextIO:
    while True:
        file = path.open("w")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            log.info("waiting for another process that %s", doing)
            fcntl.flock(file, fcntl.LOCK_EX)
        # The previous holder has removed the file, and another process may hold a new one of that name.
        if _is_at(file, path):
            return file
        file.close()


def _is_at(file: TextIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
