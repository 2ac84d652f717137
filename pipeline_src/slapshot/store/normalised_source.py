"""Normalised source: the parts of a module's syntax tree that can change a result.

The following parts cannot, and are left out of the digest, so that changing them recomputes nothing:

- comments, layout and docstrings;
- imports for type checkers only;
- imports of the names in NEUTRAL, which check values, show progress, end stages and store results, but
  compute none: importing them does not make a module depend on their code. Any other name of the same modules
  counts like that of any module;
- messages: calls of a module's logger, the text arguments of `progress`, the messages of InputError and
  ProblemAtError, which end a stage, and descriptions in pydantic's `Field`. Expressions in a logger's message
  count unless they evidently have no side effects: a logger that consumes a generator leaves nothing of it
  for the result.

Messages of other exceptions count: a stage may record why something failed.
tests/store/test_normalised_source.py checks the package for all that.
"""

import ast
import hashlib
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from slapshot.errors import InputError

# Name -> why no result depends on its code.
NEUTRAL = {
    "slapshot.command.Run": "holds a recipe's values and folders",
    "slapshot.command.stage_command": "hands them to a stage, and says what became of it",
    "slapshot.errors.InputError": "ends a stage, so that there is no result",
    "slapshot.errors.reading": "raises InputError, or does nothing",
    "slapshot.errors.writing": "raises InputError, or does nothing",
    "slapshot.progress.progress": "yields what it is given, unchanged",
    "slapshot.store.code_dependencies.find_source": "finds a module, whose own code is in the recipe",
    "slapshot.validation.LABEL": "refuses texts",
    "slapshot.validation.LONGEST_NAME": "refuses names",
    "slapshot.validation.Model": "holds values as they were read, or refuses them",
    "slapshot.validation.NAME": "refuses names",
    "slapshot.validation.ProblemAtError": "ends a stage, so that there is no result",
    "slapshot.validation.TITLE": "refuses texts",
    "slapshot.validation.key_of": "shows a place in a message",
    "slapshot.validation.read_json": "reads what stands there, or raises InputError",
    "slapshot.validation.short": "shows a value in a message",
    "slapshot.validation.validated": "holds values as they were read, or raises InputError",
    "slapshot.validation.validated_part": "holds values as they were read, or raises ProblemAtError",
    "slapshot.validation.values_of": "gives the values that a model holds",
}

_PROGRESS, _FIELD = "slapshot.progress.progress", "pydantic.Field"
_ENDING = ("slapshot.errors.InputError", "slapshot.validation.ProblemAtError")
_IMPORTING = {"import_module", "find_spec"}  # a library that is only located, to read its files, counts too
_LEVELS = {"debug", "info", "warning", "error", "exception", "critical"}
_PLAIN_CALLS = {"len", "round", "str", "repr"}
_PLAIN_NODES = (
    ast.Attribute, ast.BinOp, ast.BoolOp, ast.Compare, ast.Constant, ast.FormattedValue, ast.IfExp,
    ast.JoinedStr, ast.Name, ast.Slice, ast.Subscript, ast.Tuple, ast.UnaryOp, ast.boolop, ast.cmpop,
    ast.expr_context, ast.keyword, ast.operator, ast.unaryop,
)  # fmt: skip


@dataclass(frozen=True)
class Source:
    """The parts of a module that results depend on.

    Attributes:
        digest: hex sha256 of its normalised source.
        imports: absolute names that may be modules: `from a.b import c` gives both a.b and a.b.c.
    """

    digest: str
    imports: tuple[str, ...]


def read_source(module: str, path: Path) -> Source:
    """Read a module from its file.

    Raises:
        InputError: the file is not valid Python.
    """
    return _read_once(module, path, path.stat().st_mtime_ns)


@cache
def _read_once(module: str, path: Path, _mtime: int) -> Source:
    try:
        tree = ast.parse(path.read_text("utf-8"))
    except (SyntaxError, ValueError) as error:  # ValueError: not a text
        line, problem = getattr(error, "lineno", None) or 1, getattr(error, "msg", error)
        raise InputError(f"{path}:{line}: not valid Python ({problem}); mend that line") from None
    essence = _Essence(module, path, tree)
    # Unparsed source, because ast.dump differs between Python versions, and ast.unparse mostly does not.
    text = ast.unparse(essence.visit(tree))
    return Source(hashlib.sha256(text.encode()).hexdigest(), tuple(essence.imports))


