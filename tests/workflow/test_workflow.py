"""The whole workflow on the tiny configuration: what runs, what runs again, and what is left behind.

One full run is shared by all tests, which put back what they change; tests/faults kills others.
"""

import json
import re
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from slapshot.command import Run
from slapshot.diagnosis import stage_verdict
from slapshot.diagnosis.pucks.stage_verdict import produce
from slapshot.store.recipe import Recipe
from workspace import Version, Workspace, downstream, job_counts, snakemake_command

pytestmark = pytest.mark.workflow


def jobs_of(versions: dict[str, Version], labels: set[str]) -> dict[str, int]:
    """Rule -> jobs that make the versions with these labels."""
    unique = {(versions[label].stage, versions[label].id) for label in labels}
    return dict(Counter(f"{stage}_version" for stage, _ in unique))


def of_stages(versions: dict[str, Version], *stages: str) -> set[str]:
    return {label for label, version in versions.items() if version.stage in stages}


def of_hockey(labels: set[str]) -> set[str]:
    """Those that a change of hockey's settings (see Workspace.variant) can touch."""
    return {label for label in labels if label.split("/")[1:2] != ["fetchslide"]}


def figure(versions: dict[str, Version], *names: str) -> set[str]:
    return {label for label in of_stages(versions, "figure") if label.rpartition("/")[2] in names}


def manifest_ids(workspace: Workspace) -> set[str]:
    return set(workspace.manifest().values())


def shown_ids(versions: dict[str, Version]) -> set[str]:
    """Versions whose files are published."""
    return {f"{versions[n].stage}/{versions[n].id}" for n in of_stages(versions, "figure", "claims", "score")}


def fewer_queries(domain: dict) -> None:
    domain["evaluation"]["queries"] -= 1


def no_operation(text: str) -> str:
    """A statement without effect."""
    return text + "\n_ = None\n"


SLAPSHOT = ("-c", "from slapshot.cli import main; main()")


def comment(text: str) -> str:
    return "# A comment.\n\n" + text.replace('"""', '"""In other words: ', 1) + "\n# Another.\n"


# --- The first run


def test_the_copy_runs_its_own_code(workspace):
    done = workspace.python("-c", "import slapshot; print(slapshot.__file__)")
    assert Path(done.stdout.strip()).is_relative_to(workspace.root)


def test_everything_is_made_and_published_and_nothing_is_left_over(workspace):
    versions = workspace.plan()
    for version in versions.values():
        assert workspace.content(version)
        log = workspace.log(version)
        assert f"{version.id} made" in log.read_text()
        assert log.with_suffix(".tsv").read_text().startswith("s\t")
    assert manifest_ids(workspace) == shown_ids(versions)
    for version_id in shown_ids(versions):
        if version_id.startswith("score/"):
            assert {"small-proof/proof.md", "small-proof/proof.csv"} < set(workspace.manifest())
            continue
        files = {name for name, source in workspace.manifest().items() if source == version_id}
        kinds = {".md", ".html", ".csv"} if version_id.startswith("claims/") else {".png", ".pdf", ".csv"}
        assert {Path(name).suffix for name in files} == kinds
        assert len({Path(name).stem for name in files}) == 1
    assert not list((workspace.root / "data/store").glob("*/.*"))


def test_the_scene_is_drawn(workspace, can_render):
    if not can_render:
        pytest.skip("no GL library here: figure F6 was left out of all runs of this file")
    assert figure(workspace.plan(), "F6")
    assert list(workspace.published.glob("F6-*.png"))


def test_the_second_run_only_publishes(workspace):
    before = {p: p.stat().st_mtime_ns for p in workspace.published.iterdir() if p.suffix != ".json"}
    assert job_counts(workspace.snakemake("figures").stdout) == {"figures": 1}
    assert {p: p.stat().st_mtime_ns for p in before} == before


def test_the_default_target_is_the_figures(workspace):
    assert job_counts(workspace.snakemake("--dry-run").stdout) == {"figures": 1}


def test_every_stage_can_be_asked_for_by_its_name(workspace):
    stages = {version.stage for version in workspace.plan().values()} - {"figure", "claim"}
    assert job_counts(workspace.snakemake("--dry-run", *sorted(stages)).stdout) == {}


