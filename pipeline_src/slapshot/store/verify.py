"""Are the versions still what was written, and do they match the tracked pipeline.lock?

The lock maps label -> id and content digests for the default configuration, with summary statistics of
every numeric column: on another platform digests may differ while the numbers agree.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from slapshot.store.content import content_digest
from slapshot.store.folder import VERSION_FILE, Store
from slapshot.store.recipe import Recipe

# Share of a column's spread by which its mean and spread may differ on another platform. Contacts are
# chaotic (one rounding moves a rest point by millimetres) and training amplifies that: statistics over
# thousands of hits agree within a few percent, single numbers do not.
TOLERANCE = 0.05
_TABLES = {".parquet", ".csv"}


def damaged_files(folder: Path) -> list[str]:
    """Files of a version that are missing or whose content is not what version.json says."""
    written = json.loads((folder / VERSION_FILE).read_text())["content"]
    return [
        name
        for name, digest in written.items()
        if not (folder / name).is_file() or _digest_or_none(folder / name) != digest
    ]


def _digest_or_none(path: Path) -> str | None:
    try:
        return content_digest(path)
    except (OSError, ValueError, pa.ArrowException):  # a damaged Parquet file raises any of them
        return None


def make_lock(store: Store, recipes: dict[str, Recipe]) -> dict[str, Any]:
    """What pipeline.lock holds: label -> id, content digests and column statistics."""
    lock = {}
    for label, recipe in recipes.items():
        folder = store.folder(recipe.stage, recipe.id)
        version = json.loads((folder / VERSION_FILE).read_text())
        numbers = {
            name: column_statistics(folder / name)
            for name in version["content"]
            if Path(name).suffix in _TABLES
        }
        lock[label] = {"id": recipe.id, "content": version["content"], "numbers": numbers}
    return lock


def compare(store: Store, recipes: dict[str, Recipe], lock: dict[str, Any]) -> dict[str, str]:
    """Label -> identical, equal within tolerance, or what differs or is damaged."""
    verdicts = {}
    for label in sorted(set(recipes) | set(lock)):
        if label not in lock:
            verdicts[label] = "not in the lock"
        elif label not in recipes:
            verdicts[label] = "in the lock only"
        elif not store.is_whole(recipes[label].stage, recipes[label].id):
            verdicts[label] = "not made yet"
        else:
            folder = store.folder(recipes[label].stage, recipes[label].id)
            verdicts[label] = _compare_one(folder, recipes[label], lock[label])
    return verdicts


def _compare_one(folder: Path, recipe: Recipe, locked: dict[str, Any]) -> str:
    damaged = damaged_files(folder)
    if damaged:
        return f"damaged: {', '.join(damaged)} not as written; remove {folder} and run `snakemake figures`"
    found = json.loads((folder / VERSION_FILE).read_text())["content"]
    if found == locked["content"]:
        return "identical" if recipe.id == locked["id"] else "identical content, other recipe"
    if set(found) != set(locked["content"]):
        return f"other files: {', '.join(sorted(set(found) ^ set(locked['content'])))}"
    if not locked["numbers"]:
        return f"differs: {', '.join(name for name in found if found[name] != locked['content'][name])}"
    worst, where = 0.0, ""
    for name, columns in locked["numbers"].items():
        here = column_statistics(folder / name)
        if set(here) != set(columns):
            return f"other columns in {name}"
        for column, (mean, spread) in columns.items():
            scale = max(spread, 1e-3 * abs(mean), 1e-12)
            off = max(abs(here[column][0] - mean), abs(here[column][1] - spread)) / scale
            if off > worst:
                worst, where = off, f"{name}: {column}"
    if worst <= TOLERANCE:
        return f"equal within tolerance (largest deviation {worst:.2g} of the spread)"
    return f"differs: {where} by {worst:.2g} of its spread (tolerance {TOLERANCE})"


def column_statistics(path: Path) -> dict[str, list[float]]:
    """Numeric column -> [mean, standard deviation]; list columns count as their elements."""
    table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    statistics = {}
    for name, column in table.items():
        values = column.to_numpy()
        if values.dtype == object:
            lists = [v for v in values if isinstance(v, np.ndarray)]  # a missing one is None
            values = np.concatenate(lists) if lists else values
        if np.issubdtype(values.dtype, np.number) and len(values):
            finite = values[np.isfinite(values.astype(float))].astype(float)
            if len(finite):
                statistics[str(name)] = [float(finite.mean()), float(finite.std())]
    return statistics
