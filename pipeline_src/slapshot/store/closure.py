"""Which code a stage depends on, and a digest of what that code says.

Modules are found and read, never imported: planning must not need torch or MuJoCo.
"""

import ast
import hashlib
import importlib.util
from functools import cache
from pathlib import Path

from slapshot.errors import InputError


def code_digest(*modules: str) -> str:
    """Digest of the modules and of all they import from their own packages, as syntax trees.

    Comments, layout and docstrings do not count. Files that are not Python but lie in the folder of
    an imported sub-package (MJCF, say) count byte by byte.

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
        digest.update(f"{name}:{_source_digest(path, path.stat().st_mtime_ns)}\n".encode())
        if path.name == "__init__.py":
            for data in sorted(_data_files(path.parent)):
                digest.update(f"{name}/{data.name}:".encode() + data.read_bytes())
    return digest.hexdigest()


def module_closure(*modules: str) -> dict[str, Path]:
    """All modules that `modules` import, directly or not, from the same top-level packages."""
    own = {name.split(".")[0] for name in modules} | {"slapshot"}
    found: dict[str, Path] = {}
    waiting = list(modules)
    for name in modules:
        if find_source(name) is None:
            raise ModuleNotFoundError(f"no module {name}")
    while waiting:
        name = waiting.pop()
        path = find_source(name)
        if name in found or path is None:
            continue
        found[name] = path
        waiting += [name.rpartition(".")[0]] if "." in name else []
        imports = _imports(path, path.stat().st_mtime_ns)
        waiting += [_absolute(i, name, path) for i in imports if _is_own(i, own)]
    return found


def find_source(name: str) -> Path | None:
    """File of a module, without importing it; None if there is no such Python source."""
    if not all(part.isidentifier() for part in name.split(".")):
        return None
    top, _, rest = name.partition(".")
    root = _package_root(top)
    if root is None:
        return None
    if not rest:
        return root if root.suffix == ".py" else root / "__init__.py"
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


def _is_own(name: str, own: set[str]) -> bool:
    return name.startswith(".") or name.split(".")[0] in own


def _absolute(name: str, importer: str, path: Path) -> str:
    if not name.startswith("."):
        return name
    level = len(name) - len(name.lstrip("."))
    parts = importer.split(".")
    base = parts[: len(parts) - level + (path.name == "__init__.py")]
    return ".".join([*base, name.lstrip(".")]).rstrip(".")


@cache
def _imports(path: Path, _mtime: int) -> tuple[str, ...]:
    """Names that may be modules: `from a.b import c` gives both a.b and a.b.c."""
    names: list[str] = []
    for node in ast.walk(_parse(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            joint = "" if base.endswith(".") else "."
            names += [base, *(f"{base}{joint}{alias.name}" for alias in node.names)]
    return tuple(names)


@cache
def _source_digest(path: Path, _mtime: int) -> str:
    tree = _parse(path)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body
            if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
                node.body = body[1:] or ([] if isinstance(node, ast.Module) else [ast.Pass()])
    # Unparsed source, because ast.dump differs between Python versions and this mostly does not.
    return hashlib.sha256(ast.unparse(tree).encode()).hexdigest()


def _parse(path: Path) -> ast.Module:
    try:
        return ast.parse(path.read_text("utf-8"))
    except SyntaxError as error:
        raise InputError(f"{path}:{error.lineno}: not valid Python ({error.msg}); mend that line") from None


def _data_files(folder: Path) -> list[Path]:
    """Files beside the modules; what editors and file managers leave there (.name, name~) does not count."""
    return [
        p
        for p in folder.iterdir()
        if p.is_file() and p.suffix not in {".py", ".pyc"} and p.name[0] != "." and p.name[-1] != "~"
    ]
