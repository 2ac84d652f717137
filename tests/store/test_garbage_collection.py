"""QualityWarning versions by the beginning of an id, and removing those that nobody asks for."""

import pytest
from slapshot.errors import InputError
from slapshot.store.folder import STORE_MARK, Store
from slapshot.store.garbage_collection import collect_garbage, find_version, flatten
from slapshot.store.recipe import Recipe


def test_a_version_is_found_by_the_beginning_of_its_id(store, make):
    recipe = make("train", {"n": 1})
    make("train", {"n": 2})
    for text in (recipe.id, recipe.id[:8], f"train/{recipe.id[:8]}"):
        assert find_version(store, text)["id"] == recipe.id


@pytest.mark.parametrize(
    ("beginning", "message"), [("", "2 versions"), ("zz", "no version"), ("train/", "2 v")]
)
def test_an_unknown_or_ambiguous_beginning_is_refused(store, make, beginning, message):
    make("train", {"n": 1})
    make("evaluate", {"n": 2})
    with pytest.raises(InputError, match=message) as caught:
        find_version(store, beginning)
    assert "slapshot versions list" in str(caught.value)


def test_flatten_gives_dotted_keys_and_keeps_what_is_empty():
    nested = {"a": {"b": {"c": 1}, "d": [1, {"e": 2}]}, "f": {}, "g": None}
    assert flatten(nested) == {"a.b.c": 1, "a.d": [1, {"e": 2}], "f": {}, "g": None}


@pytest.fixture
def littered(store: Store, make) -> tuple[Store, Recipe, Recipe]:
    """A store with a wanted and an unwanted version, and what interrupted runs of other ids left."""
    wanted = make("train", {"n": 1})
    unwanted = make("train", {"n": 2}, weights=b"x" * 1000)
    for version_id in ("a" * 12, "b" * 12):
        leftover = store.root / f"rollouts/.partial-{version_id}/parts"
        leftover.mkdir(parents=True)
        (leftover / "hits-000").write_bytes(b"x" * 500)
        store.lock("rollouts", version_id).touch()
    return store, wanted, unwanted


def snapshot(store: Store) -> set[str]:
    return {p.relative_to(store.root).as_posix() for p in store.root.rglob("*")}


def test_garbage_is_listed_with_its_size_and_stays(littered):
    store, wanted, unwanted = littered
    before = snapshot(store)
    listed = collect_garbage(store, {"train": {wanted.id}, "rollouts": {"a" * 12}}, really=False)
    assert [folder.name for folder, _ in listed] == [f".partial-{'b' * 12}", unwanted.id]
    assert listed[0][1] == 500
    assert listed[1][1] > 1000
    assert snapshot(store) == before


def test_garbage_is_removed_and_what_is_asked_for_stays(littered):
    store, wanted, unwanted = littered
    before = snapshot(store)
    removed = collect_garbage(store, {"train": {wanted.id}, "rollouts": {"a" * 12}}, really=True)
    assert len(removed) == 2
    gone = before - snapshot(store)
    assert gone == {
        f"train/{unwanted.id}",
        f"train/{unwanted.id}/weights",
        f"train/{unwanted.id}/version.json",
        f"rollouts/.partial-{'b' * 12}",
        f"rollouts/.partial-{'b' * 12}/parts",
        f"rollouts/.partial-{'b' * 12}/parts/hits-000",
        f"rollouts/.lock-{'b' * 12}",
    }
    assert store.is_whole("train", wanted.id)
    assert collect_garbage(store, {"train": {wanted.id}, "rollouts": {"a" * 12}}, really=True) == []


def test_an_id_is_kept_for_its_own_stage_only(store, make):
    recipe = make("train", {"n": 1})
    assert len(collect_garbage(store, {"evaluate": {recipe.id}}, really=False)) == 1


def test_what_a_process_is_making_is_no_garbage(store):
    recipe = Recipe("train", {}, code="0" * 64)
    with store.locked("train", recipe.id), store.new_version(recipe) as out:
        (out / "half").touch()
        assert collect_garbage(store, {}, really=True) == []
    assert store.is_whole("train", recipe.id)
    assert len(collect_garbage(store, {}, really=True)) == 1


def test_only_what_the_store_made_is_garbage(store, make, tmp_path):
    """A photo two levels deep, and other folders that look a little like versions."""
    unwanted = make("train", {"n": 1})
    outside = tmp_path / "outside" / "train" / ("c" * 12)
    outside.mkdir(parents=True)
    (outside / "version.json").write_text("{}")
    foreign = {
        "photos/holiday/sea.jpg": "photo",
        f"photos/{'d' * 12}/sea.jpg": "photo",  # the name of an id, but no version.json
        "package/lib/version.json": "{}",  # a version.json, but not the name of an id
        "train/.partial-notes/todo.md": "text",
        "train/.partial-0123456789ABCDEF/todo.md": "text",
        "train/readme.md": "text",
    }
    for name, text in foreign.items():
        (store.root / name).parent.mkdir(parents=True, exist_ok=True)
        (store.root / name).write_text(text)
    (store.root / "train" / ("c" * 12)).symlink_to(outside)
    (store.root / "train" / f".partial-{'c' * 12}").symlink_to(outside)
    (store.root / "linked").symlink_to(outside.parent)
    before = snapshot(store)
    removed = collect_garbage(store, {}, really=True)
    assert [folder.name for folder, _ in removed] == [unwanted.id]
    gone = {f"train/{unwanted.id}{rest}" for rest in ("", "/payload", "/version.json")}
    assert before - snapshot(store) == gone
    assert (outside / "version.json").read_text() == "{}"
    assert {name: (store.root / name).read_text() for name in foreign} == foreign


def test_a_folder_that_is_no_store_is_refused(store, make):
    recipe = make("train", {"n": 1})
    (store.root / STORE_MARK).unlink()
    for really in (False, True):
        with pytest.raises(InputError) as caught:
            collect_garbage(store, {}, really)
        message = str(caught.value)
        assert message.startswith(
            f"{store.root}: has no {STORE_MARK}, so nothing is removed from it; if it is"
        )
        assert message.endswith(f"touch {store.root / STORE_MARK}")
        assert "\n" not in message
    assert store.is_whole("train", recipe.id)
    later = make("train", {"n": 2})  # a stage that writes there makes it a store again
    assert len(collect_garbage(store, {"train": {later.id}}, really=True)) == 1


def test_an_unwanted_version_that_is_damaged_is_garbage(store, make):
    recipe = make("train", {"n": 1})
    (store.folder("train", recipe.id) / "version.json").write_text("{")
    assert len(collect_garbage(store, {}, really=True)) == 1
    assert snapshot(store) == {STORE_MARK, "train"}


def test_what_an_interrupted_removal_left_is_garbage(store, make, monkeypatch):
    recipe = make("train", {"n": 1}, a=b"a", b=b"b", z=b"z")
    for _ in range(3):
        with monkeypatch.context() as patch:
            patch.setattr("slapshot.store.folder.shutil.rmtree", interrupt)
            with pytest.raises(KeyboardInterrupt):
                collect_garbage(store, {}, really=True)
        assert not store.is_whole("train", recipe.id)
    assert len(collect_garbage(store, {}, really=True)) == 1
    assert snapshot(store) == {STORE_MARK, "train"}


def interrupt(path) -> None:
    raise KeyboardInterrupt


def test_an_empty_or_missing_store_holds_no_garbage(tmp_path):
    assert collect_garbage(Store(tmp_path / "nowhere"), {}, really=True) == []
