"""Version folders: whole or absent, whatever happens to the process that makes them."""

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from slapshot.errors import InputError
from slapshot.store.folder import STORE_MARK, Store
from slapshot.store.recipe import Recipe
from slapshot.store.version_file import VERSION_FILE, damaged_files

RECIPE = Recipe("rollouts", {"seed": 1}, code="0" * 64)
UPSTREAM = Recipe("swings", {}, code="0" * 64)

# Writes a payload in two parts and is killed at the moment that the command line names.
KILLED = """
import os, signal, sys
from pathlib import Path
from slapshot.store import folder, version_file
from slapshot.store.recipe import Recipe

def die(*arguments):
    os.kill(os.getpid(), signal.SIGKILL)

root, recipe, moment, resume = sys.argv[1:]
if moment == "digest":
    version_file.content_digest = die
if moment == "rename":
    Path.rename = die
with folder.Store(Path(root)).new_version(Recipe.from_json(recipe), resume == "True") as out:
    (out / "first").write_text("one")
    if moment == "inside":
        die()
    (out / "second").write_text("two")
"""


def everything(store: Store) -> list[str]:
    """All files and folders in the store, hidden ones included."""
    return sorted(p.relative_to(store.root).as_posix() for p in store.root.rglob("*"))


def produce(store: Store, recipe: Recipe = RECIPE, resume: bool = False) -> Path:
    with store.new_version(recipe, resume) as out:
        (out / "first").write_text("one")
        (out / "second").write_text("two")
    return store.folder(recipe.stage, recipe.id)


def fail(store: Store, error: type[BaseException], resume: bool = False) -> None:
    with store.new_version(RECIPE, resume) as out:
        (out / "first").write_text("half")
        raise error("of a test")


def test_a_finished_version_is_whole_and_leaves_nothing_else(store):
    assert not store.is_whole(RECIPE.stage, RECIPE.id)
    folder = produce(store)
    assert store.is_whole(RECIPE.stage, RECIPE.id)
    name = f"rollouts/{RECIPE.id}"
    files = [f"{name}/{file}" for file in ("first", "second", VERSION_FILE)]
    assert everything(store) == [STORE_MARK, "rollouts", name, *files]
    version = json.loads((folder / VERSION_FILE).read_text())
    assert Recipe.from_json(json.dumps(version["recipe"])) == RECIPE
    assert version["id"] == RECIPE.id
    assert set(version["content"]) == {"first", "second"}
    assert [path for path, _ in store.versions()] == [folder]


def test_files_in_sub_folders_belong_to_the_content(store):
    with store.new_version(RECIPE) as out:
        (out / "deep/er").mkdir(parents=True)
        (out / "deep/er/file").write_text("x")
    folder = store.folder(RECIPE.stage, RECIPE.id)
    assert list(json.loads((folder / VERSION_FILE).read_text())["content"]) == ["deep/er/file"]
    (folder / "deep/er/file").unlink()
    assert not store.is_whole(RECIPE.stage, RECIPE.id)


@pytest.mark.parametrize("error", [ValueError, InputError, KeyboardInterrupt, SystemExit])
def test_an_exception_leaves_nothing(store, error):
    with pytest.raises(error):
        fail(store, error)
    assert everything(store) == [STORE_MARK, "rollouts"]
    assert damaged_files(produce(store)) == []


@pytest.mark.parametrize(
    ("error", "kept"), [(ValueError, True), (KeyboardInterrupt, True), (InputError, False)]
)
def test_a_stage_that_can_go_on_keeps_its_part_unless_the_input_was_bad(store, error, kept):
    with pytest.raises(error):
        fail(store, error, resume=True)
    assert not store.is_whole(RECIPE.stage, RECIPE.id)
    assert list(store.versions()) == []
    with store.new_version(RECIPE, resume=True) as out:
        assert (out / "first").exists() is kept


@pytest.mark.parametrize("moment", ["inside", "digest", "rename"])
@pytest.mark.parametrize("resume", [False, True])
def test_a_killed_process_leaves_no_version_and_a_rerun_makes_it(store, moment, resume):
    command = [sys.executable, "-c", KILLED, store.root, RECIPE.to_json(), moment, str(resume)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    assert not store.is_whole(RECIPE.stage, RECIPE.id)
    assert not store.is_being_made(RECIPE.stage, RECIPE.id)
    assert list(store.versions()) == []
    partial = store.root / f"rollouts/.partial-{RECIPE.id}"
    assert (partial / "first").read_text() == "one"

    with store.new_version(RECIPE, resume) as out:
        assert (out / "first").exists() is resume
        assert not (out / VERSION_FILE).exists()
        (out / "first").write_text("one")
        (out / "second").write_text("two")
    folder = store.folder(RECIPE.stage, RECIPE.id)
    reference = produce(Store(store.root.parent / "unbroken"))
    content = [json.loads((f / VERSION_FILE).read_text())["content"] for f in (folder, reference)]
    assert content[0] == content[1]
    assert store.is_whole(RECIPE.stage, RECIPE.id)
    assert damaged_files(folder) == []
    assert not partial.exists()


def test_the_lock_is_held_while_a_version_is_made_and_goes_with_it(store):
    assert not store.is_being_made(RECIPE.stage, RECIPE.id)
    with store.locked(RECIPE.stage, RECIPE.id):
        assert store.is_being_made(RECIPE.stage, RECIPE.id)
        assert not store.is_being_made(RECIPE.stage, "a" * 12)
    assert not store.is_being_made(RECIPE.stage, RECIPE.id)
    assert everything(store) == ["rollouts"]


@pytest.mark.parametrize("removed", ["first", VERSION_FILE])
def test_a_version_that_lost_a_file_is_not_whole_and_is_made_again(store, removed):
    folder = produce(store)
    (folder / removed).unlink()
    assert not store.is_whole(RECIPE.stage, RECIPE.id)
    produce(store)
    assert store.is_whole(RECIPE.stage, RECIPE.id)
    assert damaged_files(folder) == []


def test_an_unreadable_version_file_is_not_a_whole_version(store):
    folder = produce(store)
    (folder / VERSION_FILE).write_text('{"id":')
    assert not store.is_whole(RECIPE.stage, RECIPE.id)


def test_inputs_are_folders_by_role(store):
    folder = produce(store, UPSTREAM)
    recipe = replace(RECIPE, upstream={"pool": ("swings", UPSTREAM.id)})
    assert store.inputs(recipe) == {"pool": folder}
    assert store.inputs(RECIPE) == {}


def test_a_missing_input_names_the_command_that_makes_it(store):
    recipe = replace(RECIPE, upstream={"pool": ("swings", UPSTREAM.id)})
    with pytest.raises(InputError) as caught:
        store.inputs(recipe)
    message = str(caught.value)
    assert f"rollouts needs swings/{UPSTREAM.id}" in message
    assert "run `snakemake swings` first" in message
    assert "\n" not in message
