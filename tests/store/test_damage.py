"""A bit that flips in the store: seen before anything is made from it, and mended by a repair."""

import functools
import hashlib
import json
import os
import random
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml
from safetensors.numpy import save_file
from slapshot import cli
from slapshot.command import Run, make_version
from slapshot.config.files import load_config
from slapshot.dag import make_plan
from slapshot.errors import InputError
from slapshot.parquet import write_table
from slapshot.scenes import __main__ as scene_stage
from slapshot.store.code_dependencies import code_digest, imported_libraries
from slapshot.store.folder import STORE_MARK, Store
from slapshot.store.recipe import Recipe, canonical_json
from slapshot.store.verify import find_problems, problem_of, remove_damaged
from slapshot.store.version_file import VERSION_FILE, damaged_files, read_version_file
from slapshot.trajectories import demonstrations, fit

ROOT = Path(__file__).parents[2]
FLIPS = 300
REPAIR = "run `slapshot versions verify --repair`"
MADE = Recipe("made", {"low": 1e-05, "name": "ä"}, code="0" * 64)
READER = Recipe("reader", {}, code="1" * 64, upstream={"made": ("made", MADE.id)})


def flip(path: Path, rng: random.Random) -> None:
    broken = bytearray(path.read_bytes())
    broken[rng.randrange(len(broken))] ^= 1 << rng.randrange(8)
    path.write_bytes(broken)


def every_kind_of_file(run: Run) -> None:
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"x": rng.normal(size=500), "n": rng.integers(0, 9, 500)})
    write_table(frame, run.out / "table.parquet")
    frame.to_csv(run.out / "table.csv")
    save_file({"weights": rng.normal(size=(20, 20))}, run.out / "model.safetensors")
    (run.out / "numbers.json").write_text(json.dumps(list(rng.normal(size=50))))
    (run.out / "deep").mkdir()
    (run.out / "deep/page.md").write_text("words " * 50)
    figure = plt.figure(figsize=(1, 1))
    figure.savefig(run.out / "figure.png")
    plt.close(figure)


def write(run: Run) -> None:
    (run.out / "payload").write_text("whole")


def test_of_300_flips_over_the_files_of_a_store_none_is_silent(store):
    folder = make_version(store, MADE, every_kind_of_file, 1)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    assert len(files) == 7
    rng = random.Random(1)
    seen: Counter[str] = Counter()
    for _ in range(FLIPS):
        file = rng.choice(files)
        whole = file.read_bytes()
        flip(file, rng)
        with pytest.raises(InputError) as caught:
            make_version(store, READER, write, 1)
        assert str(caught.value).startswith(f"{file} is not what was written there; {REPAIR} (with your")
        assert "\n" not in str(caught.value)
        name = file.relative_to(folder).as_posix()
        assert problem_of(store, ("made", MADE.id)) == f"damaged: {name} not as written"
        file.write_bytes(whole)
        seen[name] += 1
    assert set(seen) == {path.relative_to(folder).as_posix() for path in files}
    make_version(store, READER, write, 1)
    assert problem_of(store, ("reader", READER.id)) is None


@pytest.mark.parametrize("other", ["stage", "id"])
def test_a_version_under_another_name_is_not_what_was_written(store, other):
    folder = make_version(store, MADE, write, 1)
    moved = folder.with_name("a" * 12) if other == "id" else store.folder("other", MADE.id)
    moved.parent.mkdir(exist_ok=True)
    folder.rename(moved)
    assert damaged_files(moved) == [VERSION_FILE]
    assert not store.is_whole(moved.parent.name, moved.name)


def as_earlier_code_wrote_it(folder: Path) -> None:
    version = json.loads((folder / VERSION_FILE).read_text())
    for key in ("bytes", "inputs", "label", "checksum"):
        del version[key]
    (folder / VERSION_FILE).write_text(canonical_json(version) + "\n")


