"""Modules of the user's own that a file names.

They are announced before they run, and any error in them is reported in one line.
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

# Pattern of dotted module names.
MODULE = r"^[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*$"

_imported: set[str] = set()


def import_own(name: str, where: str) -> ModuleType:
    """Import a module, after a message on the terminal that its code will run.

    Args:
        name: dotted name.
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
    """Context in which a user's own module runs: anything it raises, exits included, becomes one line.

    Raises:
        InputError: the code raised an exception.
    """
    try:
        yield
    except BaseException as error:
        raise InputError(f"{where}: {_fault(error, {module}) or module}: {_said(error)}; mend it") from None


@contextmanager
def own_code_may_run() -> Iterator[None]:
    """Context in which imported modules may be called: errors and exits from one of them become one line.

    Raises:
        InputError: one of them raised an exception.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        fault = _fault(error, _imported)
        if fault is None:
            raise
        raise InputError(f"{fault}: {_said(error)}; mend it, or do without that module") from error


def _find(name: str) -> ModuleSpec | None:
    """Spec of a module; nothing is imported, not even its parent package."""
    top, *inner = name.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # a loaded module without a spec, such as __main__
        return None
    for part in inner:
        if spec is None or spec.submodule_search_locations is None:
            return None
        spec = PathFinder.find_spec(f"{spec.name}.{part}", spec.submodule_search_locations)
    return spec


def _fault(error: BaseException, modules: set[str]) -> str | None:
    """Module, file and line in which an error arose; None if no frame belongs to these modules."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}:{error.lineno}"
    for frame, line in reversed(list(walk_tb(error.__traceback__))):
        if frame.f_globals.get("__name__") in modules:
            return f"{frame.f_globals['__name__']} ({frame.f_code.co_filename}:{line})"
    return None


def _said(error: BaseException) -> str:
    kind, reason = type(error).__name__, reason_of(error)
    return reason if reason == kind or isinstance(error, SystemExit) else f"{kind}: {reason}"
