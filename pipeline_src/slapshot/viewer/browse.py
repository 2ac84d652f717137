"""`slapshot browse`: the gallery of hits in the Rerun viewer, or one hit alone."""

import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Event
from urllib.parse import urlsplit

from slapshot.config.results import ViewerSettings
from slapshot.errors import InputError
from slapshot.store.folder import Store
from slapshot.store.recipe import Recipe
from slapshot.viewer.gallery import HOST, serve
from slapshot.viewer.hit_recording import HITS_FOLDER, LAYOUT_FILE, SCENE_FILE, read_index


def browse(recipes: Iterable[Recipe], make: str, store: Store, hit: str | None, port: int) -> int:
    """Open the gallery of a configuration's hits, or only `hit`.

    Args:
        recipes: of the stage `viewer`, one a domain.
        make: command that makes their versions, for the message where there are none.
        store: of versions.
        hit: part of the name of a hit.
        port: of the gallery; 0 for any that is free.

    Returns:
        The exit code.

    Raises:
        InputError: the version is not made yet, or no hit is called so.
    """
    folders = find_folders(recipes, make, store)
    if hit:
        return show(find_hit(folders, hit))
    with serve(folders, port) as address, suppress(KeyboardInterrupt):
        print(f"gallery: {address}", flush=True)
        if has_display():
            return _show([address])
        port = urlsplit(address).port or port
        print(
            f"There is no display here. On this machine's desktop type `rerun {address}`; on another one\n"
            f"type `ssh -L {port}:{HOST}:{port} THIS_MACHINE` first. Ctrl-C ends the gallery.",
            flush=True,
        )
        Event().wait()
    return 0


def show(file: Path) -> int:
    """One hit alone; returns the exit code."""
    return _show(hit_arguments(file))


def find_folders(recipes: Iterable[Recipe], make: str, store: Store) -> dict[str, Path]:
    """Domain -> folder of its version, of all domains whose hits are made (see `browse`).

    Raises:
        InputError: none is.
    """
    wanted = list(recipes)
    made = {
        r.settings(ViewerSettings).domain: store.folder(r.stage, r.id)
        for r in wanted
        if store.is_whole(r.stage, r.id)
    }
    if not made:
        missing = " and ".join(f"{recipe.stage}/{recipe.id}" for recipe in wanted)
        raise InputError(
            f"browse: there are no hits to see yet (no {missing} in {store.root}): run `{make}` first"
        )
    return made


def find_hit(folders: Mapping[str, Path], part: str) -> Path:
    """File of the only hit with `part` in its name or title.

    Raises:
        InputError: there is none, or more than one.
    """
    hits = [(folder / hit["file"], hit) for folder in folders.values() for hit in read_index(folder)["hits"]]
    found = [file for file, hit in hits if part in hit["recording_id"] or part in hit["title"]]
    exact = [file for file in found if file.stem == part]
    if len(exact or found) == 1:
        return (exact or found)[0]
    names = ", ".join(file.stem for file in (found or [file for file, _ in hits])[:5])
    some = f"{len(found)} hits are" if found else "no hit is"
    raise InputError(f"browse: {some} called {part!r}; give more of a name, for example of: {names}, ...")


def hit_arguments(file: Path) -> list[str]:
    """What the `rerun` command needs to show a hit: with the scene and the layout, if they lie beside it."""
    version = file.absolute().parent.parent
    if file.absolute().parent.name != HITS_FOLDER or not (version / SCENE_FILE).is_file():
        return [str(file)]
    return ["--asset", str(version / SCENE_FILE), str(version / LAYOUT_FILE), str(file)]


def has_display() -> bool:
    """True if a window can be opened."""
    desktop = sys.platform in {"darwin", "win32"}
    return desktop or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _show(arguments: list[str]) -> int:
    """Run the viewer until it is closed; without a display, say how."""
    if not has_display():
        print(f"There is no display here; where there is one, type:\nrerun {' '.join(arguments)}")
        return 0
    # The viewer listens too: for anybody on the network, unless it is told not to.
    command = [sys.executable, "-m", "rerun", "--bind", HOST, "--port", "auto", *arguments]
    with suppress(KeyboardInterrupt):  # which the viewer gets too
        return subprocess.run(command, check=False).returncode
    return 0
