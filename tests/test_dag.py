"""The plan: which versions a configuration asks for, and what each depends on."""

import copy
import functools
import itertools
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from slapshot.blind_validation.cases import Case, write_cases
from slapshot.config.configuration import Configuration
from slapshot.dag import CLAIMS, FIGURES, STAGES, Plan, make_plan
from slapshot.effects import modules_of_results
from slapshot.effects.joints import joint_effect_modules
from slapshot.effects.joints.catalogue import joint_effects
from slapshot.errors import InputError
from slapshot.lab.joints import cases as joint_cases
from slapshot.lab.joints.case_spec import CaseSpec, JointCaseSettings, MeasurementCondition
from slapshot.store.code_dependencies import code_digest, imported_libraries
from slapshot.store.recipe import Recipe, file_digest, make_recipe
from slapshot.validation import validated
from slapshot.yaml_file import read_yaml

ROOT = Path(__file__).parents[1]
DEFAULT = read_yaml(ROOT / "config/default.yaml")
DOMAIN = DEFAULT["domains"]["hockey"]
METHODS = ("kalman", "lstm", "maml_8")
IN_DOMAIN = [figure for figure in FIGURES if figure != "F3"]


def each(pattern: str, methods: tuple[str, ...] = METHODS) -> set[str]:
    return {pattern.format(method) for method in methods}


def figures(*names: str) -> set[str]:
    return {f"figure/hockey/{name}" for name in names}


def of_rig(labels: set[str], rig: str) -> set[str]:
    """Those of rig 0, as those of another one."""
    return {label.replace("/hockey/0", f"/hockey/{rig}") for label in labels if "/hockey/0" in label}


def claims(*names: str) -> set[str]:
    return {"claims", *(f"claim/hockey/{name}" for name in names)}


def of_method(method: str) -> set[str]:
    """What is made from one method, as any method has it."""
    own = {f"train/hockey/{method}", f"evaluate/hockey/{method}"}
    own |= {f"evaluate_recording/hockey/{method}/{recording}" for recording in ("rig", "own")}
    return own | figures("F4", "F7", "F8", "M1") | claims("C2", "C4", "C5")


