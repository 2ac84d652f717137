"""Version folders: written aside, renamed when complete, so that a folder that exists is whole.

Layout under the store's root: `<stage>/<id>/` holds the payload and version.json;
`<stage>/.partial-<id>/` is work in progress. `.slapshot-store` says that the folder is a store, and that
versions may be removed from it.
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
from typing import Any

from slapshot.errors import InputError
from slapshot.store.lock import held
from slapshot.store.recipe import ID_LENGTH, Recipe
from slapshot.store.version_file import (
    REPAIR,
    VERSION_FILE,
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
        """Where that version is, or would be."""
        return self.root / stage / version_id

    def partial(self, stage: str, version_id: str) -> Path:
        """The folder in which the version is made."""
        return self.root / stage / f"{PARTIAL}{version_id}"

    def lock(self, stage: str, version_id: str) -> Path:
        """The file that a process holds a lock on while it makes the version."""
        return self.root / stage / f".lock-{version_id}"

    def locked(self, stage: str, version_id: str) -> AbstractContextManager[None]:
        """Hold the version's lock, after waiting for a process that makes the version."""
        path = self.lock(stage, version_id)
        path.parent.mkdir(parents=True, exist_ok=True)
        return held(path, f"makes {stage}/{version_id}")

    def is_being_made(self, stage: str, version_id: str) -> bool:
        """True while a process makes the version."""
        path = self.lock(stage, version_id)
        if not path.is_file():
            return False
        with path.open("r") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return True
        return False

    def find(self, stage: str, version_id: str) -> dict[str, Any] | None:
        """The version.json of a version; None if there is none, or not what was written."""
        try:
            return read_version_file(self.folder(stage, version_id))
        except InputError:
            return None

    def is_whole(self, stage: str, version_id: str) -> bool:
        """True if the version is there with all its files.

        By construction folders are whole or absent; this sees what somebody removed by hand, and a
        damaged version.json. `damaged_files` sees every flipped bit, and reads all.
        """
        version = self.find(stage, version_id)
        folder = self.folder(stage, version_id)
        return version is not None and all((folder / name).is_file() for name in version["content"])

    def inputs(self, recipe: Recipe) -> dict[str, Path]:
        """Role -> folder of the versions that a recipe reads, each held against its digests.

        All their files are read for that, at about 1 GB/s: a stage must not build on a flipped bit.

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
        """Folders of all finished versions, whole or damaged; never what a link leads to."""
        for path in sorted(self.root.glob(f"*/*/{VERSION_FILE}")):
            folder = path.parent
            linked = folder.is_symlink() or folder.parent.is_symlink()
            if _ID.fullmatch(folder.name) and not linked:
                yield folder

    def check_mark(self) -> None:
        """Whether anything may be removed here: only from a folder that bears the store's mark.

        Raises:
            InputError: it is none.
        """
        if self.root.is_dir() and not (self.root / STORE_MARK).is_file():
            raise InputError(
                f"{self.root}: has no {STORE_MARK}, so nothing is removed from it; if it is a store of "
                "earlier code, run a stage that writes there, or create that file: "
                f"touch {self.root / STORE_MARK}"
            )

    def versions(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Every version whose version.json is what was written: its folder and that."""
        for folder in self.folders():
            version = self.find(folder.parent.name, folder.name)
            if version is not None:
                yield folder, version

    def remove(self, stage: str, version_id: str) -> None:
        """Remove a version, or what an interrupted run left of it.

        Whenever this is interrupted, what is left is not taken for a whole version and can be removed.
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
        """A folder to write the payload to; when the block ends without error it becomes the version.

        Hold the version's lock meanwhile: two processes must not write to one folder.

        Args:
            recipe: what the version is made from.
            resume: keep what an interrupted run left there, and what this one leaves if it fails.
            label: what the version is, in words.
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
            # Bad input leaves nothing to go on from; a crash, a full disk or Ctrl-C does, if the stage can.
            if not resume or isinstance(error, InputError):
                shutil.rmtree(partial, ignore_errors=True)
            raise
        if final.exists():  # but not whole: somebody removed files from it
            shutil.rmtree(final)
        partial.rename(final)


def _remove(path: Path) -> None:
    """Remove a file or a folder if it is there; of a link, the link alone."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _sync(folder: Path) -> None:
    """Push a folder's files to disk before its name says that they are whole."""
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb") as file:
                os.fsync(file.fileno())
