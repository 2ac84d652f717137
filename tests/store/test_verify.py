"""Holding versions against what was written, and against a lock from another machine."""

import json
import random

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from slapshot.store.folder import Store
from slapshot.store.recipe import Recipe
from slapshot.store.verify import TOLERANCE, column_statistics, compare, make_lock
from slapshot.store.version_file import damaged_files

LABEL = "evaluate/hockey/kalman"


def table(seed: int = 0, rows: int = 4000) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    return pd.DataFrame(
        {
            "error_m": rng.normal(0.1, 0.02, rows),
            "latent": list(rng.normal(5.0, 1.0, (rows, 3))),
            "samples": rng.integers(0, 32, rows),
            "method": "kalman",
        }
    )


def put(
    store: Store, data: pd.DataFrame, code: str = "0", compression: str = "snappy", **files: bytes
) -> dict[str, Recipe]:
    """A version with a table, as Parquet and as CSV, and with other files."""
    recipe = Recipe("evaluate", {}, code=code * 64)
    with store.new_version(recipe) as out:
        data.to_parquet(out / "errors.parquet", index=False, compression=compression)
        data.drop(columns="latent", errors="ignore").to_csv(out / "errors.csv", index=False)
        for name, content in files.items():
            (out / name).write_bytes(content)
    return {LABEL: recipe}


@pytest.fixture
def locked(tmp_path):
    """The lock of another machine, as it comes back from its file."""
    elsewhere = Store(tmp_path / "elsewhere")
    return json.loads(json.dumps(make_lock(elsewhere, put(elsewhere, table(), model=b"weights"))))


def verdict(store: Store, recipes: dict[str, Recipe], locked) -> str:
    verdicts = compare(store, recipes, locked)
    assert list(verdicts) == [LABEL]
    return verdicts[LABEL]


def folder_of(store, make):
    recipe = make("evaluate", {}, first=b"0123456789", second=b"0123456789")
    return store.folder("evaluate", recipe.id)


def test_an_untouched_version_is_not_damaged(store, make):
    assert damaged_files(folder_of(store, make)) == []


@pytest.mark.parametrize("content", [b"012345678X", b"01234", b"", b"01234567890"])
def test_altered_and_truncated_files_are_found(store, make, content):
    folder = folder_of(store, make)
    (folder / "second").write_bytes(content)
    assert damaged_files(folder) == ["second"]


def test_missing_files_are_found(store, make):
    folder = folder_of(store, make)
    (folder / "first").unlink()
    assert damaged_files(folder) == ["first"]
    (folder / "first").mkdir()
    assert damaged_files(folder) == ["first"]


def test_damaged_parquet_is_found_whatever_its_reader_says(store):
    recipe = put(store, table(rows=200))[LABEL]
    folder = store.folder("evaluate", recipe.id)
    file = folder / "errors.parquet"
    whole = file.read_bytes()
    rng = random.Random(1)
    for _ in range(100):
        file.write_bytes(whole[: rng.randrange(len(whole))])
        assert damaged_files(folder) == ["errors.parquet"]
    for _ in range(300):
        broken = bytearray(whole)
        broken[rng.randrange(len(broken))] ^= 1 << rng.randrange(8)
        file.write_bytes(broken)
        assert damaged_files(folder) == ["errors.parquet"]


def test_parquet_that_was_only_stored_otherwise_is_identical(store, locked):
    recipes = put(store, table(), compression="zstd", model=b"weights")
    assert verdict(store, recipes, locked) == "identical"
    file = store.folder("evaluate", recipes[LABEL].id) / "errors.parquet"
    pq.write_table(pq.read_table(file), file, row_group_size=100)
    assert damaged_files(file.parent) == ["errors.parquet"]  # of a finished version not a byte may change


def test_the_same_content_is_identical(store, locked):
    assert verdict(store, put(store, table(), model=b"weights"), locked) == "identical"


