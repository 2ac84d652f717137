"""Which files an import reads, and the fields in their names."""

import os
import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from glob import has_magic
from pathlib import Path, PurePath

from slapshot.errors import InputError
from slapshot.recordings.importing.mapping import Files
from slapshot.recordings.importing.name_pattern import NamePattern

_MAX_ENTRIES = 500_000  # entries to search: more is a whole disk and not a folder of recordings
_ANY_DEPTH = "**"


def find_sources(files: Files, source: Path) -> tuple[Path, list[Path]]:
    """The folder that names are relative to, and the files in natural order.

    Args:
        files: says which files in a folder are meant.
        source: a folder, a file, or a path with * in it.

    Raises:
        InputError: There is no such file, or there are too many to look at.
    """
    try:
        if source.is_dir():
            root, pattern, remedy = source, files.pattern, "files.pattern in the mapping"
        elif has_magic(str(source)) and not source.exists():
            depth = next(i for i, part in enumerate(source.parts) if has_magic(part))
            root, pattern = Path(*source.parts[:depth]), str(Path(*source.parts[depth:]))
            remedy = "its spelling"
        else:
            return source.parent, [source]
        found = list(_matching(root, pattern))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        where = getattr(error, "filename", None) or source
        raise InputError(f"{where}: cannot be read ({reason}); give the folder of the CSV files") from None
    if not found:
        raise InputError(f"{source}: no file matches {pattern}; check the path, or {remedy}")
    return root, sorted(found, key=lambda file: natural_key(file.relative_to(root).as_posix()))


def fields_of_names(pattern: NamePattern | None, files: list[Path]) -> list[dict[str, str]]:
    """Field -> text, for each file.

    Args:
        pattern: what makes fields of a name; None makes none.
        files: whose names they are.

    Raises:
        InputError: A name does not match, or matching does not end.
    """
    own = [{"file": file.stem, "folder": file.absolute().parent.name} for file in files]
    if pattern is None:
        return own
    found = []
    for file, fields, more in zip(files, own, pattern.fields([file.stem for file in files]), strict=True):
        if more is None:
            raise InputError(
                f"{file}: the name does not match files.name_pattern ({pattern.pattern}); correct the "
                "pattern, "
                "or narrow files.pattern so that it leaves this file out"
            )
        found.append(fields | more)
    return found


def natural_key(text: str) -> list[tuple[int, str]]:
    """Key that sorts numbers in a text as numbers."""
    parts = re.split(r"([0-9]{1,18})", text)
    return [(int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in parts if part]


def _matching(root: Path, pattern: str) -> Iterator[Path]:
    """Files under `root` that a pattern names.

    pathlib's own search takes each way through `**/**/` once more, which does not end in deep folders. Here
    every folder is read once, with all places in the pattern that it may stand for.
    """
    parts = PurePath(pattern).parts
    count = 0
    waiting = [(root, {0})]
    while waiting:
        folder, begun = waiting.pop()
        # Any number of folders may be none.
        places = {j for i in begun for j in _from(i, parts)}
        with os.scandir(folder) as entries:
            for entry in entries:
                count += 1
                if count > _MAX_ENTRIES:
                    raise InputError(
                        f"{root}: {pattern} leads through more than {_MAX_ENTRIES:,} files and folders; "
                        "name the folder of the recordings"
                    )
                hits = {i for i in places if _matches(entry.name, parts[i])}
                if not hits:
                    continue
                if not entry.is_dir():
                    if len(parts) - 1 in hits and parts[-1] != _ANY_DEPTH:
                        yield Path(entry.path)
                    continue
                # Links among any number of folders may lead in a circle.
                deep = {i for i in hits if parts[i] == _ANY_DEPTH and not entry.is_symlink()}
                inner = deep | {i + 1 for i in hits if parts[i] != _ANY_DEPTH and i + 1 < len(parts)}
                if inner:
                    waiting.append((Path(entry.path), inner))


def _from(place: int, parts: tuple[str, ...]) -> Iterator[int]:
    """The place in a pattern, and those behind it as far as it has only **."""
    yield place
    while parts[place] == _ANY_DEPTH and place + 1 < len(parts):
        place += 1
        yield place


def _matches(name: str, part: str) -> bool:
    # Names with a dot are what editors and file managers leave behind.
    hidden = name.startswith(".") and not part.startswith(".")
    return not hidden and (part == _ANY_DEPTH or fnmatchcase(name, part))