ARMS = ("nominal", "refitted", "augmented")
MEETINGS = {f"evaluate_recording/hockey/kalman/{arm}/{hits}" for arm in ARMS for hits in ("all", "held_out")}
ARM_BELIEFS = {f"beliefs/hockey/kalman/{arm}" for arm in ARMS}
ARM_TRAIN = {f"train/hockey/kalman/{arm}" for arm in ARMS[1:]}
FROM_ARM_TRAIN = ARM_TRAIN | MEETINGS | ARM_BELIEFS | {"arms/hockey"}
FROM_ARM_ROLLOUTS = {f"arm_rollouts/hockey/{arm}" for arm in ARMS[1:]} | FROM_ARM_TRAIN
RETRAINING = {"findings/hockey", "held_out/hockey"} | FROM_ARM_ROLLOUTS
REGRESSION = {"regression", "figure/regression/F3", "claim/regression/C1", "claims"}
EVALUATIONS = each("evaluate/hockey/{}") | figures("F4", "F7") | claims("C2", "C4", "C5")
OWN = each("evaluate_recording/hockey/{}/own") | figures("F8") | claims("C5")
COMPARED = figures("A4") | claims("C6")
RIG = each("evaluate_recording/hockey/{}/rig") | figures("F8") | claims("C5") | COMPARED
PREDICTIONS = {"predictions/hockey", "viewer/hockey"} | figures("F1", "U1")
CALIBRATION = {"calibrate/hockey"} | PREDICTIONS
BELIEFS = each("beliefs/hockey/{}", ("kalman", "lstm")) | figures("F5", "F9", "U2") | claims("C3", "C7")
ACTS = {"acting/hockey/0", "acting/hockey/1"}
ACTING = ACTS | figures("A1") | claims("S12") | COMPARED
POLICY_ACTS = {"policy_acting/hockey/0", "policy_acting/hockey/1"}
FROM_POLICY = {"policy/hockey/0", "policy/hockey/1"} | POLICY_ACTS | COMPARED
EXPLORATION = {"exploration/hockey"} | figures("A2") | claims("S13")
COVERAGE = {"coverage/hockey"} | figures("A3") | claims("S11")
REFINED = figures("A5") | claims("S11")
ERRORS = {"refined_errors/hockey/0"} | REFINED
FROM_REFINED_TRAIN = {"refined_train/hockey/0"} | ERRORS
FROM_REFINED_ROLLOUTS = {"refined_rollouts/hockey/0"} | FROM_REFINED_TRAIN
REFINEMENT = {"refinement/hockey"} | COVERAGE | FROM_REFINED_ROLLOUTS
FROM_INVERSE = {"inverse/hockey"} | ACTING
FROM_KALMAN = (
    FROM_INVERSE
    | REFINEMENT
    | EXPLORATION
    | of_method("kalman")
    | CALIBRATION
    | (BELIEFS - {"beliefs/hockey/lstm"})
    | FROM_ARM_TRAIN
)
FROM_TRAIN = each("train/hockey/{}") | EVALUATIONS | RIG | OWN | CALIBRATION | BELIEFS | figures("M1")
FROM_TRAIN |= FROM_ARM_TRAIN | FROM_INVERSE | EXPLORATION | REFINEMENT
FROM_ROLLOUTS = {"rollouts/hockey"} | FROM_TRAIN | FROM_ARM_ROLLOUTS | FROM_POLICY
FROM_SWINGS = {"swings/hockey"} | FROM_ROLLOUTS
LABS = {"lab/hockey/rig/0", "lab/hockey/rig/1"}
DIAGNOSES = {"diagnosis/hockey/rig", "diagnosis/hockey/own"}
FROM_LAB = (
    LABS
    | REFINEMENT
    | ACTING
    | POLICY_ACTS
    | EXPLORATION
    | RIG
    | PREDICTIONS
    | BELIEFS
    | figures("F6")
    | {"diagnosis/hockey/rig"}
    | RETRAINING
)
FROM_MODEL = {"trajectory_model/hockey"} | FROM_SWINGS | FROM_LAB
FROM_DEMONSTRATIONS = {"demonstrations/hockey"} | FROM_MODEL
VERDICTS = {"verdict/small/s1", "score/small", "verdict/full/f1", "score/full"}
FROM_SIGNATURES = {"signatures/hockey/pool"} | VERDICTS
FROM_POOL = {"demonstrations/hockey/pool", "case/small/s1", "case/full/f1"} | FROM_SIGNATURES
FROM_SCENE = {"scene/hockey"} | FROM_DEMONSTRATIONS | FROM_POOL | DIAGNOSES
JOINT_PROOF = {"joint_case/j1", "joint_verdict/j1", "joint_case/j2", "joint_verdict/j2", "joint_score"}
NULLS = {
    f"null_p_values/{rig}/{first}" for rig in DEFAULT["calibration"]["nulls"]["rigs"] for first in (0, 2)
}
NULLS |= {"null_table"}
INTERVALS = {"law_intervals/spring/0", "law_intervals/wind/0", "coverage_table"}
OF_HITS = {"hit_intervals/tilt/0", "hit_intervals/curl/0", "hit_coverage_table"}
ALL = FROM_SCENE | figures("T1", "T2", "F2") | REGRESSION | JOINT_PROOF | NULLS | INTERVALS | OF_HITS

LAB = DOMAIN["recordings"]["lab"]["lab"]

JOINT_CASES = [
    joint_cases.Case("j1", "pair", CaseSpec("arm", 2**47, (("spring", 2.5), ("payload", 0.8)), episodes=6)),
    joint_cases.Case(
        "j2", "null, cluttered", CaseSpec("kuka", 5, (), MeasurementCondition("ou20", True, 1e-3))
    ),
]

_digest_once = functools.cache(code_digest)
_libraries_once = functools.cache(imported_libraries)


@pytest.fixture(autouse=True)
def unchanged_code(monkeypatch):
    """No test here edits code, and to follow all imports takes most of the time of a plan."""
    monkeypatch.setattr("slapshot.store.recipe.code_digest", _digest_once)
    monkeypatch.setattr("slapshot.store.recipe.imported_libraries", _libraries_once)


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """What a folder with a recording of one's own looks like from outside."""
    folder = tmp_path / "own"
    folder.mkdir()
    for name in ("recording.json", "hits.parquet", "tracks.parquet", "notes.txt"):
        (folder / name).write_text(name)
    return folder


