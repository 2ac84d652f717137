"""Finding, comparing and removing versions."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slapshot.errors import InputError, writing
from slapshot.store.folder import Store


def find_version(store: Store, beginning: str) -> dict[str, Any]:
    """version.json of the only version whose id (or stage/id) begins so.

    Raises:
        InputError: there is none, or more than one.
    """
    wanted = beginning.rpartition("/")[2]
    found = [version for _, version in store.versions() if version["id"].startswith(wanted)]
    if len(found) != 1:
        some = "no version" if not found else f"{len(found)} versions"
        raise InputError(f"{some} in {store.root} begin with {wanted!r}; see `slapshot versions list`")
    return found[0]


def flatten(value: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mapping to one with dotted keys."""
    flat: dict[str, Any] = {}
    for key, item in value.items():
        name = f"{prefix}{key}"
        if isinstance(item, Mapping) and item:
            flat |= flatten(item, f"{name}.")
        else:
            flat[name] = item
    return flat


def collect_garbage(store: Store, keep: Mapping[str, set[str]], really: bool) -> list[tuple[Path, int]]:
    """Versions and leftovers of interrupted runs that `keep` (stage -> ids) does not name.

    What a process is making right now stays.

    Returns:
        Folder and size in bytes of each; they are removed only if `really`.

    Raises:
        InputError: one of them cannot be removed.
    """
    removed = []
    for folder in sorted(store.root.glob("*/*")):
        if not folder.is_dir():
            continue
        stage, version_id = folder.parent.name, folder.name.removeprefix(".partial-")
        if version_id in keep.get(stage, set()) or store.is_being_made(stage, version_id):
            continue
        size = sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
        removed.append((folder, size))
        if really:
            with writing(folder):
                # The mark goes first: a mark without its version would hide that it is gone.
                store.mark(stage, version_id).unlink(missing_ok=True)
                shutil.rmtree(folder)
                store.lock(stage, version_id).unlink(missing_ok=True)
    return removed
