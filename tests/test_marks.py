"""Marks of versions say what the store holds, by names that people know."""

import shutil
from pathlib import Path

import pytest
from slapshot.config.files import load_config
from slapshot.dag import Plan, make_plan
from slapshot.dag.marks import Marks
from slapshot.errors import InputError
from slapshot.store.folder import Store


@pytest.fixture
def plan(tmp_path) -> Plan:
    whole = make_plan(load_config(Path(__file__).parents[1] / "config/tiny.yaml"))
    return Plan({label: r for label, r in whole.recipes.items() if r.stage in ("scene", "demonstrations")})


@pytest.fixture
def store(tmp_path) -> Store:
    return Store(tmp_path / "store")


@pytest.fixture
def marks(plan, tmp_path) -> Marks:
    return Marks(tmp_path / "marks", plan)


def make(store: Store, plan: Plan, label: str) -> None:
    with store.new_version(plan.recipes[label], label=label) as out:
        (out / "payload").write_text(label)


def test_a_mark_says_what_its_version_is(plan, marks, tmp_path):
    recipe = plan.recipes["demonstrations/hockey/pool"]
    mark = marks.of(recipe)
    assert mark == tmp_path / "marks/demonstrations" / f"hockey-pool-{recipe.id}"
    assert mark.parent == marks.pattern("demonstrations").parent
    assert marks.recipe("demonstrations", mark.name) == recipe
    assert marks.above(recipe) == [marks.of(plan.recipes["scene/hockey"])]
    assert marks.label(recipe) == "demonstrations hockey/pool"
    with pytest.raises(InputError, match="asks for no version demonstrations/0123456789ab"):
        marks.recipe("demonstrations", "hockey-0123456789ab")


def test_no_two_versions_share_a_mark(plan, marks):
    assert len({marks.of(r) for r in plan.recipes.values()}) == len({r.id for r in plan.recipes.values()})


@pytest.mark.parametrize("name", ["a b/c", "ä" * 300, "x" * 300, "..", "-"])
def test_whatever_a_label_holds_is_a_file(plan, tmp_path, name):
    recipe = plan.recipes["scene/hockey"]
    marks = Marks(tmp_path, Plan({f"scene/{name}": recipe}))
    mark = marks.of(recipe)
    mark.parent.mkdir()
    mark.touch()
    assert mark.parent == tmp_path / "scene"
    assert not mark.name.startswith("-")
    assert marks.recipe("scene", mark.name) == recipe


def test_of_equal_recipes_the_first_label_counts(plan, tmp_path):
    recipe = plan.recipes["scene/hockey"]
    assert Marks(tmp_path, Plan({"scene/a": recipe, "scene/b": recipe})).label(recipe) == "scene a"


def test_they_follow_the_store(store, plan, marks, tmp_path):
    scene = plan.recipes["scene/hockey"]
    make(store, plan, "scene/hockey")
    marks.refresh(store)
    assert [p for p in (tmp_path / "marks").rglob("*") if p.is_file()] == [marks.of(scene)]
    (store.folder("scene", scene.id) / "payload").unlink()
    marks.refresh(store)
    assert not marks.of(scene).exists()


def test_those_of_other_configurations_stay_while_their_versions_do(store, plan, marks, tmp_path):
    make(store, plan, "scene/hockey")
    marks.refresh(store)
    other = Marks(tmp_path / "marks", Plan({"scene/fetchslide": plan.recipes["scene/fetchslide"]}))
    other.refresh(store)
    assert marks.of(plan.recipes["scene/hockey"]).exists()
    shutil.rmtree(store.folder("scene", plan.recipes["scene/hockey"].id))
    other.refresh(store)
    assert not marks.of(plan.recipes["scene/hockey"]).exists()


def test_a_mark_that_is_right_is_not_touched(store, plan, marks):
    make(store, plan, "scene/hockey")
    marks.refresh(store)
    mark = marks.of(plan.recipes["scene/hockey"])
    before = mark.stat()
    marks.refresh(store)
    assert mark.stat() == before
