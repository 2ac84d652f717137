"""Modules of a user's own that a file names.

They are announced before they run, and whatever goes wrong in them is one line.
"""

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from traceback import walk_tb
from types import ModuleType

from slapshot.errors import InputError
from slapshot.text import reason_of

# Dotted name of a module.
MODULE = r"^[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*$"

_imported: set[str] = set()


def import_own(name: str, where: str) -> ModuleType:
    """Import a module, after saying on the terminal that its code will run.

    Args:
        name: dotted.
        where: file and key that name it.

    Raises:
        InputError: there is no such module, or it cannot be imported.
    """
    spec = _find(name)
    if spec is None:
        raise InputError(f"{where}: no module {name}; use the dotted name of one that can be imported")
    if name not in sys.modules:
        print(
            f"slapshot: running code from {name} ({spec.origin or 'a folder'})", file=sys.stderr, flush=True
        )
    with code_of(name, where):
        module = import_module(name)
    _imported.add(name)
    return module


@contextmanager
def code_of(module: str, where: str) -> Iterator[None]:
    """While code of a module runs that is a user's own: whatever it raises, exits included, is one line.

    Raises:
        InputError: it raised something.
    """
    try:
        yield
    except BaseException as error:
        raise InputError(f"{where}: {_fault(error, {module}) or module}: {_said(error)}; mend it") from None


@contextmanager
def own_code_may_run() -> Iterator[None]:
    """While the imported modules may be called: an error or exit that began in one of them is one line.

    Raises:
        InputError: one of them raised something.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        fault = _fault(error, _imported)
        if fault is None:
            raise
        raise InputError(f"{fault}: {_said(error)}; mend it, or do without that module") from error


def _find(name: str) -> ModuleSpec | None:
    """Where a module lies; nothing is imported, not even the package that it is in."""
    top, *inner = name.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # one that runs already and has no file, such as __main__
        return None
    for part in inner:
        if spec is None or spec.submodule_search_locations is None:
            return None
        spec = PathFinder.find_spec(f"{spec.name}.{part}", spec.submodule_search_locations)
    return spec


def _fault(error: BaseException, modules: set[str]) -> str | None:
    """Module, file and line where an error began; None if none of these modules took part."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}:{error.lineno}"
    for frame, line in reversed(list(walk_tb(error.__traceback__))):
        if frame.f_globals.get("__name__") in modules:
            return f"{frame.f_globals['__name__']} ({frame.f_code.co_filename}:{line})"
    return None


def _said(error: BaseException) -> str:
    kind, reason = type(error).__name__, reason_of(error)
    return reason if reason == kind or isinstance(error, SystemExit) else f"{kind}: {reason}"
