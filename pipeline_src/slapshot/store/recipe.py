"""A recipe holds everything that determines a result; its digest is the version's id."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from slapshot.store.code_dependencies import code_digest, imported_libraries

M = TypeVar("M", bound=BaseModel)

SCHEMA_VERSION = 1
ID_LENGTH = 12


@dataclass(frozen=True)
class Recipe:
    """Everything that one version of one stage is made from.

    Attributes:
        stage: name of the stage.
        config: the configuration values that the stage uses, and no others.
        code: digest of the stage's code and its dependencies.
        upstream: role -> (stage, id) of the versions it reads.
        libraries: library -> version, of those that the stage's code imports.
        files: name -> sha256 of files from outside the store.
    """

    stage: str
    config: Mapping[str, Any]
    code: str
    upstream: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    libraries: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        """Canonical JSON: keys sorted, no spaces."""
        return canonical_json(
            {
                "schema": SCHEMA_VERSION,
                "stage": self.stage,
                "config": dict(self.config),
                "code": self.code,
                "upstream": {role: list(pair) for role, pair in self.upstream.items()},
                "libraries": dict(self.libraries),
                "files": dict(self.files),
            }
        )

    def settings(self, model: type[M]) -> M:
        """The stage's settings, as passed to `slapshot.dag.recipes.Plan.add`."""
        return model.model_validate_json(json.dumps(self.config))

    @property
    def id(self) -> str:
        """First 12 hex digits of the sha256 of the canonical JSON."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:ID_LENGTH]

    @classmethod
    def from_json(cls, text: str) -> "Recipe":
        """Read a recipe written by `to_json`."""
        raw = json.loads(text)
        return cls(
            stage=raw["stage"],
            config=raw["config"],
            code=raw["code"],
            upstream={role: (pair[0], pair[1]) for role, pair in raw["upstream"].items()},
            libraries=raw["libraries"],
            files=raw["files"],
        )


def make_recipe(
    stage: str,
    modules: Iterable[str],
    config: Mapping[str, Any],
    upstream: Mapping[str, "Recipe"],
    files: Mapping[str, Path] | None = None,
) -> Recipe:
    """Recipe of a stage whose code starts at `modules`, with the current code, libraries and files."""
    modules = tuple(modules)
    return Recipe(
        stage=stage,
        config=config,
        code=code_digest(*modules),
        upstream={role: (up.stage, up.id) for role, up in upstream.items()},
        libraries={name: library_version(name) for name in sorted(imported_libraries(*modules))},
        files={name: file_digest(path) for name, path in (files or {}).items()},
    )


def canonical_json(value: Any) -> str:
    """Canonical JSON of a value: sorted keys, no spaces, no NaN."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


@cache
def library_version(name: str) -> str:
    """Installed version, without the local part of a build (such as torch's +cpu)."""
    return version(name).split("+")[0]


def file_digest(path: Path) -> str:
    """Hex sha256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
