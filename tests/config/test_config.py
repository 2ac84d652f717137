"""Configurations: what is valid, how two are laid over each other, and what a bad one gets."""

import copy
import datetime
import functools
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from slapshot.config.configuration import Configuration
from slapshot.config.files import load_config
from slapshot.config.layers import merge
from slapshot.dag import make_plan
from slapshot.errors import InputError
from slapshot.store.code_dependencies import code_digest
from slapshot.validation import validated, values_of
from slapshot.yaml_file import read_yaml
from snakemake.utils import update_config

ROOT = Path(__file__).parents[2]
CONFIGS = sorted((ROOT / "config").glob("*.yaml"))
DEFAULT = read_yaml(ROOT / "config/default.yaml")
TOP_LEVEL = "calibration, cases, domains, name, proof, regression"
DOMAIN = "domains.hockey"
RED = ".recordings.lab.lab.objects.red"
LAB = DEFAULT["domains"]["hockey"]["recordings"]["lab"]["lab"]
DELETE = object()


_digest_once = functools.cache(code_digest)


@pytest.fixture(autouse=True)
def _in_root(monkeypatch):
    monkeypatch.chdir(ROOT)
    # No test here edits code; to follow all imports takes most of the time.
    monkeypatch.setattr("slapshot.store.recipe.code_digest", _digest_once)


def changed(path: str, value: object) -> dict:
    """The default configuration with one key set or deleted; below domains.hockey if it starts with a dot."""
    config = copy.deepcopy(DEFAULT)
    *above, last = (DOMAIN + path if path.startswith(".") else path).split(".")
    place = config
    for key in above:
        place = place[int(key) if isinstance(place, list) else key]
    if value is DELETE:
        del place[last]
    else:
        place[int(last) if isinstance(place, list) else last] = value
    return config


def message_of(config: dict) -> str:
    with pytest.raises(InputError) as caught:
        validated(Configuration, config, "my.yaml")
    return str(caught.value)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_every_configuration_that_ships_is_valid_and_can_be_planned(path):
    assert make_plan(load_config(path)).recipes


def test_default_and_tiny_are_there_and_publish_apart():
    names = [load_config(path).name for path in CONFIGS]
    assert {"default", "tiny"} <= set(names)
    assert len(set(names)) == len(names)


