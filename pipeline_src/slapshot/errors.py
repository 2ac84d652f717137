"""Errors that a user can fix: one line that says what is wrong, where, and what to do."""

import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from slapshot.text import printable


class InputError(Exception):
    """Bad input from outside (configuration, recording, machine): the message is one line for the user.

    Stage commands print it without a traceback and exit with code 1. It may contain names and contents of
    files: line breaks and terminal control characters in them are escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


_FREE_SPACE = "free some space there, for example with `slapshot versions gc`"
_PERMIT = "make it writable for you (ls -ld shows whose it is)"
# Error code of the operating system that a user can resolve -> what to do.
_REMEDIES = {
    errno.ENOSPC: _FREE_SPACE,
    errno.EDQUOT: _FREE_SPACE,
    errno.EFBIG: "raise the limit on the size of files (ulimit -f)",
    errno.EROFS: "make that file system writable, or work in a copy elsewhere",
    errno.EACCES: _PERMIT,
    errno.EPERM: _PERMIT,
}


@contextmanager
def writing(target: Path) -> Iterator[None]:
    """Context in which `target` is written: errors of the operating system become one line.

    Raises:
        InputError: the disk is full, or there is no permission to write `target` or a part of it.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        code = _refusal(error)
        if code is None:
            raise
        file = getattr(error, "filename", None)
        where = f" ({file})" if file and Path(file).absolute() != target.absolute() else ""
        raise InputError(
            f"{target} could not be written: {os.strerror(code)}{where}; "
            f"{_REMEDIES[code]}, then run the same command again"
        ) from error


def check_writable(target: Path) -> None:
    """Check before a computation that `target`, which does not exist yet, can be written afterwards.

    Raises:
        InputError: its parent is no folder, or there is no permission to write to it.
    """
    above = target.absolute().parent
    while not (above.exists() or above.is_symlink()) and above != above.parent:
        above = above.parent
    if not above.is_dir():
        raise InputError(f"{target}: {above} is no folder; name another place")
    with writing(target), tempfile.TemporaryFile(dir=above):
        pass


def _refusal(error: BaseException) -> int | None:
    """Error code of the operating system, also where a clean-up hides it behind an error of its own.

    Libraries in other languages only repeat the system's message, so that it is searched for the code.
    """
    if isinstance(error, OSError) and error.errno in _REMEDIES:
        return error.errno
    code = next((code for code in _REMEDIES if os.strerror(code) in str(error)), None)
    return code if code or error.__context__ is None else _refusal(error.__context__)


@contextmanager
def reading(path: Path, remedy: str, longest: int | None = None) -> Iterator[None]:
    """Context in which `path` is read: errors of the operating system become one line.

    Only regular files are opened, because reading a pipe or a device could block forever.

    Args:
        path: of the file.
        remedy: what to do if it is missing or not a regular file.
        longest: maximum size in bytes.

    Raises:
        InputError: it is missing, not a regular file, too large, or there is no permission to read it.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            kind = "a folder" if stat.S_ISDIR(found.st_mode) else "no regular file"
            raise InputError(f"{path}: is {kind}; {remedy}")
        if longest is not None and found.st_size > longest:
            raise InputError(f"{path}: has {found.st_size:,} bytes, and {longest:,} are allowed; {remedy}")
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {remedy}") from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}); {remedy}") from None
