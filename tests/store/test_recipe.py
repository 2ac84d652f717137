"""Recipes: one canonical text and one id for one way of making a version."""

import hashlib
import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from slapshot.store import recipe as recipe_module
from slapshot.store.recipe import Recipe, canonical_json, library_version, make_recipe

RECIPE = Recipe(
    stage="train",
    config={"low": 0.1, "high": 0.9, "nested": {"b": [1, 2], "a": "ä"}},
    code="c" * 64,
    upstream={"rollouts": ("rollouts", "0123456789ab"), "scene": ("scene", "ba9876543210")},
    libraries={"numpy": "2.4.1"},
    files={"hits.parquet": "f" * 64},
)

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


def shuffled(value):
    """The same value with the keys of every mapping in the opposite order."""
    if isinstance(value, dict):
        return {key: shuffled(value[key]) for key in reversed(value)}
    return [shuffled(item) for item in value] if isinstance(value, list) else value


@given(json_values)
def test_canonical_json_says_the_value_and_nothing_about_the_order_of_keys(value):
    text = canonical_json(value)
    assert json.loads(text) == value
    assert canonical_json(shuffled(value)) == text


def test_canonical_json_has_no_spaces_and_sorted_keys():
    assert (
        canonical_json({"b": [1, 2.5], "a": {"d": None, "c": "ü"}}) == '{"a":{"c":"ü","d":null},"b":[1,2.5]}'
    )


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_not_a_number_is_refused(bad):
    with pytest.raises(ValueError, match="not JSON compliant"):
        replace(RECIPE, config={"a": [bad]}).to_json()


def test_the_id_is_the_beginning_of_the_digest_of_the_text():
    assert RECIPE.id == hashlib.sha256(RECIPE.to_json().encode()).hexdigest()[:12]
    assert len(RECIPE.id) == 12


def test_the_order_of_keys_does_not_change_the_id():
    again = replace(
        RECIPE,
        config=shuffled(RECIPE.config),
        upstream=shuffled(RECIPE.upstream),
        libraries=dict(RECIPE.libraries),
    )
    assert list(again.config) != list(RECIPE.config)
    assert again.id == RECIPE.id


@pytest.mark.parametrize(
    "other",
    [
        replace(RECIPE, stage="evaluate"),
        replace(RECIPE, config={**RECIPE.config, "low": 0.9, "high": 0.1}),  # swapped values
        replace(RECIPE, config={**RECIPE.config, "nested": {"b": [2, 1], "a": "ä"}}),
        replace(RECIPE, config={**RECIPE.config, "extra": None}),
        replace(RECIPE, code="d" * 64),
        replace(RECIPE, upstream={**RECIPE.upstream, "scene": ("scene", "ba9876543211")}),
        replace(
            RECIPE,
            upstream={"rollouts": RECIPE.upstream["scene"], "scene": RECIPE.upstream["rollouts"]},
        ),
        replace(RECIPE, libraries={"numpy": "2.4.2"}),
        replace(RECIPE, files={"hits.parquet": "e" * 64}),
    ],
)
def test_everything_that_decides_a_result_changes_the_id(other):
    assert other.id != RECIPE.id


def test_round_trip():
    again = Recipe.from_json(RECIPE.to_json())
    assert again == RECIPE
    assert again.to_json() == RECIPE.to_json()


def test_a_recipe_holds_the_ids_upstream_and_the_digests_of_files(tmp_path):
    file = tmp_path / "hits.parquet"
    file.write_bytes(b"one")
    made = make_recipe("train", ["slapshot.errors"], {}, {"role": RECIPE}, {"hits": file})
    assert made.upstream == {"role": ("train", RECIPE.id)}
    assert made.files == {"hits": hashlib.sha256(b"one").hexdigest()}
    other = replace(RECIPE, code="d" * 64)
    changed = make_recipe("train", ["slapshot.errors"], {}, {"role": other}, {"hits": file})
    assert changed.id != made.id
    file.write_bytes(b"two")
    edited = make_recipe("train", ["slapshot.errors"], {}, {"role": RECIPE}, {"hits": file})
    assert edited.id != made.id


@pytest.fixture
def installed(monkeypatch):
    versions = {"torch": "2.13.0+cpu", "numpy": "2.4.1"}
    monkeypatch.setattr(recipe_module, "version", versions.__getitem__)
    monkeypatch.setattr(recipe_module, "imported_libraries", lambda *modules: set(versions))
    library_version.cache_clear()
    yield
    library_version.cache_clear()


@pytest.mark.usefixtures("installed")
def test_the_local_part_of_a_version_does_not_count():
    assert library_version("torch") == "2.13.0"
    made = make_recipe("train", ["slapshot.errors"], {}, {})
    assert made.libraries == {"torch": "2.13.0", "numpy": "2.4.1"}