def test_the_same_content_by_other_code_is_said_to_be_so(store, locked):
    recipes = put(store, table(), code="1", model=b"weights")
    assert verdict(store, recipes, locked) == "identical content, other recipe"


def test_numbers_of_another_platform_are_equal_within_tolerance(store, locked):
    data = table()
    data["error_m"] += 0.1 * TOLERANCE * data["error_m"].std()
    said = verdict(store, put(store, data, model=b"other weights"), locked)
    assert said.startswith("equal within tolerance (largest deviation 0.005")


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda d: d.assign(error_m=d["error_m"] + 2 * TOLERANCE * d["error_m"].std()), "error_m"),
        (lambda d: d.assign(error_m=0.1 + 1.2 * (d["error_m"] - 0.1)), "error_m"),
        (lambda d: d.assign(latent=[row + 1 for row in d["latent"]]), "latent"),
        (lambda d: d.assign(samples=d["samples"] + 1000), "samples"),
    ],
)
def test_numbers_beyond_tolerance_differ_and_the_worst_column_is_named(store, locked, change, named):
    said = verdict(store, put(store, change(table()), model=b"weights"), locked)
    assert said.startswith("differs: errors.")
    assert f": {named} by" in said


def test_other_columns_and_other_files_are_named(store, locked, tmp_path):
    renamed = table().rename(columns={"error_m": "error_cm"})
    assert verdict(store, put(store, renamed, model=b"weights"), locked) == "other columns in errors.csv"
    more = Store(tmp_path / "more")
    recipes = put(more, table(), model=b"weights", extra=b"file")
    assert verdict(more, recipes, locked) == "other files: extra"


def test_a_version_without_numbers_must_be_the_same_to_the_byte(store, tmp_path):
    recipe = Recipe("evaluate", {}, code="0" * 64)
    stores = [store, Store(tmp_path / "elsewhere")]
    for each, xml in zip(stores, (b"<a/>", b"<b/>"), strict=True):
        with each.new_version(recipe) as out:
            (out / "scene.xml").write_bytes(xml)
            (out / "scene.json").write_bytes(b"{}")
    lock = make_lock(stores[1], {LABEL: recipe})
    assert verdict(store, {LABEL: recipe}, lock) == "differs: scene.xml"


def test_a_damaged_version_is_not_judged_by_what_it_once_was(store, locked):
    recipes = put(store, table(), model=b"weights")
    folder = store.folder("evaluate", recipes[LABEL].id)
    (folder / "model").write_bytes(b"weightz")
    expected = "damaged: model not as written; run `slapshot versions verify --repair` ("
    assert verdict(store, recipes, locked).startswith(expected)


def test_a_version_that_is_not_there(store, locked):
    recipe = Recipe("evaluate", {}, code="0" * 64)
    assert verdict(store, {LABEL: recipe}, locked) == "not made yet"
    assert verdict(store, {}, locked) == "in the lock only"
    assert compare(store, put(store, table()), {}) == {LABEL: "not in the lock"}


def test_statistics_are_of_finite_numbers_and_of_the_elements_of_lists(tmp_path):
    file = tmp_path / "t.parquet"
    columns = {
        "plain": pa.array([1.0, 3.0, None, float("nan"), float("inf")]),
        "lists": pa.array([None, [1.0, 3.0], [], [5.0], None]),
        "fixed": pa.array([[1.0, 1.0]] * 5, pa.list_(pa.float32(), 2)),
        "whole": pa.array([2, 4, 2, 4, 3], pa.int32()),
        "none": pa.nulls(5, pa.float64()),
        "text": pa.array(["1", "2", "3", "4", "5"]),
    }
    pq.write_table(pa.table(columns), file)
    found = column_statistics(file)
    assert set(found) == {"plain", "lists", "fixed", "whole"}
    assert found["plain"] == [2.0, 1.0]
    assert found["lists"] == pytest.approx([3.0, np.std([1, 3, 5])])
    assert found["fixed"] == [1.0, 0.0]
    assert found["whole"] == pytest.approx([3.0, np.std([2, 4, 2, 4, 3])])