def test_versions_of_earlier_code_are_read_and_held_against_their_content(store):
    folder = make_version(store, MADE, every_kind_of_file, 1)
    as_earlier_code_wrote_it(folder)
    assert store.is_whole("made", MADE.id)
    make_version(store, READER, write, 1)
    assert find_problems(store, [("made", MADE.id), ("reader", READER.id)]) == {}
    (folder / "deep/page.md").write_text("other words")
    assert problem_of(store, ("made", MADE.id)) == "damaged: deep/page.md not as written"


@pytest.mark.parametrize("key", ["bytes", "inputs", "checksum"])
def test_a_version_file_that_lost_a_key_is_not_taken_for_one_of_earlier_code(store, key):
    folder = make_version(store, MADE, write, 1)
    version = json.loads((folder / VERSION_FILE).read_text())
    del version[key]
    (folder / VERSION_FILE).write_text(canonical_json(version) + "\n")
    assert damaged_files(folder) == [VERSION_FILE]


@pytest.mark.parametrize(
    "text", ["", "[]", "null", "[" * 100_000, '{"id":1e999}', '{"id":"\\ud800"}', "\xff"]
)
def test_whatever_a_version_file_holds_it_is_one_line(store, text):
    folder = make_version(store, MADE, write, 1)
    (folder / VERSION_FILE).write_text(text, "latin-1")
    with pytest.raises(InputError, match=r"version\.json is not what was written there; run"):
        read_version_file(folder)
    assert list(store.versions()) == []
    assert list(store.folders()) == [folder]


def test_the_same_number_written_otherwise_is_a_flipped_bit(store):
    folder = make_version(store, MADE, write, 1)
    text = (folder / VERSION_FILE).read_text()
    assert text.count("1e-05") == 1
    (folder / VERSION_FILE).write_text(text.replace("1e-05", "1E-05"))
    assert damaged_files(folder) == [VERSION_FILE]


def test_a_version_made_from_another_content_than_is_there_now_is_found(store):
    folder = make_version(store, MADE, write, 1)
    reader = make_version(store, READER, write, 1)
    content = json.loads((folder / VERSION_FILE).read_text())["content"]
    expected = hashlib.sha256(canonical_json(content).encode()).hexdigest()
    assert read_version_file(reader)["inputs"] == {"made": expected}
    shutil.rmtree(folder)
    assert problem_of(store, ("reader", READER.id)) is None  # nobody can tell
    make_version(store, MADE, every_kind_of_file, 1)
    said = f"made from another content of made/{MADE.id} than is there now"
    assert problem_of(store, ("reader", READER.id)) == said
    shutil.rmtree(folder)
    make_version(store, MADE, write, 1)
    assert problem_of(store, ("reader", READER.id)) is None


def chain(store: Store) -> dict[str, Recipe]:
    """a -> b -> d, a -> c -> d, e alone, each with its mark."""
    made: dict[str, Recipe] = {}
    for name, above in (("a", ""), ("b", "a"), ("c", "a"), ("d", "bc"), ("e", "")):
        recipe = Recipe(name, {}, code="0" * 64, upstream={up: (up, made[up].id) for up in above})
        make_version(store, recipe, write, 1)
        made[name] = recipe
    return made


def there(store: Store) -> set[str]:
    """Stages of the versions, marks and leftovers that are there."""
    return {path.parent.name for path in store.root.glob("*/*")}


@pytest.mark.parametrize(
    ("damaged", "removed"), [("a", ["d", "c", "b", "a"]), ("b", ["d", "b"]), ("d", ["d"]), ("e", ["e"])]
)
def test_a_repair_removes_what_is_damaged_and_all_that_was_made_from_it(store, damaged, removed):
    made = chain(store)
    (store.folder(damaged, made[damaged].id) / "payload").write_text("whola")
    # Asked for is one version alone; who asks for the others does not matter.
    problems = find_problems(store, [(damaged, made[damaged].id)])
    assert problems == {(damaged, made[damaged].id): "damaged: payload not as written"}
    done = remove_damaged(store, problems, [])
    assert [stage for stage, _ in done] == removed
    assert done[damaged, made[damaged].id] == "damaged: payload not as written"
    assert {done[s, made[s].id] for s in removed[:-1]} <= {
        f"made from {stage}/{made[stage].id}" for stage in "abc"
    }
    assert there(store) == set("abcde") - set(removed)
    assert remove_damaged(store, find_problems(store, [(r.stage, r.id) for r in made.values()]), []) == {}


