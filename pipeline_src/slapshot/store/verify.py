"""Check that versions are undamaged, and that they match the tracked pipeline.lock.

The lock maps label -> id and content digests for the default configuration, with summary statistics of
every numeric column: on another platform digests may differ while the numbers agree.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TypedDict

import numpy as np
import pandas as pd

from slapshot.errors import InputError, writing
from slapshot.parquet import read_frame
from slapshot.store.folder import Store
from slapshot.store.recipe import Recipe
from slapshot.store.version_file import REPAIR, damaged_files, digest_of_content, read_version_file

Version = tuple[str, str]  # stage and id

# Tolerance of a column's mean and standard deviation between platforms, as a share of the latter. Contacts
# are chaotic (one rounding error moves a rest point by millimetres) and training amplifies that: statistics
# over thousands of hits agree within a few percent, single numbers do not.
TOLERANCE = 0.05
_TABLES = {".parquet", ".csv"}


def problem_of(store: Store, version: Version) -> str | None:
    """What is wrong with a finished version, or None.

    Its files are checked against their digests, and the content that it was made from against the current
    content of the versions upstream: one that was made again may differ.
    """
    damaged = damaged_files(store.folder(*version))
    if damaged:
        return f"damaged: {', '.join(damaged)} not as written"
    written = read_version_file(store.folder(*version))
    for role, digest in written.get("inputs", {}).items():
        stage, version_id = written["recipe"]["upstream"][role]
        upstream = store.find(stage, version_id)
        if upstream is not None and digest_of_content(upstream) != digest:
            return f"made from another content of {stage}/{version_id} than is there now"
    return None


def find_problems(store: Store, versions: Iterable[Version]) -> dict[Version, str]:
    """Version -> what is wrong with it, for existing versions that are damaged or out of date.

    Versions with a damaged version.json are always included, because it is unknown what they are.
    """
    versions = {*versions}
    there = {(folder.parent.name, folder.name) for folder in store.folders()}
    there |= {version for version in versions if store.folder(*version).is_dir()}
    unreadable = there - {(folder.parent.name, folder.name) for folder, _ in store.versions()}
    found = {version: problem_of(store, version) for version in sorted(there & versions | unreadable)}
    return {version: problem for version, problem in found.items() if problem is not None}


def remove_damaged(
    store: Store, problems: Mapping[Version, str], recipes: Iterable[Recipe]
) -> dict[Version, str]:
    """Remove versions and everything made from them, for any configuration, including leftovers of runs.

    Args:
        store: of the versions.
        problems: version -> what is wrong with it.
        recipes: of a plan; leftovers of their interrupted runs are removed, too.

    Returns:
        Version -> why it was removed. Versions being made are kept: the process has checked its inputs.

    Raises:
        InputError: the folder is no store, or one of them cannot be removed.
    """
    store.check_mark()
    upstream = {(recipe.stage, recipe.id): {*recipe.upstream.values()} for recipe in recipes}
    for folder, written in store.versions():
        pairs = written["recipe"]["upstream"].values()  # lists, as JSON has them
        upstream[folder.parent.name, folder.name] = {(stage, version_id) for stage, version_id in pairs}
    why = dict(problems)
    waiting = list(problems)
    for bad in waiting:  # the list grows during the loop
        for version, above in upstream.items():
            if bad in above and version not in why:
                why[version] = f"made from {'/'.join(bad)}"
                waiting.append(version)
    removed = {}
    # Versions made from a damaged one are removed before it: an interrupted repair must find them again.
    for version in reversed(waiting):
        there = store.folder(*version).exists() or store.partial(*version).exists()
        if there and not store.is_being_made(*version):
            with writing(store.folder(*version)):
                store.remove(*version)
            removed[version] = why[version]
    return removed


class LockedVersion(TypedDict):
    """What pipeline.lock says of a version: id, content digests, and column statistics of its tables."""

    id: str
    content: dict[str, str]
    numbers: dict[str, dict[str, list[float]]]


def make_lock(store: Store, recipes: dict[str, Recipe]) -> dict[str, LockedVersion]:
    """Content of pipeline.lock: label -> id, content digests and column statistics.

    Raises:
        InputError: a version is damaged, or was made from content that has since changed.
    """
    lock: dict[str, LockedVersion] = {}
    for label, recipe in recipes.items():
        folder = store.folder(recipe.stage, recipe.id)
        problem = problem_of(store, (recipe.stage, recipe.id))
        if problem:
            raise InputError(f"{label}: {problem}; {REPAIR}")
        version = read_version_file(folder)
        numbers = {
            name: column_statistics(folder / name)
            for name in version["content"]
            if Path(name).suffix in _TABLES
        }
        lock[label] = {"id": recipe.id, "content": version["content"], "numbers": numbers}
    return lock


def compare(store: Store, recipes: dict[str, Recipe], lock: Mapping[str, LockedVersion]) -> dict[str, str]:
    """Label -> identical, equal within tolerance, or a description of the difference or damage."""
    verdicts = {}
    for label in sorted(set(recipes) | set(lock)):
        if label not in lock:
            verdicts[label] = "not in the lock"
        elif label not in recipes:
            verdicts[label] = "in the lock only"
        elif not store.is_whole(recipes[label].stage, recipes[label].id):
            verdicts[label] = "not made yet"
        else:
            verdicts[label] = _compare_one(store, recipes[label], lock[label])
    return verdicts


def _compare_one(store: Store, recipe: Recipe, locked: LockedVersion) -> str:
    folder = store.folder(recipe.stage, recipe.id)
    problem = problem_of(store, (recipe.stage, recipe.id))
    if problem:
        return f"{problem}; {REPAIR}"
    found = read_version_file(folder)["content"]
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
    """Numeric column -> [mean, standard deviation]; for list columns, over all elements."""
    table = read_frame(path) if path.suffix == ".parquet" else pd.read_csv(path)
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
