from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from slapshot.store.folder import Store
from slapshot.store.recipe import Recipe

Make = Callable[..., Recipe]


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


@pytest.fixture
def make(store: Store) -> Make:
    """Puts a version with the given files (name -> bytes) into the store, and returns its recipe."""

    def make(stage: str, config: Mapping[str, Any] | None = None, /, **files: bytes) -> Recipe:
        recipe = Recipe(stage, config or {}, code="0" * 64)
        with store.new_version(recipe) as out:
            for name, content in (files or {"payload": b"content"}).items():
                (out / name).write_bytes(content)
        return recipe

    return make
