"""Version folders, written under another name and renamed when complete: an existing one is complete.

Layout under the store's root: `<stage>/<id>/` holds the payload and version.json;
`<stage>/.partial-<id>/` is work in progress. The file `.slapshot-store` marks the folder as a store, from
which versions may be removed.
"""

import fcntl
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from slapshot.errors import InputError
from slapshot.store.lock import held
from slapshot.store.recipe import ID_LENGTH, Recipe
from slapshot.store.version_file import (
    REPAIR,
    VERSION_FILE,
    VersionRecord,
    damaged_files,
    digest_of_content,
    read_version_file,
    write_version_file,
)

_ID = re.compile(f"[0-9a-f]{{{ID_LENGTH}}}")
STORE_MARK = ".slapshot-store"
PARTIAL = ".partial-"


@dataclass(frozen=True)
class Store:
    """A folder of versions.

    Attributes:
        root: usually data/store.
    """

    root: Path

    def folder(self, stage: str, version_id: str) -> Path:
        """Folder of a version, whether or not it exists."""
        return self.root / stage / version_id

    def partial(self, stage: str, version_id: str) -> Path:
        """Folder of a version while it is being made."""
        return self.root / stage / f"{PARTIAL}{version_id}"

    def lock(self, stage: str, version_id: str) -> Path:
        """File that a process locks while it makes the version."""
        return self.root / stage / f".lock-{version_id}"

    def locked(self, stage: str, version_id: str) -> AbstractContextManager[None]:
        """Hold the version's lock, after waiting for any process that is making the version."""
        path = self.lock(stage, version_id)
        path.parent.mkdir(parents=True, exist_ok=True)
        return held(path, f"makes {stage}/{version_id}")

    def is_being_made(self, stage: str, version_id: str) -> bool:
        """True while a process is making the version."""
        path = self.lock(stage, version_id)
        if not path.is_file():
            return False
        with path.open("r") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return True
        return False

    def find(self, stage: str, version_id: str) -> VersionRecord | None:
        """The version.json of a version; None if it is missing or damaged."""
        try:
            return read_version_file(self.folder(stage, version_id))
        except InputError:
            return None

    def is_whole(self, stage: str, version_id: str) -> bool:
        """True if the version exists with all its files.

        By construction folders are complete or absent; this detects files that somebody removed by hand, and
        a damaged version.json. `damaged_files` detects every flipped bit, but has to read all files.
        """
        version = self.find(stage, version_id)
        folder = self.folder(stage, version_id)
        return version is not None and all((folder / name).is_file() for name in version["content"])

    def inputs(self, recipe: Recipe) -> dict[str, Path]:
        """Role -> folder of the versions that a recipe reads, each checked against its digests.

        This reads all their files, at about 1 GB/s: a stage must not build on a flipped bit.

        Raises:
            InputError: one of them has not been made, or is damaged.
        """
        folders = {role: self.folder(*version) for role, version in recipe.upstream.items()}
        for folder in dict.fromkeys(folders.values()):
            damaged = damaged_files(folder) if folder.is_dir() else []
            gone = [name for name in damaged if not (folder / name).is_file()]
            if not folder.is_dir() or gone:
                stage = folder.parent.name
                raise InputError(
                    f"{recipe.stage} needs {stage}/{folder.name}, which is not in {self.root}: "
                    f"run `snakemake {stage}` first"
                )
            if damaged:
                raise InputError(f"{folder / damaged[0]} is not what was written there; {REPAIR}")
        return folders

    def folders(self) -> Iterator[Path]:
        """Folders of all finished versions, complete or damaged; symbolic links are not followed."""
        for path in sorted(self.root.glob(f"*/*/{VERSION_FILE}")):
            folder = path.parent
            linked = folder.is_symlink() or folder.parent.is_symlink()
            if _ID.fullmatch(folder.name) and not linked:
                yield folder

    def check_mark(self) -> None:
        """Check that versions may be removed here: the folder must be marked as a store.

        Raises:
            InputError: it is not.
        """
        if self.root.is_dir() and not (self.root / STORE_MARK).is_file():
            raise InputError(
                f"{self.root}: has no {STORE_MARK}, so nothing is removed from it; if it is a store of "
                "earlier code, run a stage that writes there, or create that file: "
                f"touch {self.root / STORE_MARK}"
            )

    def versions(self) -> Iterator[tuple[Path, VersionRecord]]:
        """Folder and version.json of every version whose version.json is undamaged."""
        for folder in self.folders():
            version = self.find(folder.parent.name, folder.name)
            if version is not None:
                yield folder, version

    def remove(self, stage: str, version_id: str) -> None:
        """Remove a version, or what an interrupted run left of it.

        If this is interrupted, the remainder is never taken for a complete version, and can be removed later.
        """
        folder = self.folder(stage, version_id)
        if folder.is_dir() and not folder.is_symlink():
            for path in folder.iterdir():
                if path.name != VERSION_FILE:
                    _remove(path)
        for path in (folder, self.partial(stage, version_id), self.lock(stage, version_id)):
            _remove(path)

    @contextmanager
    def new_version(self, recipe: Recipe, resume: bool = False, label: str = "") -> Iterator[Path]:
        """A folder to write the payload to; it becomes the version when the block ends without error.

        The caller must hold the version's lock: two processes must not write to one folder.

        Args:
            recipe: of the version.
            resume: keep files of an interrupted run, and those of this run if it fails.
            label: of the version, for people.
        """
        final = self.folder(recipe.stage, recipe.id)
        partial = self.partial(recipe.stage, recipe.id)
        final.parent.mkdir(parents=True, exist_ok=True)
        if not (self.root / STORE_MARK).exists():
            (self.root / STORE_MARK).write_text("A store of slapshot: versions are made and removed here.\n")
        upstream = {role: self.find(*version) for role, version in recipe.upstream.items()}
        inputs = {role: digest_of_content(version) for role, version in upstream.items() if version}
        if not resume:
            shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(exist_ok=True)
        (partial / VERSION_FILE).unlink(missing_ok=True)  # of a run that ended just before the rename
        started = time.time()
        try:
            yield partial
            write_version_file(partial, recipe, inputs, time.time() - started, label)
            _sync(partial)
        except BaseException as error:
            # A stage that can resume continues after a crash, a full disk or Ctrl-C, but not after bad input.
            if not resume or isinstance(error, InputError):
                shutil.rmtree(partial, ignore_errors=True)
            raise
        if final.exists():  # incomplete: somebody removed files from it
            shutil.rmtree(final)
        partial.rename(final)


def _remove(path: Path) -> None:
    """Remove a file or a folder if it exists; a symbolic link is removed without its target."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _sync(folder: Path) -> None:
    """Flush a folder's files to disk, before renaming the folder declares them complete."""
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb") as file:
                os.fsync(file.fileno())
