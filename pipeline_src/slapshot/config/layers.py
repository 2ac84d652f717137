"""Configuration files laid over each other, and where each of their values stands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slapshot.yaml_file import Document, Loc, read_document

ARGUMENTS = Path("--config")  # stands in messages where a file stands for values that a file holds


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Values of `over` laid over `base`, mapping by mapping, as Snakemake does with --configfile."""
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            value = merge(old, value)
        merged[key] = value
    return merged


@dataclass(frozen=True)
class Layers:
    """Files, each laid over those before it, and what the command line lays over all of them.

    Attributes:
        values: of all together.
        documents: of the files.
        arguments: of the command line.
    """

    values: dict[str, Any]
    documents: Sequence[Document]
    arguments: Mapping[str, Any]

    @classmethod
    def read(cls, files: Sequence[Path], arguments: Mapping[str, Any]) -> "Layers":
        """Read files, the last of which counts most.

        Raises:
            InputError: one of them cannot be read or is not YAML.
        """
        documents = [read_document(_shown(file)) for file in files]
        values: dict[str, Any] = {}
        for layer in (*(document.values for document in documents), arguments):
            values = merge(values, layer)
        return cls(values, documents, arguments)

    def where(self, loc: Loc) -> str:
        """File and line of a value, of the last layer that has it; of what holds it, where it is missing."""
        for end in range(len(loc), 0, -1):
            if _has(self.arguments, loc[:end]):
                return str(ARGUMENTS)
            for document in reversed(self.documents):
                if loc[:end] in document.lines:
                    return document.where(loc[:end])
        return str(self.documents[-1].path)


def _shown(file: Path) -> Path:
    """As a person in this folder calls it: Snakemake makes paths absolute."""
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
