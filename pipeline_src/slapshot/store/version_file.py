"""version.json: what a version was made from, and digests of its files as they were written.

| key | value |
|---|---|
| id | of the version: digest of the recipe, and name of the folder |
| recipe | everything that determines the result |
| content | file -> digest of its content, however it is stored; compared with the lock |
| bytes | file -> sha256 of its bytes: computed at the disk's speed, and sensitive to any flipped bit |
| inputs | role -> digest of the content of the version upstream, as it was when this one was made |
| label | description for people, without influence on results |
| seconds, made_at | how long it took, and when it was finished |
| checksum | sha256 of all the rest, to check the file itself |

Versions of earlier code have no `label`, or neither `bytes`, `inputs` nor `checksum`: these are checked
against `content`.
"""

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import pyarrow as pa

from slapshot.errors import InputError
from slapshot.json_types import JsonObject
from slapshot.store.content import content_digest
from slapshot.store.recipe import ID_LENGTH, Recipe, canonical_json, file_digest


class RecipeRecord(TypedDict):
    """A recipe as it is written, see store.recipe."""

    schema: int
    stage: str
    config: JsonObject
    code: str
    upstream: dict[str, tuple[str, str]]
    libraries: dict[str, str]
    files: dict[str, str]


class VersionRecord(TypedDict):
    """What version.json holds, see above."""

    id: str
    recipe: RecipeRecord
    content: dict[str, str]
    bytes: NotRequired[dict[str, str]]
    inputs: NotRequired[dict[str, str]]
    label: NotRequired[str]
    seconds: float
    made_at: str
    checksum: NotRequired[str]


VERSION_FILE = "version.json"
REPAIR = (
    "run `slapshot versions verify --repair` (with your --config, if you use one), which removes it and "
    "all that was made from it, then make them again"
)

_BEFORE_CHECKSUMS = {"id", "recipe", "content", "seconds", "made_at"}
_BEFORE_LABELS = _BEFORE_CHECKSUMS | {"bytes", "inputs", "checksum"}
_KEYS = _BEFORE_LABELS | {"label"}


def write_version_file(
    folder: Path, recipe: Recipe, inputs: Mapping[str, str], seconds: float, label: str
) -> None:
    """Write the version.json of a folder whose payload is complete.

    Args:
        folder: with the payload.
        recipe: of the version.
        inputs: role -> digest of the content of each version upstream.
        seconds: that making it took.
        label: of the version, for people.
    """
    paths = {p.relative_to(folder).as_posix(): p for p in sorted(folder.rglob("*")) if p.is_file()}
    version: VersionRecord = {
        "id": recipe.id,
        "recipe": json.loads(recipe.to_json()),
        "content": {name: content_digest(path) for name, path in paths.items()},
        "bytes": {name: file_digest(path) for name, path in paths.items()},
        "inputs": dict(inputs),
        "label": label,
        "seconds": round(seconds, 1),
        "made_at": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    version["checksum"] = _digest(version)
    (folder / VERSION_FILE).write_text(canonical_json(version) + "\n", "utf-8")


def read_version_file(folder: Path) -> VersionRecord:
    """The version.json of a finished version.

    Raises:
        InputError: it is missing or damaged.
    """
    path = folder / VERSION_FILE
    try:
        if not path.is_file():  # reading a pipe would block forever
            raise FileNotFoundError
        text = path.read_text("utf-8")
        version = json.loads(text)
        as_written = _is_as_written(version, text, folder)
    except FileNotFoundError:
        raise InputError(f"{path} is missing; {REPAIR}") from None
    except (OSError, ValueError, RecursionError):  # not UTF-8, no JSON, or no valid number
        as_written = False
    if not as_written:
        raise InputError(f"{path} is not what was written there; {REPAIR}")
    return version


def damaged_files(folder: Path) -> list[str]:
    """Files of a version that are missing or damaged; version.json alone if that is."""
    try:
        version = read_version_file(folder)
    except InputError:
        return [VERSION_FILE]
    digest = file_digest if "bytes" in version else content_digest
    written = version.get("bytes", version["content"])
    return [
        name
        for name in written
        if not (folder / name).is_file() or _digest_or_none(folder / name, digest) != written[name]
    ]


def digest_of_content(version: VersionRecord) -> str:
    """One digest of the content of all files of a version."""
    return _digest(version["content"])


def _is_as_written(version: Any, text: str, folder: Path) -> bool:
    if not isinstance(version, dict) or set(version) not in (_KEYS, _BEFORE_LABELS, _BEFORE_CHECKSUMS):
        return False
    if not isinstance(version["recipe"], dict) or not isinstance(version["content"], dict):
        return False
    named = (version["recipe"].get("stage"), version["id"]) == (folder.parent.name, folder.name)
    if not named or _digest(version["recipe"])[:ID_LENGTH] != version["id"]:
        return False
    if "checksum" not in version:
        return True
    rest = {key: value for key, value in version.items() if key != "checksum"}
    # The text is compared as well: 1E-5 in place of 1e-5 would parse to the same value.
    return version["checksum"] == _digest(rest) and text == canonical_json(version) + "\n"


def _digest(value: Any) -> str:
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


def _digest_or_none(path: Path, digest: Callable[[Path], str]) -> str | None:
    try:
        return digest(path)
    except (OSError, ValueError, pa.ArrowException):  # a damaged Parquet file raises any of them
        return None
