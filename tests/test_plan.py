"""The plan: which versions a configuration asks for, and what each depends on."""

import copy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from slapshot.config import read_yaml
from slapshot.errors import InputError
from slapshot.plan import FIGURES, LIBRARIES, STAGES, make_plan
from slapshot.store.recipe import Recipe, file_digest

ROOT = Path(__file__).parents[1]
DOMAIN = read_yaml(ROOT / "config/default.yaml")["domains"]["hockey"]

EVALUATIONS = {"evaluate/hockey/kalman", "figure/hockey/F7"}
RECORDED = {
    "evaluate_recording/hockey/kalman/rig",
    "evaluate_recording/hockey/kalman/own",
    "figure/hockey/F8",
}
FROM_TRAIN = {"train/hockey/kalman"} | EVALUATIONS | RECORDED
FROM_ROLLOUTS = {"rollouts/hockey"} | FROM_TRAIN
FROM_SWINGS = {"swings/hockey"} | FROM_ROLLOUTS
FROM_LAB = {"lab/hockey/rig", "evaluate_recording/hockey/kalman/rig", "figure/hockey/F6", "figure/hockey/F8"}
FROM_MODEL = {"trajectory_model/hockey"} | FROM_SWINGS | FROM_LAB
FROM_DEMONSTRATIONS = {"demonstrations/hockey"} | FROM_MODEL
FROM_SCENE = {"scene/hockey"} | FROM_DEMONSTRATIONS
ALL = FROM_SCENE | {"figure/hockey/T2"}


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """What a folder with a recording of one's own looks like from outside."""
    folder = tmp_path / "own"
    folder.mkdir()
    for name in ("recording.json", "hits.parquet", "tracks.parquet", "notes.txt"):
        (folder / name).write_text(name)
    return folder


@pytest.fixture
def config(own) -> dict:
    """A domain with every figure, a stand-in's recording and one's own."""
    domain = copy.deepcopy(DOMAIN)
    domain["figures"] = list(FIGURES)
    domain["recordings"] = {
        "rig": {"lab": {"hits": 10, "blade": {"segments": 3}}, "samples": 5, "repeats": 2},
        "own": {"path": str(own), "samples": 5, "repeats": 2},
    }
    return {"name": "test", "domains": {"hockey": domain}}


def ids(config: dict) -> dict[str, str]:
    return {label: recipe.id for label, recipe in make_plan(config).recipes.items()}


def put(config: dict, path: str, value: object) -> None:
    *above, last = path.split(".")
    place = config["domains"]["hockey"]
    for key in above:
        place = place[key]
    place[last] = value


def reordered(value: object) -> object:
    """The same configuration, with the keys of every mapping in the opposite order."""
    return {key: reordered(value[key]) for key in reversed(value)} if isinstance(value, dict) else value


def test_the_plan_holds_every_stage_once_for_each_instance(config):
    plan = make_plan(config)
    assert set(plan.recipes) == ALL
    assert {recipe.stage for recipe in plan.recipes.values()} == set(STAGES)
    assert set(LIBRARIES) == set(STAGES)
    assert all(plan.by_id(r.stage, r.id) == r for r in plan.recipes.values())
    assert plan.ids()["figure"] == {plan.recipes[f"figure/hockey/{figure}"].id for figure in FIGURES}


def test_upstream_comes_first_and_is_part_of_the_plan(config):
    seen: set[tuple[str, str]] = set()
    for recipe in make_plan(config).recipes.values():
        assert set(recipe.upstream.values()) <= seen
        seen.add((recipe.stage, recipe.id))


def test_planning_twice_gives_the_same(config):
    assert ids(config) == ids(copy.deepcopy(config))


def test_the_recipes_survive_the_command_line(config):
    for recipe in make_plan(config).recipes.values():
        assert Recipe.from_json(recipe.to_json()).id == recipe.id


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("evaluation.samples", 3, EVALUATIONS),
        ("evaluation.noise_variances", [0.5], EVALUATIONS),
        ("recordings.rig.samples", 6, {"evaluate_recording/hockey/kalman/rig", "figure/hockey/F8"}),
        ("recordings.own.repeats", 6, {"evaluate_recording/hockey/kalman/own", "figure/hockey/F8"}),
        ("recordings.rig.lab.blade.segments", 4, FROM_LAB),
        ("training.steps", 7, FROM_TRAIN),
        ("methods.kalman.drift", 0.5, FROM_TRAIN),
        ("rollouts.hits", 100, FROM_ROLLOUTS),
        ("rollouts.named_conditions.low friction.friction_x", 0.21, FROM_ROLLOUTS),
        ("randomisation.mass.uniform", [0.02, 0.1], FROM_ROLLOUTS | {"figure/hockey/T2"}),
        ("randomisation.friction_y.times", "mass", FROM_ROLLOUTS | {"figure/hockey/T2"}),
        ("randomisation.mass.label", "Weight", {"figure/hockey/T2"}),
        ("randomisation.mass.unit", "g", {"figure/hockey/T2"}),
        ("swings.test", 9, FROM_SWINGS),
        ("trajectory_model.steps", 9, FROM_MODEL),
        ("demonstrations.count", 100, FROM_DEMONSTRATIONS),
        ("demonstrations.duration_s", 0.9, FROM_DEMONSTRATIONS),
        ("scene.timestep_s", 0.001, FROM_SCENE),
        ("scene.start_m", [0.5, 0.0], FROM_SCENE),
        ("seed", 2, FROM_DEMONSTRATIONS),
        ("figures", ["F7"], set()),
    ],
)
def test_a_parameter_changes_what_depends_on_it_and_nothing_else(config, path, value, expected):
    before = ids(config)
    put(config, path, value)
    after = ids(config)
    assert {label for label in after if after[label] != before[label]} == expected