@pytest.fixture
def config(own, tmp_path) -> dict:
    """Two lists of one case; a domain with every figure, three methods, two stand-in rigs, a recording."""
    domain = copy.deepcopy(DOMAIN)
    domain["figures"] = IN_DOMAIN
    domain["claims"] = [claim for claim in CLAIMS if claim != "C1"]
    domain["methods"] = {method: domain["methods"][method] for method in METHODS}
    domain["retraining"] |= {"recording": "rig", "samples": 2}
    domain["acting"] |= {"recording": "rig", "compared": ["lstm"]}
    domain["refinement"] |= {"recording": "rig"}
    domain["recordings"] = {
        "rig": {"lab": copy.deepcopy(LAB), "rigs": 2, "samples": 5, "repeats": 2},
        "own": {"path": str(own), "samples": 5, "repeats": 2},
    }
    cases = copy.deepcopy(DEFAULT["cases"]) | {"like": "rig", "lab": {"blade": None}}
    for key, name in (("small", "s1"), ("published", "f1")):
        cases[key] = str(tmp_path / f"{key}.csv")
        write_cases([Case(name, "plain", 7, (("tilt", 0.8),))], Path(cases[key]))
    cases["joints"] = str(tmp_path / "joints.csv")
    joint_cases.write_cases(JOINT_CASES, Path(cases["joints"]))
    calibration = copy.deepcopy(DEFAULT["calibration"])
    calibration["nulls"] |= {"recordings": 3, "block": 2}
    calibration["coverage"] |= {"recordings": 2, "effects": ["spring", "wind"]}
    calibration["hit_coverage"] |= {"recordings": 2, "effects": ["tilt", "curl"]}
    return {
        "name": "test",
        "calibration": calibration,
        "regression": copy.deepcopy(DEFAULT["regression"]),
        "proof": "published",
        "cases": cases,
        "domains": {"hockey": copy.deepcopy(domain)},
    }


def planned(config: dict) -> Plan:
    return make_plan(validated(Configuration, config, "my.yaml"))


def ids(config: dict) -> dict[str, str]:
    return {label: recipe.id for label, recipe in planned(config).recipes.items()}


def changed(before: dict[str, str], after: dict[str, str]) -> set[str]:
    """Labels of versions that are new or other than before."""
    return {label for label in after if after[label] != before.get(label)}


def put(config: dict, path: str, value: object) -> None:
    """Change a value of the domain, or of another block if the path begins so."""
    *above, last = path.split(".")
    apart = above[:1] in (["regression"], ["cases"], ["calibration"])
    place = config if apart else config["domains"]["hockey"]
    for key in above:
        place = place[key]
    place[last] = value


def reordered(value: object) -> object:
    """The same configuration, with the keys of every mapping in the opposite order."""
    return {key: reordered(value[key]) for key in reversed(value)} if isinstance(value, dict) else value


def test_the_plan_holds_every_stage_once_for_each_instance(config):
    plan = planned(config)
    assert set(plan.recipes) == ALL
    assert {recipe.stage for recipe in plan.recipes.values()} == set(STAGES) - {
        "train_part",
        "refined_train_part",
    }
    assert {STAGES[plan.recipes[label].stage].on_demand for label in set(ALL) - plan.on_demand} == {False}
    assert all(plan.by_id(r.stage, r.id) == r for r in plan.recipes.values())
    assert plan.ids()["figure"] == {plan.recipes[label].id for label in ALL if label.startswith("figure/")}
    assert len(plan.ids()["figure"]) == len(FIGURES)
    assert len(plan.ids()["claim"]) == len(CLAIMS)
    # Rigs of one block of settings differ in nothing but their number.
    rigs = [plan.recipes[label].config for label in sorted(LABS)]
    assert [rig["rig"] for rig in rigs] == [0, 1]
    assert {**rigs[0], "rig": 1} == rigs[1]


def test_upstream_comes_first_and_is_part_of_the_plan(config):
    seen: set[tuple[str, str]] = set()
    for recipe in planned(config).recipes.values():
        assert set(recipe.upstream.values()) <= seen
        seen.add((recipe.stage, recipe.id))


