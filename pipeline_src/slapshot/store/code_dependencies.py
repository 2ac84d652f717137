"""Modules that a stage depends on, a digest of their code, and the libraries that they import.

Modules are found and read, never imported: working out recipes must not need torch or MuJoCo. Which parts of
a module count is defined in normalised_source.py.
"""

import hashlib
import importlib.util
import sys
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

from slapshot.store.normalised_source import read_source

# Libraries for display and validation, which compute no results.
NEUTRAL_LIBRARIES = frozenset({"pydantic", "rich", "tqdm"})


def code_digest(*modules: str) -> str:
    """Digest of the syntax trees of modules and of all that they import from their own packages.

    Files other than Python in the folder of an imported sub-package (such as MJCF) count byte by byte.

    Args:
        modules: dotted names, from this package or from outside it.

    Returns:
        Hex sha256.

    Raises:
        ModuleNotFoundError: if one of the modules does not exist.
        InputError: one of the files is not valid Python.
    """
    digest = hashlib.sha256()
    for name, path in sorted(module_closure(*modules).items()):
        digest.update(f"{name}:{read_source(name, path).digest}\n".encode())
        if path.name == "__init__.py":
            for data in sorted(_data_files(path.parent)):
                digest.update(f"{name}/{data.name}:".encode() + data.read_bytes())
    return digest.hexdigest()


def module_closure(*modules: str) -> dict[str, Path]:
    """The modules and all that they import, directly or indirectly, except libraries.

    These are modules of slapshot and the user's own ones.
    """
    found: dict[str, Path] = {}
    waiting = list(modules)
    for name in modules:
        if find_source(name) is None:
            raise ModuleNotFoundError(f"no module {name}")
    own = {name.split(".")[0] for name in modules} | {"slapshot"}
    while waiting:
        name = waiting.pop()
        path = find_source(name)
        if name in found or path is None:
            continue
        found[name] = path
        waiting += [name.rpartition(".")[0]] if "." in name else []
        waiting += [i for i in read_source(name, path).imports if i.split(".")[0] in own or _is_nobodys(i)]
    return found


def imported_libraries(*modules: str) -> set[str]:
    """Distributions that the modules and all in their closure import, at top level or inside functions.

    Libraries in NEUTRAL_LIBRARIES are left out.
    """
    tops = {
        name.split(".")[0]
        for module, path in module_closure(*modules).items()
        for name in read_source(module, path).imports
    }
    return {library for top in tops for library in _distributions().get(top, ())} - NEUTRAL_LIBRARIES


def find_source(name: str) -> Path | None:
    """File of a module, without importing it; None if there is no such Python source."""
    if not all(part.isidentifier() for part in name.split(".")):
        return None
    top, _, rest = name.partition(".")
    root = _package_root(top)
    if root is None:
        return None
    if not rest:
        source = root if root.suffix == ".py" else root / "__init__.py"
        return source if source.is_file() else None
    path = root.joinpath(*rest.split("."))
    for candidate in (path / "__init__.py", path.with_suffix(".py")):
        if candidate.is_file():
            return candidate
    return None


@cache
def _package_root(top: str) -> Path | None:
    spec = importlib.util.find_spec(top)
    if spec is None or spec.origin is None:
        return None
    origin = Path(spec.origin)
    return origin.parent if origin.name == "__init__.py" else origin


@cache
def _distributions() -> dict[str, set[str]]:
    """Top-level package -> canonical names of the installed distributions that provide it."""
    found = packages_distributions()
    return {top: {n.lower().replace("_", "-") for n in names} - {"slapshot"} for top, names in found.items()}


def _is_nobodys(module: str) -> bool:
    """True for a user's own module: neither of Python nor of an installed distribution."""
    top = module.split(".")[0]
    return top not in sys.stdlib_module_names and top not in _distributions()


def _data_files(folder: Path) -> list[Path]:
    """Data files beside the modules, without those that editors and file managers leave (.name, name~)."""
    return [
        p
        for p in folder.iterdir()
        if p.is_file() and p.suffix not in {".py", ".pyc"} and p.name[0] != "." and p.name[-1] != "~"
    ]