def test_the_name_of_a_configuration_changes_nothing(config):
    before = ids(config)
    config["name"] = "other"
    assert ids(config) == before


def test_swapped_values_are_another_version(config):
    before = ids(config)
    swings = config["domains"]["hockey"]["swings"]
    swings["validation"], swings["test"] = swings["test"], swings["validation"]
    assert swings["validation"] != swings["test"]
    after = ids(config)
    assert {label for label in after if after[label] != before[label]} == FROM_SWINGS
    swings["validation"], swings["test"] = swings["test"], swings["validation"]
    assert ids(config) == before


def test_the_order_of_keys_changes_nothing(config):
    before = ids(config)
    assert ids(reordered(config)) == before


def test_a_recording_adds_versions_and_changes_only_the_figures_that_show_it(config, own):
    before = ids(config)
    config["domains"]["hockey"]["recordings"]["more"] = {"path": str(own), "samples": 3, "repeats": 1}
    after = ids(config)
    assert set(after) - set(before) == {"evaluate_recording/hockey/kalman/more"}
    assert {label for label in before if after[label] != before[label]} == {"figure/hockey/F8"}


def test_a_second_domain_shares_what_is_equal_and_leaves_the_first_alone(config):
    before = ids(config)
    config["domains"]["second"] = copy.deepcopy(config["domains"]["hockey"])
    put(config, "seed", 1)
    config["domains"]["second"]["seed"] = 2
    after = ids(config)
    assert {label: after[label] for label in before} == before
    assert len(after) == 2 * len(before)
    assert after["scene/second"] == after["scene/hockey"]
    others = {label for label in before if after[label.replace("hockey", "second")] == after[label]}
    assert others == {"scene/hockey"}


def test_a_recording_of_ones_own_counts_by_its_content(config, own, tmp_path):
    label = "evaluate_recording/hockey/kalman/own"
    recipe = make_plan(config).recipes[label]
    names = ("recording.json", "hits.parquet", "tracks.parquet")
    assert recipe.files == {name: file_digest(own / name) for name in names}
    before = ids(config)

    (own / "notes.txt").write_text("other notes")
    assert ids(config) == before
    for change in (
        lambda: (own / "hits.parquet").write_text("other hits"),
        lambda: (own / "tracks.parquet").unlink(),
        lambda: (own / "joints.parquet").write_text("joints"),
    ):
        last = ids(config)
        change()
        now = ids(config)
        assert {name for name in now if now[name] != last[name]} == {label, "figure/hockey/F8"}
    shutil.rmtree(own)
    with pytest.raises(InputError):
        make_plan(config)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("figures", ["F7", "F99"], r"domains\.hockey\.figures: no figure 'F99'; use some of: F6, "),
        ("methods", {"lstmm": {}}, r"domains\.hockey\.methods\.lstmm: no such method; a method is a file"),
        (
            "scene.domain",
            "curling",
            r"domains\.hockey\.scene\.domain: no module slapshot\.scenes\.curling; use",
        ),
        ("scene.domain", "my.own", r"domains\.hockey\.scene\.domain: no module my\.own; use"),
        ("scene.domain", "", r"domains\.hockey\.scene\.domain: no module"),
        ("scene.domain", "../scenes/hockey", r"domains\.hockey\.scene\.domain: no module"),
        (
            "recordings.own.path",
            "nowhere",
            r"recordings\.own\.path: nowhere holds no recording .*; give the path",
        ),
        ("recordings.own.path", str(ROOT / "tests"), r"recordings\.own\.path: .* holds no recording"),
    ],
)
def test_what_does_not_exist_is_named_in_one_line(config, path, value, message):
    put(config, path, value)
    with pytest.raises(InputError, match=message) as caught:
        make_plan(config)
    assert "\n" not in str(caught.value)


def test_f8_without_recordings_is_refused(config):
    config["domains"]["hockey"]["recordings"] = {}
    with pytest.raises(InputError, match=r"domains\.hockey\.figures: F8 .*; ") as caught:
        make_plan(config)
    assert "\n" not in str(caught.value)


def test_a_version_that_nobody_asks_for_is_named(config):
    with pytest.raises(InputError, match="no version train/0123456789ab; see `slapshot versions why train`"):
        make_plan(config).by_id("train", "0123456789ab")


def test_planning_needs_neither_torch_nor_mujoco():
    """A plan is made at every call of snakemake, and on machines where a stage's library may be broken."""
    code = (
        "import sys\n"
        "from slapshot.config import load_config\n"
        "from slapshot.plan import make_plan\n"
        "make_plan(load_config())\n"
        "heavy = {'torch', 'mujoco', 'dm_control', 'numba', 'matplotlib', 'scipy'}\n"
        "print(*sorted(heavy & set(sys.modules)))\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
