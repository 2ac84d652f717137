"""Version folders: written aside, renamed when complete, so that a folder that exists is whole.

Layout under the store's root: `<stage>/<id>/` holds the payload and version.json;
`<stage>/.partial-<id>/` is work in progress; `<stage>/<id>.ok` is a mark for Snakemake, which would
delete and half-create the folders themselves.
"""

import fcntl
import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from slapshot.errors import InputError, writing
from slapshot.store.content import content_digest
from slapshot.store.lock import held
from slapshot.store.recipe import Recipe, canonical_json

VERSION_FILE = "version.json"


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

    def mark(self, stage: str, version_id: str) -> Path:
        """The file whose existence tells Snakemake that the version is there."""
        return self.root / stage / f"{version_id}.ok"

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

    def is_whole(self, stage: str, version_id: str) -> bool:
        """True if the version is there with all its files.

        By construction folders are whole or absent; this sees what somebody removed by hand.
        """
        folder = self.folder(stage, version_id)
        try:
            content = json.loads((folder / VERSION_FILE).read_text())["content"]
        except (OSError, ValueError):
            return False
        return all((folder / name).is_file() for name in content)

    def put_mark(self, stage: str, version_id: str) -> None:
        """Tell Snakemake that the version is there."""
        mark = self.mark(stage, version_id)
        if not mark.exists():  # a finished store may be read-only
            mark.write_text(f"{version_id}\n")

    def drop_stale_marks(self, versions: dict[str, set[str]]) -> None:
        """Remove marks of versions whose folder is gone, so that they are made again.

        Raises:
            InputError: there is such a mark, but it cannot be removed.
        """
        for stage, ids in versions.items():
            for version_id in ids:
                mark = self.mark(stage, version_id)
                # In this order: a version that another process finishes right now is whole before its mark.
                if mark.exists() and not self.is_whole(stage, version_id):
                    with writing(mark):
                        mark.unlink(missing_ok=True)

    def inputs(self, recipe: Recipe) -> dict[str, Path]:
        """Role -> folder of the versions that a recipe reads.

        Raises:
            InputError: one of them has not been made.
        """
        folders = {}
        for role, (stage, version_id) in recipe.upstream.items():
            if not self.is_whole(stage, version_id):
                raise InputError(
                    f"{recipe.stage} needs {stage}/{version_id}, which is not in {self.root}: "
                    f"run `snakemake {stage}` first"
                )
            folders[role] = self.folder(stage, version_id)
        return folders

    def versions(self) -> Iterator[tuple[Path, dict]]:
        """Every whole version: its folder and its version.json."""
        for path in sorted(self.root.glob(f"*/*/{VERSION_FILE}")):
            if not path.parent.name.startswith("."):
                yield path.parent, json.loads(path.read_text())

    @contextmanager
    def new_version(self, recipe: Recipe, resume: bool = False) -> Iterator[Path]:
        """A folder to write the payload to; when the block ends without error it becomes the version.

        Hold the version's lock meanwhile: two processes must not write to one folder.

        Args:
            recipe: what the version is made from.
            resume: keep what an interrupted run left there, and what this one leaves if it fails.
        """
        final = self.folder(recipe.stage, recipe.id)
        partial = final.with_name(f".partial-{recipe.id}")
        final.parent.mkdir(parents=True, exist_ok=True)
        if not resume:
            shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(exist_ok=True)
        (partial / VERSION_FILE).unlink(missing_ok=True)  # of a run that ended just before the rename
        started = time.time()
        try:
            yield partial
            version = {
                "id": recipe.id,
                "recipe": json.loads(recipe.to_json()),
                "content": {
                    path.relative_to(partial).as_posix(): content_digest(path)
                    for path in sorted(partial.rglob("*"))
                    if path.is_file()
                },
                "seconds": round(time.time() - started, 1),
                "made_at": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            }
            (partial / VERSION_FILE).write_text(canonical_json(version) + "\n")
            _sync(partial)
        except BaseException as error:
            # Bad input leaves nothing to go on from; a crash, a full disk or Ctrl-C does, if the stage can.
            if not resume or isinstance(error, InputError):
                shutil.rmtree(partial, ignore_errors=True)
            raise
        if final.exists():  # but not whole: somebody removed files from it
            shutil.rmtree(final)
        partial.rename(final)


def _sync(folder: Path) -> None:
    """Push a folder's files to disk before its name says that they are whole."""
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb") as file:
                os.fsync(file.fileno())