def test_a_file_is_laid_over_the_default(tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text("name: my\ndomains: {hockey: {rollouts: {hits: 70}}}\n")
    expected = changed(".rollouts.hits", 70)
    expected["name"] = "my"
    assert values_of(load_config(file)) == expected
    assert values_of(load_config()) == DEFAULT
    assert load_config(Path("config/default.yaml")) == load_config()


@pytest.mark.parametrize(
    ("path", "value", "key", "problem"),
    [
        # Unknown and missing keys.
        ("nme", "x", "nme", f"unknown key 'nme'; write 'name', or use one of: {TOP_LEVEL}"),
        ("zzz", "x", "zzz", f"unknown key 'zzz'; remove it, or use one of: {TOP_LEVEL}"),
        (".trainnig", {}, ".trainnig", "unknown key 'trainnig'; write 'training'"),
        (".rollouts.hit", 3, ".rollouts.hit", "unknown key 'hit'; write 'hits'"),
        (".randomisation.gravity", {}, ".randomisation.gravity", "unknown key 'gravity'"),
        (".randomisation.mass.mean", 1, ".randomisation.mass.mean", "unknown key 'mean'"),
        (".methods.kalman.layers", 1, ".methods.kalman.layers", "unknown key 'layers'"),
        (".methods.kalmann", {}, ".methods.kalmann", "'kalmann'; write 'kalman', or .*: kalman, lstm, m"),
        (".methods.gru", {}, ".methods.gru", "unknown key 'gru'; remove it, or .*: kalman, lstm, maml, each"),
        # What follows the first underscore tells methods of one kind apart; nothing else may follow.
        (".methods.maml_", {}, ".methods.maml_", "unknown key 'maml_'; write 'maml'"),
        (".methods.lstm-2", {}, ".methods.lstm-2", "unknown key 'lstm-2'; write 'lstm'"),
        (".methods.maml_16", {"batch": 16}, ".methods.maml_16", "key 'hidden' is missing"),
        (".methods.lstm.state", 0, ".methods.lstm.state", "must be >= 1"),
        (".methods.maml_8.state", 80, ".methods.maml_8.state", "unknown key 'state'"),
        ("regression.kalman.learning_rate", 0.1, "regression.kalman.learning_rate", "unknown key"),
        (".recordings.lab.rig", 2, ".recordings.lab.rig", "unknown key 'rig'; write 'rigs'"),
        ("regression", DELETE, "top level", "key 'regression' is missing; add it"),
        (".uncertainty", DELETE, DOMAIN, "key 'uncertainty' is missing; add it"),
        (".viewer.recorded", DELETE, ".viewer", "key 'recorded' is missing"),
        ("name", DELETE, "top level", "key 'name' is missing; add it"),
        (".seed", DELETE, DOMAIN, "key 'seed' is missing; add it"),
        (".rollouts.hits", DELETE, ".rollouts", "key 'hits' is missing; add it"),
        (".randomisation.mass.unit", DELETE, ".randomisation.mass", "key 'unit' is missing"),
        # Wrong types.
        ("domains", None, "domains", "None is not a mapping; write a mapping"),
        ("domains", [1], "domains", "is not a mapping"),
        (".rollouts", 3, ".rollouts", "3 is not a mapping"),
        (".rollouts.hits", "many", ".rollouts.hits", "'many' is not a whole number"),
        (".rollouts.hits", 64.0, ".rollouts.hits", "64.0 is not a whole number"),
        (".rollouts.hits", True, ".rollouts.hits", "True is not a whole number"),
        (
            ".methods.kalman.learning_rate",
            "1e-3",
            ".methods.kalman.learning_rate",
            "not a number; .* such as 0.001",
        ),
        (".methods.kalman.hidden", 128, ".methods.kalman.hidden", "128 is not a list"),
        (".methods.kalman.hidden.0", "a", ".methods.kalman.hidden.0", "'a' is not a whole number"),
        (".claims", "C4", ".claims", "'C4' is not a list"),
        (".uncertainty.samples", 4, ".uncertainty.samples", "4 is not a list"),
        (".figures.1", 7, ".figures.1", "7 is not a text; write a text"),
        (".scene.puck", "round", ".scene.puck", "'round' is not allowed; use one of: inline, ice"),
        ("name", datetime.date(2026, 1, 1), "name", "is a date; write it in quotes"),
        (".rollouts.named_conditions", {1: {}}, ".rollouts.named_conditions", "key 1 is not a text"),
        ("name", "a/b", "name", "'a/b' is not allowed; use letters, digits, _ and -"),
        ("domains.a/b", DEFAULT["domains"]["hockey"], "domains.a/b", "use letters, digits, _ and -"),
        (".recordings.my rig", {"path": "x", "samples": 1, "repeats": 1}, ".recordings.my rig", "use lett"),
        # Impossible ranges.
        ("domains", {}, "domains", "is empty; add at least 1"),
        (".methods", {}, ".methods", "is empty; add at least 1"),
        (".seed", -1, ".seed", "-1 is out of range; it must be >= 0"),
        (".rollouts.hits", 0, ".rollouts.hits", "must be >= 1"),
        (".rollouts.track_share", 1.5, ".rollouts.track_share", "must be <= 1"),
        (".methods.lstm.learning_rate", 0, ".methods.lstm.learning_rate", "must be > 0"),
        (
            ".methods.maml_1.step_size",
            float("nan"),
            ".methods.maml_1.step_size",
            "nan is not a finite number",
        ),
        (".scene.start_m.0", float("inf"), ".scene.start_m.0", "inf is not a finite number"),
        (".scene.start_m", [0.1], ".scene.start_m", r"has 1 values; write 2 \(x, y in m"),
        (".scene.start_m", [0.1, 0, 0], ".scene.start_m", "has 3 values; write at most 2"),
        (".figures", ["F7", "F7"], ".figures", "names something twice; name it once"),
        (".latents.methods", [], ".latents.methods", "has 0 values; write at least 1"),
        (".latents.samples", [1, 1], ".latents.samples", "names something twice"),
        (".uncertainty.levels.0", 1, ".uncertainty.levels.0", "must be < 1"),
        (".uncertainty.levels.0", 0, ".uncertainty.levels.0", "must be > 0"),
        (".uncertainty.draws", 3, ".uncertainty.draws", "must be >= 4"),
        (".recordings.lab.rigs", 0, ".recordings.lab.rigs", "must be >= 1"),
        ("regression.kalman.latent", 1, "regression.kalman.latent", "must be >= 2"),
        ("regression.walkthrough.samples.0", -1, "regression.walkthrough.samples.0", "must be >= 0"),
        (".scene.timestep_s", 0.002, ".scene.timestep_s", "0.002 is out of range; it must be <= 0.001"),
        (".scene.timestep_s", 0.0003, ".scene.timestep_s", "does not divide 0.001 s; use 0.001"),
        (".demonstrations.speed_m_s", [1.9, 0.8], ".demonstrations.speed_m_s", "runs backwards; write .low"),
        (".demonstrations.speed_m_s", [-1, 1], ".demonstrations.speed_m_s.0", "must be > 0"),
        (".randomisation.mass.uniform", [0.1, 0.01], ".randomisation.mass.uniform", "runs backwards; write"),
        (".randomisation.mass.uniform.0", 0, ".randomisation.mass.uniform.0", "must be > 0"),
        (".randomisation.friction_x.uniform.0", -0.1, ".randomisation.friction_x.uniform.0", "must be >= 0"),
        (".randomisation.start_error.normal", [0, -0.1], ".randomisation.start_error.normal", "is negative"),
        (
            ".randomisation.mass",
            {"normal": [0.05, 0.02], "label": "", "unit": "kg"},
            ".randomisation.mass.normal",
            "draws values below 0, which this parameter cannot have; write a mean above 5",
        ),
        (".randomisation.mass.normal", [1, 0.1], ".randomisation.mass", "has uniform and normal"),
        (".randomisation.mass.uniform", DELETE, ".randomisation.mass", "has none of uniform, normal; give"),
        # Names that must fit together.
        (
            ".rollouts.named_conditions.low friction.fricton_x",
            0.2,
            ".rollouts.named_conditions.low friction.fricton_x",
            "unknown key 'fricton_x'; write 'friction_x', or use one of: friction_rolling",
        ),
        (".randomisation.friction_y.times", "weight", ".randomisation.friction_y.times", "use one of: mass"),
        (".randomisation.friction_y.times", "friction_y", ".randomisation.friction_y.times", "drawn before"),
        (".randomisation.mass.times", "friction_x", ".randomisation.mass.times", "leave `times` out"),
        (".randomisation.start_error.times", "mass", ".randomisation.start_error.times", "leave `times` out"),
        (".evaluation.queries", 40, ".evaluation", "samples . queries = 72 .* rollouts.hits is 64; lower"),
        (".training.sequence", 65, ".training.sequence", "65 is more than rollouts.hits = 64; lower"),
        (".recordings.rig", {"samples": 1, "repeats": 1}, ".recordings.rig", "has none of lab, path"),
        (
            ".recordings.rig",
            {"samples": 1, "repeats": 1, "path": "a", "lab": LAB},
            ".recordings.rig",
            "has lab and path of lab, path; give exactly one of them",
        ),
        (".recordings.lab.lab.hits", 0, ".recordings.lab.lab.hits", "must be >= 1"),
        (".recordings.lab.lab.blade", 3, ".recordings.lab.lab.blade", "is not a mapping or null"),
        (".recordings.lab.lab.blade.segments", 1, ".recordings.lab.lab.blade.segments", "must be >= 2"),
        (f"{RED}.mass_kg", -1, f"{RED}.mass_kg", "must be > 0"),
        (
            ".recordings.lab.lab.commands",
            "all",
            ".recordings.lab.lab.commands",
            "'all' is not allowed; use one of: latents",
        ),
        (".recordings.lab.lab.keep", "none", ".recordings.lab.lab.keep", "use one of: full"),
        (
            ".recordings.lab.lab.concealed",
            [{"kind": "tilt"}],
            ".recordings.lab.lab.concealed.0",
            "has none of amplitude, displacement",
        ),
        (
            ".recordings.lab.lab.concealed",
            [{"kind": "tit", "amplitude": 1}],
            ".recordings.lab.lab.concealed.0.kind",
            "'tit' is not allowed; write tilt",
        ),
    ],
)  # fmt: skip
def test_a_bad_value_gets_one_line_with_file_key_and_advice(path, value, key, problem):
    message = message_of(changed(path, value))
    key = DOMAIN + key if key.startswith(".") else key
    assert message.startswith(f"my.yaml: {key}: ")
    assert "\n" not in message
    assert len(message) < 300
    assert re.search(problem, message)


@pytest.mark.parametrize("name", ["kalman", "kalman_2", "maml_16", "maml_wide", "lstm_64"])
def test_a_method_may_have_several_settings_under_names_that_begin_alike(name):
    methods = DEFAULT["domains"]["hockey"]["methods"]
    settings = methods[{"kalman": "kalman", "maml": "maml_1", "lstm": "lstm"}[name.partition("_")[0]]]
    config = changed(f".methods.{name}", settings)
    plan = make_plan(validated(Configuration, config, "my.yaml"))
    assert f"train/hockey/{name}" in plan.recipes


def test_odd_keys_and_long_values_still_give_one_short_line():
    for config in (
        changed("domains.a\nb", 1),
        changed("a\nb", 1),
        changed("name", {"long": ["value"] * 1000}),
        changed(".rollouts.named_conditions", {"a\nb": {"c\nd": 1.0}}),
    ):
        message = message_of(config)
        assert "\n" not in message
        assert len(message) < 300


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, r"no such file; give the path of a YAML file"),
        (b"", r"holds no keys; it must be a mapping of keys to values"),
        (b"# only a comment\n", r"holds no keys"),
        (b"- a\n- list\n", r"holds no keys"),
        (b"just words\n", r"holds no keys"),
        (b"name: a\ndomains: {hockey: \n", r":3: not valid YAML .*; mend that line$"),
        (b"name: a\n\tdomains: b\n", r":2: not valid YAML .*; mend that line$"),
        (b"name: [a\nb: c\n", r":2: not valid YAML .*; mend that line$"),
        (
            b"name: !!python/object:os.system x\n",
            r":1: not valid YAML \(could not determine a constructor",
        ),
        (b"name: \xff\xfe\n", r"not valid YAML .*mend it"),
        (b"name: \x07\n", r"not valid YAML .*special characters are not allowed"),
        (b"name: a\n---\nname: b\n", r":2: not valid YAML .*; mend that line$"),
        (b"name: tiny\ndomains: {hockey: {rollouts: {hitts: 3}}}\n", r"unknown key 'hitts'; write 'hits'"),
    ],
)
def test_a_bad_file_is_named(tmp_path, content, problem):
    file = tmp_path / "my.yaml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError, match=problem) as caught:
        load_config(file)
    assert str(caught.value).startswith(f"{file}:")
    assert "\n" not in str(caught.value)