def test_a_repair_that_is_interrupted_finds_the_rest_again(store, monkeypatch):
    made = chain(store)
    (store.folder("a", made["a"].id) / "payload").write_text("whola")
    asked = [(recipe.stage, recipe.id) for recipe in made.values()]
    remove = Store.remove
    for kept in (3, 2, 1):
        left = iter([True])

        def once(store: Store, stage: str, version_id: str, left=left) -> None:
            if not next(left, False):
                raise KeyboardInterrupt
            remove(store, stage, version_id)

        monkeypatch.setattr(Store, "remove", once)
        with pytest.raises(KeyboardInterrupt):
            remove_damaged(store, find_problems(store, asked), [])
        assert len(there(store) & set("abcd")) == kept
    monkeypatch.undo()
    remove_damaged(store, find_problems(store, asked), [])
    assert there(store) == {"e"}


def test_a_repair_removes_versions_that_nobody_can_read_and_leftovers_but_not_what_is_being_made(store):
    made = chain(store)
    (store.folder("b", made["b"].id) / VERSION_FILE).write_text("{}")
    later = Recipe("f", {}, code="0" * 64, upstream={"b": ("b", made["b"].id)})
    busy = replace(later, stage="g")
    for recipe in (later, busy):
        store.partial(recipe.stage, recipe.id).mkdir(parents=True)
    problems = find_problems(store, [])
    assert problems == {("b", made["b"].id): "damaged: version.json not as written"}
    with store.locked(busy.stage, busy.id):
        done = remove_damaged(store, problems, [later, busy])
        assert {stage for stage, _ in done} == {"b", "d", "f"}
        assert there(store) == {"a", "c", "e", "g"}


def test_of_a_linked_version_a_repair_removes_the_link_alone(store, tmp_path):
    folder = make_version(store, MADE, write, 1)
    elsewhere = tmp_path / "elsewhere" / "made" / MADE.id
    elsewhere.parent.mkdir(parents=True)
    folder.rename(elsewhere)
    folder.symlink_to(elsewhere)
    store.remove("made", MADE.id)
    assert not folder.is_symlink()
    assert (elsewhere / "payload").read_text() == "whole"


STAGES = {
    "scene/hockey": scene_stage.produce,
    "demonstrations/hockey": demonstrations.produce,
    "trajectory_model/hockey": fit.produce,
}


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """A small configuration in a copy of the repository's."""
    folder = tmp_path_factory.mktemp("small")
    shutil.copytree(ROOT / "config", folder / "config")
    shutil.copytree(ROOT / "workflow/schemas", folder / "workflow/schemas")
    config = yaml.safe_load((ROOT / "config/tiny.yaml").read_text())
    config["domains"]["hockey"]["demonstrations"]["count"] = 256
    config["domains"]["hockey"]["trajectory_model"] |= {"steps": 20, "hidden": [16]}
    path = folder / "config/small.yaml"
    path.write_text(yaml.safe_dump(config))
    return path