def test_code_that_is_read_once_gives_the_recipe_that_reading_it_each_time_gives(config):
    plan = planned(config)
    recipe = plan.recipes["verdict/full/f1"]
    modules = [STAGES["verdict"].module, *modules_of_results()]
    above = {role: plan.by_id(*pair) for role, pair in recipe.upstream.items()}
    assert make_recipe("verdict", modules, recipe.config, above) == recipe


def test_the_longest_chain_from_a_stage_counts_its_versions(config):
    """Models wait for rollouts, those of refined ranges for other models, and nothing waits for a figure."""
    lengths = planned(config).chain_lengths()
    assert lengths["figure"] == 1
    refined = ["refined_errors", "refined_train", "refined_rollouts", "refinement", "train", "rollouts"]
    for later, earlier in itertools.pairwise(refined):
        assert lengths[earlier] > lengths[later], (earlier, later)
    assert lengths["verdict"] == lengths["score"] + 1
    assert set(lengths) == set(STAGES)


def test_planning_twice_gives_the_same(config):
    assert ids(config) == ids(copy.deepcopy(config))


def test_the_recipes_survive_the_command_line(config):
    for recipe in planned(config).recipes.values():
        assert Recipe.from_json(recipe.to_json()).id == recipe.id


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("evaluation.samples", 3, EVALUATIONS),
        (
            "evaluation.noise_variances",
            [0.5],
            EVALUATIONS | CALIBRATION | BELIEFS | ARM_BELIEFS | {"arms/hockey"},
        ),
        ("recordings.rig.samples", 6, RIG),
        ("recordings.own.repeats", 6, OWN),
        ("recordings.rig.lab.blade.segments", 4, FROM_LAB),
        (
            "recordings.rig.rigs",
            3,
            {"lab/hockey/rig/2", "acting/hockey/2", "policy_acting/hockey/2"}
            | FROM_LAB - LABS - DIAGNOSES - RETRAINING - figures("F6") - ACTS - POLICY_ACTS,
        ),
        ("training.steps", 7, FROM_TRAIN),
        ("training.noise_variance_max", 0.3, FROM_TRAIN),
        ("methods.kalman.drift", 0.5, FROM_KALMAN | figures("F2")),
        ("methods.kalman.learning_rate", 0.5, FROM_KALMAN),
        (
            "methods.lstm.state",
            7,
            of_method("lstm") | {"beliefs/hockey/lstm"} | figures("F5", "F9") | claims("C3") | ACTING,
        ),
        ("methods.maml_8.batch", 7, of_method("maml_8")),
        ("uncertainty.draws", 7, CALIBRATION),
        ("uncertainty.levels", [0.8], CALIBRATION),
        ("uncertainty.queries", 7, CALIBRATION),
        ("uncertainty.samples", [0, 7], CALIBRATION),
        ("uncertainty.shown_noise_variance", 0.7, PREDICTIONS),
        ("latents.samples", [0, 7], BELIEFS),
        ("latents.repeats", 7, BELIEFS),
        ("latents.methods", ["kalman"], figures("F5", "F9") | claims("C3")),
        ("viewer.simulated", 7, {"viewer/hockey"}),
        ("acting.targets", 7, ACTING | POLICY_ACTS),
        ("acting.compared", [], ACTING),
        ("acting.policy.epochs", 7, FROM_POLICY),
        ("acting.policy.updates_on_rigs", 7, POLICY_ACTS | COMPARED),
        ("refinement.nearest", 70, REFINEMENT),
        ("refinement.queries", 7, ERRORS),
        (
            "refinement.retrained",
            [1],
            of_rig(FROM_REFINED_ROLLOUTS, "1") | REFINED,
        ),
        ("acting.draws", 7, ACTING),
        ("acting.inverse.steps", 7, FROM_INVERSE),
        ("acting.exploration.samples", 7, EXPLORATION),
        (
            "retraining.margin",
            0.5,
            {label for label in FROM_ARM_ROLLOUTS if "nominal" not in label},
        ),
        ("retraining.repeats", 7, MEETINGS | ARM_BELIEFS | {"arms/hockey"}),
        ("retraining.method", "lstm", {label.replace("kalman", "lstm") for label in FROM_ARM_TRAIN}),
        ("rollouts.hits", 100, FROM_ROLLOUTS),
        ("rollouts.named_conditions.low friction.friction_x", 0.21, FROM_ROLLOUTS),
        ("randomisation.mass.uniform", [0.02, 0.1], FROM_ROLLOUTS | figures("T1", "T2")),
        (
            "randomisation.friction_y.times",
            "mass",
            FROM_ROLLOUTS | figures("T1", "T2") | VERDICTS | DIAGNOSES | RETRAINING,
        ),
        ("randomisation.mass.label", "Weight", figures("T1", "T2")),
        ("randomisation.mass.unit", "g", figures("T1", "T2")),
        ("swings.test", 9, FROM_SWINGS),
        ("trajectory_model.steps", 9, FROM_MODEL),
        ("trajectory_model.latent", 2, FROM_MODEL | figures("F2")),
        ("demonstrations.count", 100, FROM_DEMONSTRATIONS),
        ("demonstrations.duration_s", 0.9, FROM_DEMONSTRATIONS),
        ("scene.timestep_s", 0.001, FROM_SCENE),
        ("scene.start_m", [0.5, 0.0], FROM_SCENE),
        ("seed", 2, FROM_DEMONSTRATIONS),
        ("cases.seed", 9, FROM_POOL),
        ("cases.pool.speed_m_s", [1.0, 2.0], FROM_POOL),
        ("cases.lab.keep", "tracks only", {"score/small", "score/full"}),
        ("calibration.nulls.seconds", 2.0, NULLS),
        ("calibration.nulls.rigs.arm.seed", 9, {"null_table"} | {n for n in NULLS if "/arm/" in n}),
        ("calibration.nulls.recordings", 4, {"null_table"} | {n for n in NULLS if n.endswith("/2")}),
        ("calibration.coverage.seed", 9, INTERVALS),
        ("calibration.coverage.effects", ["wind"], {"coverage_table"}),
        ("calibration.hit_coverage.hits", 50, OF_HITS),
        ("calibration.hit_coverage.effects", ["curl"], {"hit_coverage_table"}),
        ("figures", ["F7"], set()),
        ("claims", ["C4"], {"claims"}),
        ("regression.tasks", 7, REGRESSION),
        ("regression.kalman.drift", 0.5, REGRESSION),
        ("regression.claims", [], {"claims"}),
        ("regression.figures", [], set()),
    ],
)
def test_a_parameter_changes_what_depends_on_it_and_nothing_else(config, path, value, expected):
    before = ids(config)
    put(config, path, value)
    after = ids(config)
    assert changed(before, after) == expected


