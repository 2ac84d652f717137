"""Finding, comparing and removing versions."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from slapshot.errors import InputError, writing
from slapshot.store.folder import PARTIAL, Store
from slapshot.store.recipe import ID_LENGTH
from slapshot.store.version_file import VERSION_FILE, VersionRecord

_ID = re.compile(f"[0-9a-f]{{{ID_LENGTH}}}")


def find_version(store: Store, beginning: str) -> VersionRecord:
    """version.json of the only version whose id (or stage/id) begins with `beginning`.

    Raises:
        InputError: there is no such version, or more than one.
    """
    wanted = beginning.rpartition("/")[2]
    found = [version for _, version in store.versions() if version["id"].startswith(wanted)]
    if len(found) != 1:
        some = "no version" if not found else f"{len(found)} versions"
        raise InputError(f"{some} in {store.root} begin with {wanted!r}; see `slapshot versions list`")
    return found[0]


def flatten(value: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Nested mapping to one with dotted keys."""
    flat: dict[str, object] = {}
    for key, item in value.items():
        name = f"{prefix}{key}"
        if isinstance(item, Mapping) and item:
            flat |= flatten(item, f"{name}.")
        else:
            flat[name] = item
    return flat


def collect_garbage(store: Store, keep: Mapping[str, set[str]], really: bool) -> list[tuple[Path, int]]:
    """Find versions and leftovers of interrupted runs that `keep` (stage -> ids) does not name.

    Versions that a process is making and files that the store did not create are kept.

    Returns:
        Folder and size in bytes of each; they are removed only if `really`.

    Raises:
        InputError: the folder is no store, or one of them cannot be removed.
    """
    store.check_mark()
    removed = []
    for folder, version_id in _own_folders(store):
        stage = folder.parent.name
        if version_id in keep.get(stage, set()) or store.is_being_made(stage, version_id):
            continue
        removed.append((folder, sum(p.lstat().st_size for p in folder.rglob("*") if p.is_file())))
        if really:
            with writing(folder):
                store.remove(stage, version_id)
    return removed


def _own_folders(store: Store) -> Iterator[tuple[Path, str]]:
    """Folders that the store created, and the ids of their versions; symbolic links are not followed."""
    for folder in sorted(store.root.glob("*/*")):
        if folder.is_symlink() or folder.parent.is_symlink() or not folder.is_dir():
            continue
        version_id = folder.name.removeprefix(PARTIAL)
        finished = version_id == folder.name and (folder / VERSION_FILE).is_file()
        if _ID.fullmatch(version_id) and (finished or folder.name.startswith(PARTIAL)):
            yield folder, version_id