def test_a_folder_is_no_configuration(tmp_path):
    with pytest.raises(InputError, match="is a folder; give the path of a YAML file"):
        load_config(tmp_path)


def test_outside_the_repository_the_message_says_where_to_go(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="run this in the top folder of the repository"):
        load_config()


def test_merge_keeps_what_is_not_named_and_replaces_lists():
    base = {"a": {"b": [1, 2, 3], "c": 1}, "d": 4}
    over = {"a": {"b": [9], "e": {"f": 1}}, "g": None}
    assert merge(base, over) == {"a": {"b": [9], "c": 1, "e": {"f": 1}}, "d": 4, "g": None}
    assert base == {"a": {"b": [1, 2, 3], "c": 1}, "d": 4}


_leaves = st.none() | st.booleans() | st.integers(0, 3) | st.lists(st.integers(0, 3), max_size=2)
_keys = st.sampled_from("abc")
_trees = st.recursive(
    _leaves, lambda inner: st.dictionaries(_keys, inner, min_size=1, max_size=3), max_leaves=8
)
_configs = st.dictionaries(_keys, _trees, max_size=3)


@given(_configs, _configs)
def test_merge_is_what_snakemake_does(base, over):
    expected = copy.deepcopy(base)
    update_config(expected, copy.deepcopy(over))
    assert merge(base, over) == expected