def test_the_proof_for_joints_has_one_version_a_case_and_is_made_on_demand(config):
    plan = planned(config)
    assert plan.on_demand >= JOINT_PROOF
    for case in JOINT_CASES:
        recorded, verdict = (
            plan.recipes[f"joint_case/{case.case}"],
            plan.recipes[f"joint_verdict/{case.case}"],
        )
        assert Recipe.from_json(recorded.to_json()).settings(JointCaseSettings).spec == case.spec
        assert recorded.upstream == {}
        assert verdict.upstream == {"case": (recorded.stage, recorded.id)}
        # What is concealed reaches a diagnosis neither by its settings nor by the name of the condition.
        assert verdict.config == {"seed": 0}
    score = plan.recipes["joint_score"]
    assert score.config == {"cases": {"j1": "pair", "j2": "null, cluttered"}}
    assert set(score.upstream) == {"case/j1", "verdict/j1", "case/j2", "verdict/j2"}


def test_a_case_of_joints_changes_its_own_versions_and_the_score(config):
    before = ids(config)
    other = replace(JOINT_CASES[0], spec=replace(JOINT_CASES[0].spec, seed=6))
    joint_cases.write_cases([other, JOINT_CASES[1]], Path(config["cases"]["joints"]))
    assert changed(before, ids(config)) == {"joint_case/j1", "joint_verdict/j1", "joint_score"}
    other = replace(JOINT_CASES[0], condition="single")
    joint_cases.write_cases([other, JOINT_CASES[1]], Path(config["cases"]["joints"]))
    assert changed(before, ids(config)) == {"joint_score"}


def test_every_effect_on_joints_belongs_to_the_code_of_a_verdict_on_joints(config, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "slapshot.store.recipe.code_digest", lambda *modules: asked.append(modules) or "0" * 64
    )
    planned(config)
    effects = {effect.__module__ for effect in joint_effects().values()}
    for stage in ("joint_verdict", "joint_score"):
        (modules,) = {modules for modules in asked if STAGES[stage].module in modules}
        assert effects <= set(modules)