def test_a_diagnosis_says_the_same_without_the_truth(workspace, tmp_path):
    """Twice the same bytes, and nothing of the sealed file in them."""
    versions = workspace.plan()
    for label in sorted(of_stages(versions, "verdict")):
        folder = workspace.folder(versions[label])
        recipe = Recipe.from_json(json.dumps(json.loads((folder / "version.json").read_text())["recipe"]))
        inputs = {
            role: workspace.root / "data/store" / stage / name
            for role, (stage, name) in recipe.upstream.items()
        }
        sealed = inputs["recording"]
        assert (sealed / "truth/truth.json").is_file()
        inputs["recording"] = tmp_path / label / sealed.name
        shutil.copytree(sealed / "recording", inputs["recording"] / "recording")
        out = tmp_path / label / "out"
        out.mkdir()
        produce(Run(recipe.config, inputs, out, 1))
        assert (out / "verdict.json").read_bytes() == (folder / "verdict.json").read_bytes()


@pytest.fixture
def aside(workspace):
    """Folder of what is published, from which all is removed that was not there before."""
    before = {p for p in workspace.published.rglob("*") if p.is_file()}
    yield workspace.published
    for file in {p for p in workspace.published.rglob("*") if p.is_file()} - before:
        file.unlink()


def test_the_proof_is_published_with_its_versions(workspace, aside):
    done = workspace.snakemake("proof")
    assert "0 of 2 jobs done" in done.stdout
    assert job_counts(done.stdout) == {"score_version": 1, "proof": 1}
    measures = pd.read_csv(aside / "proof.csv")
    assert list(measures.columns) == ["lab", "measure", "condition", "value", "low", "high", "n"]
    assert set(measures["lab"]) == {"first"}
    assert "A small proof" not in (aside / "proof.md").read_text()
    versions = json.loads((aside / "proof/versions.json").read_text())
    verdicts = {v.id for label, v in workspace.plan().items() if label.startswith("verdict/small/")}
    assert {name for role, name in versions.items() if role.startswith("verdict/")} == verdicts
    assert len(pd.read_csv(aside / "proof/cases.csv")) == len(verdicts)


def test_the_proof_for_joints_is_made_case_by_case_and_published_beside_the_other(workspace, aside, tmp_path):
    first = "lab,measure,condition,value,low,high,n\nfirst,in_class,plain,0.9,0.8,1,53\n"
    (aside / "proof.csv").write_text(first)
    done = workspace.snakemake("proof_joints")
    assert "0 of 6 jobs done" in done.stdout
    assert job_counts(done.stdout) == {
        "joint_case_version": 2,
        "joint_verdict_version": 2,
        "joint_score_version": 1,
        "proof_joints": 1,
    }
    assert (aside / "proof.csv").read_text().startswith(first + "joints,")
    assert "| false_alarm | null |" in (aside / "proof_joints.md").read_text()
    assert "stand-in" in (aside / "proof_joints.md").read_text()
    made_from = json.loads((aside / "proof-joints/versions.json").read_text())
    assert len(pd.read_csv(aside / "proof-joints/cases.csv")) == 2
    assert job_counts(workspace.snakemake("--dry-run", "proof_joints").stdout) == {"proof_joints": 1}

    # A verdict is the same without a truth to read, but for its time and for rounding by other threads.
    store = workspace.root / "data/store"
    case, verdict = (store / f"joint_{s}" / made_from[f"{s}/t0000"] for s in ("case", "verdict"))
    assert (case / "sealed/truth.json").is_file()
    shutil.copytree(case, tmp_path / case.name, ignore=shutil.ignore_patterns("sealed", "version.json"))
    stage_verdict.produce(Run({"seed": 0}, {"case": tmp_path / case.name}, tmp_path, 1))
    said = [json.loads((folder / "verdict.json").read_text()) for folder in (tmp_path, verdict)]
    assert [one.pop("cpu_s") > 0 for one in said] == [True, True]
    assert alike(said[0], said[1])


