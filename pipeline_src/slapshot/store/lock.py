"""Locks between processes, which the system releases however a process ends."""

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
    """Hold the lock on a file, after waiting for the process that holds it; the file goes with the lock.

    Args:
        path: the file, in a folder that is there.
        doing: what a holder does, for the line that says what is waited for.
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
        # Whoever held it before has removed the file, and somebody may hold a new one of that name.
        if _is_at(file, path):
            return file
        file.close()


def _is_at(file: TextIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