class _Essence(ast.NodeTransformer):
    """Removes what the module's docstring lists, and collects imports.

    Attributes:
        imports: names that may be modules.
    """

    def __init__(self, module: str, path: Path, tree: ast.Module) -> None:
        self.imports: list[str] = []
        self._module, self._path = module, path
        imported: dict[str, set[str]] = {name: set() for name in (_PROGRESS, _FIELD, *_ENDING)}
        bound: Counter[str] = Counter()
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    imported.get(f"{self._base(node)}.{alias.name}", set()).add(alias.asname or alias.name)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                bound[node.id] += 1
            elif isinstance(node, ast.arg):
                bound[node.arg] += 1
        # A name that is also bound to something else may not refer to the logger or the import.
        self._loggers = {name for node in tree.body for name in _loggers(node) if bound[name] == 1}
        self._progress = {name for name in imported[_PROGRESS] if not bound[name]}
        self._field = {name for name in imported[_FIELD] if not bound[name]}
        self._ending = {name for error in _ENDING for name in imported[error] if not bound[name]}

    def _base(self, node: ast.ImportFrom) -> str:
        return _absolute("." * node.level + (node.module or ""), self._module, self._path)

    def generic_visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body = node.body[1:]
        blocks = [name for name in ("body", "finalbody") if isinstance(getattr(node, name, None), list)]
        filled = [name for name in blocks if getattr(node, name) or name == "body"]
        super().generic_visit(node)
        for name in filled:
            if not getattr(node, name) and not isinstance(node, ast.Module):
                setattr(node, name, [ast.Pass()])
        return node

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        if getattr(node.test, "attr", getattr(node.test, "id", None)) != "TYPE_CHECKING":
            return self.generic_visit(node)
        node.body = []
        self.generic_visit(node)
        return node.orelse

    def visit_Import(self, node: ast.Import) -> ast.AST | None:
        node.names = [alias for alias in node.names if alias.name != "logging"]
        self.imports += [alias.name for alias in node.names]
        return node if node.names else None

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST | None:
        base = self._base(node)
        node.names = [alias for alias in node.names if f"{base}.{alias.name}" not in NEUTRAL]
        self.imports += [base, *(f"{base}.{alias.name}" for alias in node.names)] if node.names else []
        return node if node.names else None

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        return None if _loggers(node) & self._loggers else self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        self.generic_visit(node)
        call = node.value
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)):
            return node
        if not (isinstance(call.func.value, ast.Name) and call.func.value.id in self._loggers):
            return node
        if call.func.attr not in _LEVELS:
            return node
        if _is_plain(*call.args, *call.keywords):
            return None
        if isinstance(call.args[0], ast.Constant):
            call.args[0] = ast.Constant("")
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        called = getattr(node.func, "attr", getattr(node.func, "id", None))
        if called in _IMPORTING and node.args and isinstance(node.args[0], ast.Constant):
            self.imports.append(str(node.args[0].value))
        if isinstance(node.func, ast.Name) and called in self._field:
            node.keywords = [keyword for keyword in node.keywords if keyword.arg != "description"]
        shown = isinstance(node.func, ast.Name) and called in self._progress and node.args
        return node.args[0] if shown and _is_plain(*node.args[1:], *node.keywords) else node

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        error = node.exc
        if isinstance(error, ast.Call) and getattr(error.func, "id", None) in self._ending:
            return ast.Raise(ast.Call(error.func, [], []), None)
        return self.generic_visit(node)


def _loggers(node: ast.AST) -> set[str]:
    """Names to which a statement assigns a logger."""
    if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)):
        return set()
    called = node.value.func
    # A cheap check first, because unparsing every call would take long.
    if getattr(called, "attr", getattr(called, "id", None)) != "getLogger":
        return set()
    if ast.unparse(called) not in {"logging.getLogger", "getLogger"}:
        return set()
    return {target.id for target in node.targets if isinstance(target, ast.Name)}


def _is_plain(*values: ast.AST) -> bool:
    """True if evaluating them has no side effects: they only look up, calculate and format."""
    return all(
        isinstance(node, _PLAIN_NODES)
        or (isinstance(node, ast.Call) and getattr(node.func, "id", None) in _PLAIN_CALLS)
        for value in values
        for node in ast.walk(value)
    )


def _absolute(name: str, importer: str, path: Path) -> str:
    if not name.startswith("."):
        return name
    level = len(name) - len(name.lstrip("."))
    parts = importer.split(".")
    base = parts[: len(parts) - level + (path.name == "__init__.py")]
    return ".".join([*base, name.lstrip(".")]).rstrip(".")