def alike(one: Any, other: Any) -> bool:
    """Whether two JSON values are the same but for digits of numbers."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(alike, one, other))
    if isinstance(one, float):
        return other == pytest.approx(one, rel=1e-3, abs=1e-9)
    return one == other


def test_the_calibration_is_published_and_resumes(workspace, aside):
    done = workspace.snakemake("nulls", "joint_coverage")
    assert job_counts(done.stdout) == {
        "null_p_values_version": 6, "null_table_version": 1, "nulls": 1,
        "law_intervals_version": 1, "coverage_table_version": 1, "joint_coverage": 1,
    }  # fmt: skip
    assert pd.read_csv(aside / "joint_nulls.csv")["n"].tolist() == [2, 2, 2, 2, 2, 2, 8]
    assert pd.read_csv(aside / "coverage.csv")["effect"].tolist() == ["viscous_friction", "all"]
    assert {f"joint_nulls.{kind}" for kind in ("md", "png", "pdf")} < {p.name for p in aside.iterdir()}
    assert len(json.loads((aside / "nulls/versions.json").read_text())) == 7
    again = workspace.snakemake("--dry-run", "nulls", "joint_coverage")
    assert job_counts(again.stdout) == {"nulls": 1, "joint_coverage": 1}


def test_what_is_found_goes_back_into_rollouts_and_models(workspace, aside):
    done = workspace.snakemake("circle")
    jobs = job_counts(done.stdout)
    assert jobs["arm_rollouts_version"] == jobs["train_version"] == 2
    assert jobs["evaluate_recording_version"] == 6
    page = (aside / "circle-hockey/arms.md").read_text()
    assert "stand-in rig" in page
    measures = pd.read_csv(aside / "circle-hockey/arms.csv").set_index(["measure", "condition"])["value"]
    assert np.isfinite(measures).all()
    assert {p.name for p in (aside / "circle-hockey").glob("*.png")} == {
        "F8-hockey-arms.png",
        "F9-hockey-arms.png",
    }
    assert job_counts(workspace.snakemake("--dry-run", "circle").stdout) == {"circle": 1}


# --- Parameters


@pytest.mark.parametrize(
    ("change", "stages", "figures"),
    [
        (fewer_queries, {"evaluate"}, {"F7"}),
        (
            lambda d: d["evaluation"].update(noise_variances=[0.3]),
            {"evaluate", "calibrate", "beliefs"},
            {"F1", "F7", "F9", "U1", "U2"},
        ),
        (lambda d: d["training"].update(steps=d["training"]["steps"] - 1), {"train"}, {"M1", "F7", "F8"}),
        (lambda d: d.update(randomisation={"mass": {"label": "Weight"}}), set(), {"T2"}),
    ],
)
def test_a_parameter_changes_what_depends_on_it(workspace, change, stages, figures):
    config = workspace.variant("changed", change)
    versions = workspace.plan(config)
    labels = of_hockey(of_stages(versions, *stages) | figure(versions, *figures))
    assert labels
    assert workspace.missing(versions) == downstream(versions, labels)


def test_a_parameter_of_the_scene_reruns_everything_that_needs_a_scene(workspace):
    config = workspace.variant("scene", lambda d: d.update(scene={"start_m": [0.56, 0.0]}))
    versions = workspace.plan(config)
    none = figure(versions, "T2", "F2") | downstream(versions, of_stages(versions, "regression")) - {"claims"}
    assert workspace.to_do(config=config) == jobs_of(versions, of_hockey(set(versions) - none))


def test_swapped_values_rerun_and_flipping_back_reruns_nothing(workspace):
    """Snakemake compares parameters as a set: it alone would miss the swap."""
    first = workspace.variant("queries", fewer_queries)

    def swap(domain: dict) -> None:
        fewer_queries(domain)
        evaluation = domain["evaluation"]
        assert evaluation["samples"] != evaluation["queries"]
        evaluation["samples"], evaluation["queries"] = evaluation["queries"], evaluation["samples"]

    second = workspace.variant("swapped", swap)
    versions = workspace.plan(first)
    jobs = jobs_of(versions, downstream(versions, of_hockey(of_stages(versions, "evaluate"))))
    # C5 holds recorded errors against simulated ones.
    assert (jobs["figure_version"], jobs["claim_version"]) == (1, 2)
    original = workspace.manifest()
    bytes_of = {name: (workspace.published / name).read_bytes() for name in original}
    assert job_counts(workspace.snakemake("figures", config=first).stdout) == jobs | {"figures": 1}
    after_first = workspace.manifest()
    changed = {name for name in original if original[name] != after_first[name]}
    assert changed == {name for name in original if name.startswith(("F7-", "claims."))}
    assert workspace.to_do(config=second) == jobs

    assert workspace.to_do(config=first) == {}
    assert job_counts(workspace.snakemake("figures").stdout) == {"figures": 1}
    assert workspace.manifest() == original
    assert {name: (workspace.published / name).read_bytes() for name in original} == bytes_of


# --- Code


def test_an_edited_module_changes_exactly_what_imports_it(workspace):
    edited: dict[str, tuple[set[str], set[str]]] = {  # stages, figures
        "adaptation/scoring.py": ({"evaluate", "evaluate_recording", "refined_errors"}, set()),
        "adaptation/train.py": ({"train", "train_part"}, set()),
        "adaptation/intervals.py": ({"calibrate", "predictions"}, set()),
        "statistics.py": ({"claim", "score"}, {"F5", "F9"}),
        "error_curves.py": (set(), {"A1", "A2", "A4", "A5", "F3", "F4", "F7", "F8"}),
        "rollouts/slide.py": ({"rollouts", "policy"}, set()),
    }
    plans = workspace.plans_after(*((file, no_operation) for file in edited))
    for (file, (stages, figures)), versions in zip(edited.items(), plans, strict=True):
        touched = of_stages(versions, *stages) | figure(versions, *figures)
        touched = of_hockey(touched) if file == "rollouts/slide.py" else touched
        assert touched
        assert workspace.missing(versions) == downstream(versions, touched), file


def test_an_edited_module_reruns_what_imports_it(workspace):
    (versions,) = workspace.plans_after(("adaptation/intervals.py", no_operation))
    with workspace.edited("adaptation/intervals.py", no_operation):
        assert workspace.to_do() == jobs_of(versions, workspace.missing(versions))


def test_comments_and_modules_that_no_result_depends_on_rerun_nothing(workspace):
    with (
        workspace.edited("config/configuration.py", no_operation),
        workspace.edited("dag/results.py", no_operation),
        workspace.edited("publish.py", no_operation),
        workspace.edited("adaptation/scoring.py", comment),
        workspace.edited("scenes/scene.py", comment),
        workspace.edited("store/folder.py", no_operation),
        workspace.edited("progress.py", no_operation),
    ):
        assert workspace.to_do() == {}


def test_a_module_with_a_syntax_error_is_named_in_one_line(workspace):
    with workspace.edited("adaptation/scoring.py", lambda text: text + "\n)\n"):
        done = workspace.snakemake("--dry-run", "figures", good=False)
    lines = [line for line in done.stdout.splitlines() if "scoring.py" in line]
    assert len(lines) == 1
    assert "not valid Python (unmatched ')'); mend that line" in lines[0]
    assert "Traceback" not in done.stdout


# --- What is lost is made again


def test_a_lost_payload_and_a_lost_file_of_another_are_made_again_and_published(workspace):
    """Equal to what was there, and nothing else is made."""
    versions = workspace.plan()
    first, second = (versions[label] for label in sorted(of_stages(versions, "evaluate"))[:2])
    lost = {first, second}
    content = {version: workspace.content(version) for version in lost}
    manifest = workspace.manifest()
    made_at = {
        name: (workspace.folder(v) / "version.json").stat().st_mtime_ns for name, v in versions.items()
    }
    shutil.rmtree(workspace.folder(first))
    next(workspace.folder(second).glob("*.parquet")).unlink()
    next(workspace.published.glob("F7-*.png")).unlink()
    # Snakemake also calls the stages next to them; they find their versions whole and leave them alone.
    jobs = job_counts(workspace.snakemake("figures").stdout)
    assert set(jobs) == {"evaluate_version", "figure_version", "claim_version", "figures"}
    assert {version: workspace.content(version) for version in lost} == content
    assert workspace.manifest() == manifest
    for name, version in versions.items():
        time = (workspace.folder(version) / "version.json").stat().st_mtime_ns
        assert (time != made_at[name]) == (version in lost)


def test_a_damaged_payload_stops_publishing_and_says_what_to_do(workspace):
    versions = workspace.plan()
    version = versions[sorted(of_stages(versions, "train"))[0]]
    file = workspace.folder(version) / "losses.csv"
    text = file.read_text()
    try:
        file.write_text(text + "1\n")
        done = workspace.snakemake("figures", good=False)
    finally:
        file.write_text(text)
    path = f"data/store/train/{version.id}"
    advice = f"{path}/losses.csv is not what was written there; run `slapshot versions verify --repair` ("
    assert advice in done.stdout


# --- Failure


def test_fail_mend_rerun_leaves_nothing_stale(workspace):
    """Two figures are due; one of them fails, and its old picture must not stay."""

    def change(domain: dict) -> None:
        fewer_queries(domain)
        domain["randomisation"] = {"mass": {"label": "Weight of the puck"}}

    config = workspace.variant("two figures", change)

    def fail(text: str) -> str:
        return text + "\n1 / 0\n"

    (broken,) = workspace.plans_after(("figures/randomisation_table.py", fail), config=config)
    with workspace.edited("figures/randomisation_table.py", fail):
        kept = shown_ids(broken) - {f"figure/{broken[n].id}" for n in figure(broken, "T1", "T2")}
        done = workspace.snakemake("figures", config=config, good=False)
        assert "ZeroDivisionError: division by zero; the traceback is in logs/figure/" in done.stdout
        assert manifest_ids(workspace) == kept
        # The same call again still fails, and does not forget.
        workspace.snakemake("figures", config=config, good=False)
        assert manifest_ids(workspace) == kept
        assert not list((workspace.root / "data/store").glob("*/.*"))
    workspace.snakemake("figures", config=config)
    mended = workspace.plan(config)
    assert manifest_ids(workspace) == shown_ids(mended)
    table = pd.read_csv(next(workspace.published.glob("T2-*.csv")))
    assert "Weight of the puck" in set(table["label"])
    assert workspace.to_do(config=config) == {}

    workspace.snakemake("figures")
    assert manifest_ids(workspace) == shown_ids(workspace.plan())


def test_without_a_gl_library_only_what_renders_fails_and_names_the_package(workspace, can_render):
    if not can_render:
        pytest.skip("no GL library here: figure F6 was left out of all runs of this file")
    hidden = ('"libEGL.so.1"', '"libOSMesa.so.8"')

    def hide(text: str) -> str:
        assert all(name in text for name in hidden)
        return text.replace(hidden[0], '"libnot-here.so"').replace(hidden[1], '"libnor-here.so"')

    (versions,) = workspace.plans_after(("figures/rendering.py", hide))
    rendered = figure(versions, "F6")
    with workspace.edited("figures/rendering.py", hide):
        done = workspace.snakemake("figures", good=False)
        assert job_counts(done.stdout) == jobs_of(versions, rendered) | {"figures": 1}
        assert "] no GL library to render with: install libegl1" in done.stdout
        assert manifest_ids(workspace) == shown_ids(versions) - {f"figure/{versions[n].id}" for n in rendered}
    workspace.snakemake("figures")
    assert manifest_ids(workspace) == shown_ids(workspace.plan())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: tiny\ncolour: red\n", "bad.yaml:2: colour: unknown key 'colour'; remove it, or use one of: "),
        (
            "name: tiny\ndomains: {hockey: {rollouts: {hits: many}}}\n",
            "bad.yaml:2: domains.hockey.rollouts.hits: 'many' is not a whole number; write a whole number",
        ),
        (
            "name: tiny\ndomains: {hockey: {training: {sequence: 1000}}}\n",
            "bad.yaml:2: domains.hockey.training.sequence: 1000 is more than rollouts.hits",
        ),
        (
            "name: tiny\ndomains: {hockey: {figures: [F99]}}\n",
            "bad.yaml:2: domains.hockey.figures.0: 'F99' cannot be made",
        ),
    ],
)
def test_a_bad_configuration_is_refused_in_one_line(workspace, text, message):
    config = workspace.root / "bad.yaml"
    config.write_text(text)
    before = sorted((workspace.root / "data/store").rglob("*"))
    manifest = workspace.manifest()
    done = workspace.snakemake("figures", config=config, good=False)
    assert sum(message in line for line in done.stdout.splitlines()) == 1
    assert "Traceback" not in done.stdout
    assert sorted((workspace.root / "data/store").rglob("*")) == before
    assert workspace.manifest() == manifest


def test_an_unknown_key_on_the_command_line(workspace):
    command = (*snakemake_command("figures", config=workspace.config), "--config", "colour=red")
    done = workspace.run(*command)
    known = "calibration, cases, domains, name, proof, regression"
    assert done.returncode != 0
    problem = f"--config: colour: unknown key 'colour'; remove it, or use one of: {known}\n"
    assert done.stdout.count(problem) == 1


# --- Stages by hand


def test_a_stage_by_hand_finds_its_version(workspace):
    done = workspace.python(*SLAPSHOT, "stage", "rollouts", "--config", workspace.config)
    ids = {label: v.id for label, v in workspace.plan().items() if v.stage == "rollouts"}
    assert done.returncode == 0
    assert set(done.stdout.splitlines()) == {
        f"[{label.replace('/', ' ')}] {id_} is already whole" for label, id_ in ids.items()
    }


def test_a_stage_by_hand_without_its_input_says_what_to_run(workspace, tmp_path):
    command = (*SLAPSHOT, "stage", "rollouts", "--config", workspace.config, "--store", tmp_path)
    done = workspace.python(*command)
    assert done.returncode == 1
    assert re.match(r"\[rollouts \w+\] rollouts needs scene/", done.stdout)
    assert done.stdout.endswith("run `snakemake scene` first\n")
    assert done.stdout.count("\n") == 1
    assert not list(tmp_path.rglob("*"))
