"""Merges configuration files, and locates each of their values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slapshot.yaml_file import Document, Loc, read_document

ARGUMENTS = Path("--config")  # named in messages instead of a file for values of the command line


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Merge `over` into `base` recursively; values of `over` win, as with Snakemake's --configfile."""
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            value = merge(old, value)
        merged[key] = value
    return merged


@dataclass(frozen=True)
class Layers:
    """Configuration files, each of which overrides those before it, and overrides of the command line.

    Attributes:
        values: merged values.
        documents: the parsed files.
        arguments: overrides of the command line.
    """

    values: dict[str, Any]
    documents: Sequence[Document]
    arguments: Mapping[str, Any]

    @classmethod
    def read(cls, files: Sequence[Path], arguments: Mapping[str, Any]) -> "Layers":
        """Read files, the last of which has the highest precedence.

        Raises:
            InputError: one of them cannot be read or is not YAML.
        """
        documents = [read_document(_shown(file)) for file in files]
        values: dict[str, Any] = {}
        for layer in (*(document.values for document in documents), arguments):
            values = merge(values, layer)
        return cls(values, documents, arguments)

    def where(self, loc: Loc) -> str:
        """File and line of a value in the last layer that has it; if it is missing, of its parent."""
        for end in range(len(loc), 0, -1):
            if _has(self.arguments, loc[:end]):
                return str(ARGUMENTS)
            for document in reversed(self.documents):
                if loc[:end] in document.lines:
                    return document.where(loc[:end])
        return str(self.documents[-1].path)


def _shown(file: Path) -> Path:
    """Path relative to the working directory where possible, because Snakemake makes paths absolute."""
    try:
        return file.relative_to(Path.cwd())
    except ValueError:
        return file


def _has(value: Any, loc: Loc) -> bool:
    for part in loc:
        inside = range(len(value)) if isinstance(value, list) else value if isinstance(value, Mapping) else ()
        if part not in inside:
            return False
        value = value[part]
    return True