def test_a_plan_needs_no_simulator():
    """What it reads of the lists of cases is text."""
    code = "import sys; from slapshot.dag import load_plan; load_plan(); print('mujoco' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_a_list_of_joints_that_is_not_there_is_named_in_one_line(config):
    config["cases"]["joints"] = "nowhere.csv"
    told = r"^cases\.joints: nowhere\.csv: no such file; .* such as config/cases/joints\.csv$"
    with pytest.raises(InputError, match=told):
        planned(config)


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
    assert changed(before, after) == FROM_SWINGS
    swings["validation"], swings["test"] = swings["test"], swings["validation"]
    assert ids(config) == before


def test_the_order_of_keys_changes_nothing(config):
    before = ids(config)
    assert ids(reordered(config)) == before


def test_ranges_can_be_refined_for_rigs_that_cannot_be_hit_anew(config):
    domain = config["domains"]["hockey"]
    domain["refinement"] |= {"recording": "own", "retrained": []}
    domain["figures"].remove("A5")
    domain["figures"].remove("A3")
    domain["claims"].remove("S11")
    assert not any(label.startswith("refined_") for label in ids(config))


def test_a_recording_adds_versions_and_changes_only_what_shows_all_recordings(config, own):
    before = ids(config)
    config["domains"]["hockey"]["recordings"]["more"] = {"path": str(own), "samples": 3, "repeats": 1}
    after = ids(config)
    new = each("evaluate_recording/hockey/{}/more")
    assert set(after) - set(before) == new | {"diagnosis/hockey/more"}
    assert (
        changed(before, after)
        == new | {"diagnosis/hockey/more"} | figures("F8") | claims("C5") | PREDICTIONS | BELIEFS
    )


def test_a_second_domain_shares_what_is_equal_and_leaves_the_first_alone(config):
    before = ids(config)
    config["domains"]["second"] = copy.deepcopy(config["domains"]["hockey"])
    put(config, "seed", 1)
    config["domains"]["second"]["seed"] = 2
    after = ids(config)
    assert changed(before, {label: after[label] for label in before}) == {"claims"}
    shared = REGRESSION - {"claims"} | FROM_POOL | JOINT_PROOF | NULLS | INTERVALS | OF_HITS
    assert set(after) - set(before) == {
        label.replace("hockey", "second") for label in ALL - shared - {"claims"}
    }
    twice = {label for label in before if label.replace("hockey", "second") in after}
    others = {label for label in twice if after[label.replace("hockey", "second")] == after[label]}
    equal = {"scene/hockey", "diagnosis/hockey/own", "claims"} | shared
    assert others == equal & twice


def test_a_recording_of_ones_own_counts_by_its_content(config, own, tmp_path):
    label = "evaluate_recording/hockey/kalman/own"
    recipe = planned(config).recipes[label]
    names = ("recording.json", "hits.parquet", "tracks.parquet")
    assert recipe.files == {f"own/{name}": file_digest(own / name) for name in names}
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
        assert changed(last, now) == OWN | PREDICTIONS | BELIEFS | {"diagnosis/hockey/own"}
    shutil.rmtree(own)
    with pytest.raises(InputError):
        planned(config)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "figures",
            ["F7", "F99"],
            r"domains\.hockey\.figures\.1: 'F99' cannot be made here; use some of: A1, A2, A3, A4, A5, F1, ",
        ),
        ("figures", ["F3"], r"domains\.hockey\.figures\.0: 'F3' cannot be made here"),
        (
            "claims",
            ["C9"],
            r"domains\.hockey\.claims\.0: 'C9' cannot be made here; use some of: C2, C3, C4, C5, C6, C7, ",
        ),
        ("regression.figures", ["F7"], r"regression\.figures\.0: 'F7' cannot be made here; use some of: F3"),
        ("regression.claims", ["C4"], r"regression\.claims\.0: 'C4' cannot be made here; use some of: C1"),
        (
            "calibration.coverage.effects",
            ["wind", "magic"],
            r"calibration\.coverage\.effects\.1: no effect 'magic'; use some of: actuator_gain, ",
        ),
        (
            "scene.domain",
            "curling",
            r"scene\.domain: no domain 'curling': no module slapshot\.domains\.curling; use",
        ),
        (
            "scene.domain",
            "my.own",
            r"domains\.hockey\.scene\.domain: no domain 'my\.own': no module my\.own; use",
        ),
        (
            "recordings.own.path",
            "nowhere",
            r"recordings\.own\.path: nowhere: no such folder; give the path",
        ),
        ("recordings.own.path", str(ROOT / "tests"), r"recordings\.own\.path: .* holds no recording"),
    ],
)
def test_what_does_not_exist_is_named_in_one_line(config, path, value, message):
    put(config, path, value)
    with pytest.raises(InputError, match=message) as caught:
        planned(config)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "shown", "message"),
    [
        ("figures", ["F7", "F8"], r"domains\.hockey\.figures: F8 needs recordings, .*; name a recording"),
        ("claims", ["C4", "C5"], r"domains\.hockey\.claims: C5 needs recordings, .* or remove C5"),
    ],
)
def test_what_shows_recordings_is_refused_without_any(config, key, shown, message):
    domain = config["domains"]["hockey"]
    domain |= {"recordings": {}, "figures": ["F7"], "claims": ["C4"]}
    # All else can do without.
    assert not planned(config).of_stage("lab")
    domain[key] = shown
    with pytest.raises(InputError, match=message) as caught:
        planned(config)
    assert "\n" not in str(caught.value)