@pytest.fixture(scope="module")
def clean(small) -> tuple[dict[str, Recipe], Store]:
    """Recipes of the small configuration, and the first three stages run for real."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(small.parents[1])
        recipes = make_plan(load_config(small)).recipes
    store = Store(small.parents[1] / "clean")
    for label, produce in STAGES.items():
        make_version(store, recipes[label], produce, 2)
    return recipes, store


def run_command(monkeypatch, *arguments: str | Path) -> int:
    monkeypatch.setattr("sys.argv", ["slapshot", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


@pytest.mark.parametrize("poisoned", [False, True])
def test_after_a_flip_and_a_repair_everything_is_as_if_there_had_been_none(
    small, clean, store, monkeypatch, capsys, poisoned
):
    """`poisoned`: code that checks nothing has made a model from the damaged demonstrations before."""
    monkeypatch.chdir(small.parents[1])
    recipes, unbroken = clean
    demos, model = recipes["demonstrations/hockey"], recipes["trajectory_model/hockey"]
    digest, libraries = functools.cache(code_digest), functools.cache(imported_libraries)
    monkeypatch.setattr("slapshot.store.recipe.code_digest", digest)  # no code changes here
    monkeypatch.setattr("slapshot.store.recipe.imported_libraries", libraries)

    def make(store: Store, label: str) -> dict[str, str]:
        return read_version_file(make_version(store, recipes[label], STAGES[label], 2))["content"]

    expected = {label: make(unbroken, label) for label in STAGES}
    shutil.copytree(unbroken.root, store.root)
    store.remove(model.stage, model.id)
    file = store.folder("demonstrations", demos.id) / "demonstrations.parquet"
    broken = bytearray(file.read_bytes())
    broken[len(broken) // 3] ^= 1
    file.write_bytes(broken)
    if poisoned:
        with monkeypatch.context() as patch:
            patch.setattr("slapshot.store.folder.damaged_files", lambda folder: [])
            patch.setattr("slapshot.trajectories.fit.read_table", pq.read_table)
            assert make(store, "trajectory_model/hockey") != expected["trajectory_model/hockey"]
    else:
        with pytest.raises(InputError) as caught:
            make(store, "trajectory_model/hockey")
        assert str(caught.value).startswith(
            f"{file} is not what was written there; {REPAIR} (with your --config"
        )
        assert not store.folder(model.stage, model.id).exists()

    verify = ("versions", "verify", "--store", store.root, "--config", small)
    assert run_command(monkeypatch, *verify) == 1
    assert f"demonstrations/hockey: damaged: {file.name} not as written; {REPAIR}" in capsys.readouterr().out
    assert run_command(monkeypatch, *verify, "--repair") == 0
    said = capsys.readouterr().out.splitlines()
    removed = [f"removed demonstrations/{demos.id}: damaged: {file.name} not as written"]
    if poisoned:
        removed = [f"removed trajectory_model/{model.id}: made from demonstrations/{demos.id}", *removed]
    assert said == [*removed, f"{len(removed)} versions removed"]
    assert {label: make(store, label) for label in STAGES} == expected
    assert run_command(monkeypatch, *verify, "--repair") == 0
    assert capsys.readouterr().out == "nothing is damaged\n"


def test_repair_touches_only_a_store_and_what_it_made(tmp_path):
    foreign = tmp_path / "photos" / "app"
    foreign.mkdir(parents=True)
    (foreign / "version.json").write_text("{}")
    (foreign / "precious").write_text("kept")
    store = Store(tmp_path)
    with pytest.raises(InputError, match="so nothing is removed"):
        remove_damaged(store, find_problems(store, []), [])
    (tmp_path / STORE_MARK).touch()
    linked = tmp_path / "elsewhere" / "0123456789ab"
    linked.mkdir(parents=True)
    (linked / "version.json").write_text("{}")
    (tmp_path / "stage").symlink_to(tmp_path / "elsewhere")
    own = tmp_path / "rollouts" / "ba9876543210"
    own.mkdir(parents=True)
    (own / "version.json").write_text("{}")
    problems = find_problems(store, [])
    assert set(problems) == {("rollouts", "ba9876543210"), ("elsewhere", "0123456789ab")}
    assert set(remove_damaged(store, problems, [])) == set(problems)
    assert (foreign / "precious").read_text() == "kept"


def test_a_version_without_its_version_file_is_removed_and_a_pipe_is_not_waited_for(tmp_path):
    store = Store(tmp_path)
    (tmp_path / STORE_MARK).touch()
    for stage in ("empty", "pipe"):
        (tmp_path / stage / "0123456789ab").mkdir(parents=True)
    os.mkfifo(tmp_path / "pipe" / "0123456789ab" / "version.json")
    problems = find_problems(store, [("empty", "0123456789ab"), ("pipe", "0123456789ab")])
    assert set(problems) == {("empty", "0123456789ab"), ("pipe", "0123456789ab")}
