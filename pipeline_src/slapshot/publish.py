"""Publish figures: check every version they depend on, copy them, and remove stale ones."""

import argparse
import json
import logging
import re
import shutil
import sys
from pathlib import Path

from slapshot.command import set_up_logging
from slapshot.errors import InputError, writing
from slapshot.store.folder import Store
from slapshot.store.lock import held
from slapshot.store.version_file import REPAIR, damaged_files

log = logging.getLogger("slapshot")

MANIFEST = "versions.json"
_PUBLISHED = re.compile(r"^([A-Z]\d+-|claims\.)")
_SHOWN = ("figure/", "claims/")  # stages whose files are published
_SMALL_PROOF = "score/"  # stage whose files go to a folder of their own
SMALL_PROOF = "small-proof"


def publish(store: Store, versions: list[str], target: Path, available: bool = False) -> None:
    """Copy the files of all figures and of the claims to `target`.

    Args:
        store: of the versions.
        versions: `<stage>/<id>` of everything in the configuration.
        target: folder; files there that are named like a figure but are not published now are removed.
        available: publish the existing versions although some are missing; files published before are kept
            only if they belong to a version that is missing now.

    Raises:
        InputError: a version is missing or damaged, or `target` cannot be written.
    """
    for version in versions:
        stage, version_id = version.split("/")
        if not store.is_whole(stage, version_id):
            if available:
                continue
            raise InputError(f"{store.root / version} is missing: run `snakemake figures`")
        damaged = damaged_files(store.folder(stage, version_id))
        if damaged:
            raise InputError(f"{store.root / version / damaged[0]} is not what was written there; {REPAIR}")
    with writing(target):
        target.mkdir(parents=True, exist_ok=True)
        with held(target / ".lock", f"publishes to {target}"):
            _publish_whole(store, versions, target)


def _publish_whole(store: Store, versions: list[str], target: Path) -> None:
    """Copy the files of all complete figure versions, and remove published files of no version."""
    manifest: dict[str, str] = {}
    for version in versions:
        if version.startswith(_SHOWN) and not store.is_whole(*version.split("/")):
            before = _published_before(target)
            manifest |= {name: v for name, v in before.items() if v == version}
        elif version.startswith(_SHOWN):
            for file in sorted((store.root / version).iterdir()):
                if _PUBLISHED.match(file.name):
                    copy_file(file, target / file.name)
                    manifest[file.name] = version
        elif version.startswith(_SMALL_PROOF) and store.is_whole(*version.split("/")):
            manifest |= _publish_small_proof(store.root / version, version, target / SMALL_PROOF)
    for file in target.iterdir():
        if not file.is_file() or file.name in manifest:
            continue
        if _PUBLISHED.match(file.name.removeprefix(".")):  # with a dot: an interrupted copy
            file.unlink()
            log.info("removed %s: it belongs to an earlier configuration", file)
    text = json.dumps(manifest, indent=2, sort_keys=True) + "\n"
    aside = target / f".{MANIFEST}"
    aside.write_text(text)
    aside.rename(target / MANIFEST)
    log.info("%d files in %s", len(manifest), target)


def _publish_small_proof(folder: Path, version: str, target: Path) -> dict[str, str]:
    """Copy table, page and figures; return name -> version."""
    target.mkdir(exist_ok=True)
    names = [f.name for f in sorted(folder.iterdir()) if f.suffix in {".csv", ".md", ".png", ".pdf"}]
    for name in names:
        copy_file(folder / name, target / name)
    for file in target.iterdir():
        if file.name.removeprefix(".") not in names:
            file.unlink()
    return {f"{target.name}/{name}": version for name in names}


def _published_before(target: Path) -> dict[str, str]:
    path = target / MANIFEST
    return json.loads(path.read_text()) if path.is_file() else {}


def copy_file(file: Path, target: Path) -> None:
    """Copy a file atomically; unchanged files keep their modification time."""
    if target.is_file() and target.read_bytes() == file.read_bytes():
        return
    aside = target.with_name(f".{target.name}")
    shutil.copyfile(file, aside)
    aside.rename(target)


def main() -> None:
    """Command line that the workflow calls."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.publish")
    parser.add_argument("versions", nargs="+", help="<stage>/<id>")
    parser.add_argument("--name", required=True, help="of the configuration")
    parser.add_argument("--available", action="store_true", help="although something is missing")
    parser.add_argument("--store", type=Path, default=Path("data/store"))
    parser.add_argument("--log", type=Path)
    args = parser.parse_args()
    target = Path("figures") if args.name == "default" else Path("figures") / args.name
    try:
        set_up_logging("figures", args.log)
        publish(Store(args.store), args.versions, target, args.available)
    except InputError as error:
        log.error("%s", error)
        sys.exit(1)


if __name__ == "__main__":
    main()