def test_the_whole_catalogue_is_calibrated_if_no_effect_is_named(config):
    put(config, "calibration.coverage.effects", [])
    calibrated = {label.split("/")[1] for label in planned(config).of_stage("law_intervals")}
    assert calibrated == {module.rpartition(".")[2] for module in joint_effect_modules()}


def test_without_claims_there_is_no_report_of_them(config):
    put(config, "claims", [])
    put(config, "regression.claims", [])
    assert not {"claim", "claims"} & {recipe.stage for recipe in planned(config).recipes.values()}


def test_a_method_in_several_sizes_is_one_file(config):
    plan = planned(config)
    put(config, "methods", DOMAIN["methods"])
    more = planned(config)
    codes = {more.recipes[f"train/hockey/maml_{batch}"].code for batch in (1, 4, 8)}
    assert codes == {plan.recipes["train/hockey/maml_8"].code}
    assert more.recipes["train/hockey/kalman"].code not in codes


def test_models_of_an_ensemble_are_spread_over_jobs(config):
    whole = planned(config)
    put(config, "training.models", 5)
    put(config, "training.jobs", 2)
    spread = planned(config)
    joined = spread.recipes["train/hockey/kalman"]
    parts = [spread.recipes[f"train_part/hockey/kalman/{k}"] for k in range(2)]
    assert dict(joined.upstream) == {f"part/{k}": (r.stage, r.id) for k, r in enumerate(parts)}
    assert sum(part.config["training"]["models"] for part in parts) == 5
    assert len({part.config["training"]["seed"] for part in parts}) == 2
    assert {role for part in parts for role in part.upstream} == {"rollouts"}
    assert joined.code == parts[0].code == whole.recipes["train/hockey/kalman"].code
    assert spread.recipes["evaluate/hockey/kalman"].upstream["train"] == ("train", joined.id)
    refined = spread.recipes["refined_train/hockey/0"]
    assert {stage for stage, _ in refined.upstream.values()} == {"refined_train_part"}
    assert spread.recipes["refined_train_part/hockey/0/1"].upstream["train"] == ("train", joined.id)
    put(config, "training.jobs", 6)
    with pytest.raises(InputError, match=r"training\.jobs.*training\.models"):
        planned(config)


def test_a_version_that_nobody_asks_for_is_named(config):
    with pytest.raises(InputError, match="no version train/0123456789ab; see `slapshot versions why train`"):
        planned(config).by_id("train", "0123456789ab")


def test_planning_needs_neither_torch_nor_mujoco():
    """A plan is made at every call of snakemake, and on machines where a stage's library may be broken."""
    code = (
        "import sys\n"
        "from slapshot.config.files import load_config\n"
        "from slapshot.dag import make_plan\n"
        "make_plan(load_config())\n"
        "heavy = {'torch', 'mujoco', 'dm_control', 'numba', 'matplotlib', 'scipy'}\n"
        "print(*sorted(heavy & set(sys.modules)))\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
