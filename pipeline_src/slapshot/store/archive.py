"""Archives of versions, to continue a run on another machine."""

import lzma
import shutil
import tarfile
import tempfile
from collections.abc import Collection
from pathlib import Path, PurePosixPath

from slapshot.errors import InputError, writing
from slapshot.store.folder import STORE_MARK, Store
from slapshot.store.version_file import REPAIR, damaged_files
from slapshot.whole_file import replacing


def pack(store: Store, file: Path, stages: Collection[str] = ()) -> list[str]:
    """Write finished versions to a compressed tar file; an existing file is replaced.

    Args:
        store: of the versions.
        file: to write.
        stages: whose versions are packed; all stages if empty.

    Returns:
        `stage/id` of each.

    Raises:
        InputError: a version is damaged, there are no versions, or the file cannot be written.
    """
    folders = [folder for folder in store.folders() if not stages or folder.parent.name in stages]
    if not folders:
        raise InputError(
            f"{store.root}: has no version of {', '.join(stages) or 'any stage'}; make one first"
        )
    for folder in folders:
        if damaged := damaged_files(folder):
            raise InputError(f"{folder / damaged[0]} is not what was written there; {REPAIR}")
    with writing(file), replacing(file) as aside, tarfile.open(aside, "w:xz") as archive:
        for folder in folders:
            archive.add(folder, arcname=f"{folder.parent.name}/{folder.name}")
    return [f"{folder.parent.name}/{folder.name}" for folder in folders]


def unpack(store: Store, file: Path) -> list[str]:
    """Add the versions of an archive to a store; versions that are complete there are not replaced.

    Each version of the archive is first checked against its digests.

    Returns:
        `stage/id` of each version that was added.

    Raises:
        InputError: the file is no archive of versions, or a version in it is damaged; nothing is added then.
    """
    if not file.is_file():
        raise InputError(f"{file} is missing; name a file that `slapshot versions pack` has written")
    with writing(store.root):
        store.root.mkdir(parents=True, exist_ok=True)
        aside = Store(Path(tempfile.mkdtemp(prefix=".unpacking-", dir=store.root)))
    try:
        with writing(store.root):
            _extract(file, aside.root)
        folders = list(aside.folders())
        damaged = [folder for folder in folders if damaged_files(folder)]
        if not folders or damaged:
            what = f"{damaged[0].parent.name}/{damaged[0].name} in it is" if damaged else "it is"
            raise InputError(f"{file}: {what} not what was packed; pack it again, or copy it once more")
        with writing(store.root):
            (store.root / STORE_MARK).touch()
            return [version for folder in folders if (version := _put(store, folder))]
    finally:
        shutil.rmtree(aside.root, ignore_errors=True)


def _extract(file: Path, folder: Path) -> None:
    """Write the files of an archive; nothing else may be in it, and nothing that leads out of the folder.

    Filters of `tarfile` do the same, but Python 3.11 has them from 3.11.4 on alone.
    """
    try:
        with tarfile.open(file, "r:xz") as archive:
            for member in archive:
                place = PurePosixPath(member.name)
                if place.is_absolute() or ".." in place.parts or not (member.isfile() or member.isdir()):
                    raise tarfile.TarError(f"{member.name!r} is no file of a version")
                content = archive.extractfile(member)
                if content is None:
                    (folder / place).mkdir(parents=True, exist_ok=True)
                else:
                    (folder / place).parent.mkdir(parents=True, exist_ok=True)
                    with content, (folder / place).open("wb") as out:
                        shutil.copyfileobj(content, out)
    except (tarfile.TarError, lzma.LZMAError, EOFError) as error:
        raise InputError(
            f"{file}: is no whole archive of versions ({error}); pack it again, or copy it once more"
        ) from None


def _put(store: Store, folder: Path) -> str | None:
    stage, version_id = folder.parent.name, folder.name
    with store.locked(stage, version_id):
        if store.is_whole(stage, version_id):
            return None
        final = store.folder(stage, version_id)
        if final.exists():  # incomplete: somebody removed files from it
            shutil.rmtree(final)
        folder.rename(final)
    return f"{stage}/{version_id}"