def places(value: object, path: tuple = ()) -> list[tuple]:
    """Paths of everything inside a nested configuration."""
    if isinstance(value, dict):
        inside = value.items()
    elif isinstance(value, list):
        inside = enumerate(value)
    else:
        return []
    return [place for key, item in inside for place in ((*path, key), *places(item, (*path, key)))]


_names = st.sampled_from(sorted({str(p[-1]) for p in places(DEFAULT)})) | st.text(max_size=5)
_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-2, 200)
    | st.integers()
    | st.floats()
    | _names
    | st.sampled_from(
        ["", ".", "a.b", "..", "slapshot.errors", "1e-3", "a\nb", datetime.date(2026, 1, 1), b"x"]
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_names | st.integers(), inner, max_size=2),
    max_leaves=4,
)


@st.composite
def mutations(draw) -> dict:
    """The default configuration with one to three keys deleted, replaced or renamed."""
    config = copy.deepcopy(DEFAULT)
    for _ in range(draw(st.integers(1, 3))):
        *above, last = draw(st.sampled_from(places(config) or [("name",)]))
        place = config
        for key in above:
            place = place[key]
        action = draw(st.sampled_from(["delete", "replace", "replace", "rename"]))
        if action == "replace":
            place[last] = draw(_values)
        elif last in place or isinstance(place, list):
            value = place.pop(last)
            if action == "rename" and isinstance(place, dict):
                place[draw(_names | st.integers(0, 3))] = value
    return config


@settings(max_examples=400, suppress_health_check=list(HealthCheck))
@given(mutations())
def test_whatever_is_done_to_a_configuration_it_is_planned_or_refused_in_one_line(config):
    try:
        plan = make_plan(validated(Configuration, config, "my.yaml"))
    except InputError as error:
        message = str(error)
        assert message
        assert "\n" not in message
    else:
        assert all(len(recipe.id) == 12 for recipe in plan.recipes.values())


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_configurations_hold_no_key_twice(path):
    """YAML takes the last of two silently."""

    class Strict(yaml.SafeLoader):
        pass

    def mapping(loader, node):
        keys = [key.value for key, _ in node.value]
        assert len(set(keys)) == len(keys), keys
        return dict(loader.construct_pairs(node))

    Strict.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, mapping)
    assert yaml.load(path.read_text(), Strict)
