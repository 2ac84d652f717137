"""Bad configurations: each ends as one line with file, line, key and remedy, before anything is computed."""

import functools
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bad_configs import DELETE, ROOT, Bad, base, mistakes
from slapshot import cli
from slapshot.config.configuration import Configuration
from slapshot.config.files import read_config
from slapshot.dag import Plan, load_plan, make_plan
from slapshot.errors import InputError
from slapshot.store.code_dependencies import code_digest
from slapshot.validation import key_of, validated
from slapshot.yaml_file import Loc

HOCKEY = "domains.hockey"
LAB = ".recordings.lab.lab"
OWN = {"path": "nowhere", "samples": 4, "repeats": 1}
ROLLOUTS = base()["domains"]["hockey"]["rollouts"]
LONGEST = 800  # characters of a message, of which the longest lists all kinds of concealed physics

_digest_once = functools.cache(code_digest)


@pytest.fixture(autouse=True)
def _in_root(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("slapshot.store.recipe.code_digest", _digest_once)


def message_of(config: dict[str, Any]) -> str:
    with pytest.raises(InputError) as caught:
        plan(config)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < LONGEST
    assert "; " in message, "no remedy"
    return message


def plan(config: dict[str, Any], where: Callable[[Loc], str] = lambda loc: "my.yaml") -> Plan:
    return make_plan(validated(Configuration, config, where), where)


def put(path: str, value: Any) -> dict[str, Any]:
    """The base configuration with one value set; below domains.hockey if the path starts with a dot."""
    return Bad(loc_of(path), value).config()


def loc_of(path: str) -> tuple[str | int, ...]:
    parts = (HOCKEY + path if path.startswith(".") else path).split(".")
    return tuple(int(part) if part.isdigit() else part for part in parts)


def test_the_base_is_good():
    assert plan(base()).recipes


MISTAKES: dict[str, list[Bad]] = {}
for bad in mistakes():
    MISTAKES.setdefault(key_of(bad.loc[:-1]), []).append(bad)


def test_the_mistakes_are_many():
    assert sum(map(len, MISTAKES.values())) > 1500


@pytest.mark.parametrize("block", MISTAKES)
def test_whatever_the_models_bound_is_refused_beyond(block):
    for bad in MISTAKES[block]:
        assert message_of(bad.config()).startswith(f"my.yaml: {bad.place}: "), bad


@pytest.mark.parametrize(
    ("path", "value", "told", "problem"),
    [
        # Values of a key that do not go together.
        (".demonstrations.place_m", [1, 0, 0, 1], "", "holds no place; write lowest x"),
        (f"{LAB}.camera.view_m", [3.0, -0.2, -1.5, 1.5], "", "holds no place; write lowest x"),
        (f"{LAB}.camera.mistrack_m", [0.2, 0.05], "", "runs backwards"),
        (f"{LAB}.board.wavelength_m", [1.5, 0.3], "", "runs backwards"),
        (f"{LAB}.objects.red.friction_x", [0.5, 0.3], "", "runs backwards"),
        (f"{LAB}.objects.red.mass_kg", [0.2, 0.1], "", "runs backwards"),
        (f"{LAB}.blade.stiffness_nm_rad", [60, 10], "", "runs backwards"),
        # Values of a block.
        (".randomisation.mass.uniform", None, "", "null says nothing here; write a value or leave"),
        (".randomisation.friction_x.uniform", [0, 0], "", "nothing comes to rest; write a high > 0"),
        (".randomisation.friction_y.uniform", [0.0, 0.0], "", "nothing comes to rest"),
        (".randomisation.mass.label", "$m", "", r"'\$m' is not allowed; use characters other than \$ and"),
        (".rollouts", ROLLOUTS | {"train": 9_000_000, "hits": 200}, "", "more than 1,000,000,000; lower"),
        ("regression.kalman.latent", 3, "", "3 dimensions cannot be drawn in F3; write 2"),
        (".viewer", {"simulated": 0, "recorded": 0}, "", "no hit to show; let"),
        (f"{LAB}.repeats", {"commands": 20, "times": 4}, "", "20 commands x 4 times are more than hits = 64"),
        (f"{LAB}.camera.after_rest_s", 0.1, "", "0.1 s at 30.0 Hz show an object at rest in 3 frames; raise"),
        (f"{LAB}.concealed.0", {"kind": "tilt"}, "", "has none of amplitude, displacement; give exactly"),
        (f"{LAB}.concealed.0.displacement", 1, f"{LAB}.concealed.0", "has amplitude and displacement of"),
        (f"{LAB}.concealed.1", {"kind": "tilt", "amplitude": 1}, "", "tilt stands twice; give it once"),
        (f"{LAB}.concealed.0", {"kind": "compliant_blade", "amplitude": 0.1}, "", "bend the same blade; set"),
        (f"{LAB}.concealed.0.kind", "tit", "", "'tit' is not allowed; write tilt"),
        (
            f"{LAB}.scatter",
            {"start_error_sd_m": 0, "speed_sd": 0, "joint_offset_sd_rad": [0] * 7, "friction_sd": 0},
            f"{LAB}.concealed.1",
            "a displacement needs scatter to be measured by; give an amplitude",
        ),
        (f"{LAB}.scatter.joint_offset_sd_rad", [0.01] * 3, "", "3 values for 7 joints; give one for each"),
        (f"{LAB}.scatter.joint_offset_sd_rad", [], "", "0 values for 7 joints; give one for each"),
        (".recordings.lab.rigs", DELETE, ".recordings.lab", "key 'rigs' is missing; add it"),
        (".recordings.lab.path", "data", ".recordings.lab", "has lab and path of lab, path; give exactly on"),
        (".recordings.rig", OWN | {"rigs": 1}, ".recordings.rig.rigs", "is of one rig; remove the key"),
        (".recordings.lab.samples", 64, "", "leave none of lab.hits = 64 to predict; lower the first"),
        (".acting.exploration.samples", 33, "", "33 hits cannot be chosen from 32 candidates; lower the fir"),
        # Values of several blocks.
        (".uncertainty.queries", 49, ".uncertainty", "= 65 hits of a condition, but rollouts.hits is 64; lo"),
        (".latents.samples", [0, 65], "", "65 is more than rollouts.hits = 64; lower"),
        (".latents.samples", [64], "", "65 is more than recordings.lab.lab.hits = 64; lower"),
        (".refinement.samples", 33, "", "twice the number, 66 is more than rollouts.hits = 64; lower"),
        (".refinement.nearest", 3001, "", "3001 is more than rollouts.train = 3000; lower"),
        (".retraining.samples", 64, "", "65 is more than recordings.lab.lab.hits = 64; lower"),
        (".acting.exploration.candidates", 64, "", "65 is more than recordings.lab.lab.hits = 64; lower"),
        (".uncertainty.method", "gru", "", "'gru' is not among the domain's methods; use one of: kalman, ls"),
        (".uncertainty.method", "lstm", "", "'lstm' has no belief to draw phi from; use kalman"),
        (".latents.methods", ["lstm", "gru"], ".latents.methods.1", "'gru' is not among the domain's method"),
        (".acting.method", "kalman_2", "", "'kalman_2' is not among the domain's methods; use one of"),
        (".acting.method", "maml_1", "", "'maml_1' has no belief to draw phi from; use kalman"),
        (".acting.compared", ["lstm", "maml"], ".acting.compared.1", "'maml' is not among the domain's meth"),
        (".acting.compared", ["kalman"], "", "'kalman' is `method` itself; name others or none"),
        (".retraining.method", "gru", "", "'gru' is not among the domain's methods; use one of"),
        (".refinement.method", "gru", "", "'gru' is not among the domain's methods; use one of"),
        (".retraining.recording", "rig", "", "'rig' is not among the domain's recordings; use one of: lab"),
        (".refinement.recording", "rig", "", "'rig' is not among the domain's recordings; use one of: lab"),
        (".acting.recording", "rig", "", "'rig' is not among the domain's recordings; use one of: lab"),
        (".refinement.retrained", [0, 20], ".refinement.retrained.1", "there is no rig 20; .* rigs 0 to 19"),
        ("cases.domain", "curling", "", "no domain 'curling'; use one of: hockey"),
        ("cases.like", "rig", "", "'rig' is no recording of stand-in rigs of domains.hockey; use one of: la"),
        ("cases.lab.colour", 1, "", "unknown key 'colour'; remove it, or use"),
        ("cases.lab.camera.rate_hz", -50, "", "-50 is out of range; it must be > 0"),
        ("cases.lab.camera.rate_hz", "50", "", "'50' is not a number; write a number such as 50.0"),
        ("cases.lab.keep", "all", "", "'all' is not allowed; use one of: full"),
        ("cases.lab.scatter", None, "", "None is not a mapping; write a mapping"),
        ("cases.lab.objects", {"green": {"mass_kg": 1}}, "cases.lab.objects.green", "key 'friction_ratio' i"),
        ("cases.pool.colour", 1, "", "unknown key 'colour'; remove it, or use"),
        # Names.
        ("name", "proof", "", "figures/proof is a folder of the default configuration; write another name"),
        ("name", "small-proof", "", "is a folder of the default"),
        ("name", "proof-joints", "", "is a folder of the default"),
        ("name", "circle-hockey", "", "is a folder of the default"),
        ("name", "fresh", "", "is a folder of the default"),
        ("name", "-rf", "", "'-rf' is not allowed; use letters, digits, _ and -, the first a letter or digi"),
        ("name", "tiny\n", "", "is not allowed; use letters"),
        (".methods.lstm_2\n", {}, "", "unknown key 'lstm_2.n'; write 'lstm'"),
        (".scene.domain", "table", "", "nothing strikes the box of a 'table'; name hockey"),
        (".scene.domain", "../domains/hockey", "", "is not allowed; use what matches"),
    ],
)  # fmt: skip
def test_values_that_contradict_each_other_are_told_with_their_place(path, value, told, problem):
    message = message_of(put(path, value))
    assert message.startswith(f"my.yaml: {key_of(loc_of(told or path))}: ")
    assert re.search(problem, message), message


@pytest.mark.parametrize("block", ["acting", "refinement"])
def test_only_stand_in_rigs_can_be_hit_anew(block):
    config = put(".recordings.own", OWN)
    config["domains"]["hockey"][block]["recording"] = "own"
    problem = "'own' is no recording of stand-in rigs, which alone can be hit anew; use one of: lab, scripted"
    assert message_of(config) == f"my.yaml: domains.hockey.{block}.recording: {problem}"
    config["cases"]["like"] = "own"
    config["domains"]["hockey"][block]["recording"] = "lab"
    assert message_of(config).startswith(
        "my.yaml: cases.like: 'own' is no recording of stand-in rigs of domai"
    )


@pytest.mark.parametrize(
    ("path", "value", "told", "problem"),
    [
        (".figures", ["F7", "F99"], ".figures.1", "'F99' cannot be made here; use some of: A1, A2"),
        (".figures", ["F3"], ".figures.0", "'F3' cannot be made here"),
        (".figures", ["f7"], ".figures.0", "'f7' cannot be made here"),
        (".claims", ["C9"], ".claims.0", "'C9' cannot be made here; use some of: C2"),
        ("regression.figures", ["F7"], "regression.figures.0", "'F7' cannot be made here; use some of: F3"),
        ("regression.claims", ["C4"], "regression.claims.0", "'C4' cannot be made here; use some of: C1"),
        (".acting", DELETE, ".claims", "C6 needs a block `acting` and a recording of stand-in rigs; add"),
        (".refinement", DELETE, ".claims", "S11 needs a block `refinement` and a recording of stand-in rigs"),
        (".recordings", {}, ".claims", "C5 needs recordings, but domains.hockey.recordings is empty; name a"),
        (".scene.domain", "curling", "", "no module slapshot.domains.curling; use the name of a folder"),
        (".scene.domain", "my.own", "", "no module my.own; use"),
        (".scene.domain", "os.path", "", "no module os.path; use"),
        (".scene.domain", "sys.x", "", "no module sys.x; use"),
        (".scene.domain", "__main__.x", "", "no module __main__.x; use"),
        (".scene.domain", "slapshot.scenes.striker", "", r"striker.py\) is no domain"),
        (".scene.domain", "json.decoder", "", "is no domain, for it has no build_scene and no draw_task"),
        (".recordings.own", OWN, ".recordings.own.path", "nowhere: no such folder; give the path of a recor"),
        (".recordings.own", OWN | {"path": "README.md"}, ".recordings.own.path", "cannot be read as a folde"),
        (".recordings.own", OWN | {"path": "config"}, ".recordings.own.path", "has no recording.json and no"),
        (".recordings.own", OWN | {"path": "x" * 400}, ".recordings.own.path", "; give the path of a record"),
        (".recordings.own", OWN | {"path": "a\0b"}, ".recordings.own.path", "unprintable character; remove"),
        ("cases.small", "nowhere.csv", "", "nowhere.csv: no such file; name a list of cases"),
        ("cases.published", "config", "", "config: no such file; name a list of cases"),
        ("cases.joints", "config", "", "config: no such file; name a list of cases"),
        ("cases.pool.count", 30, "", "case .* in config/cases/.*.csv hits each of 2 .* even executed twice"),
        ("cases.lab.repeats", {"commands": 10, "times": 6}, "cases.small", "hits of case .* are too few for"),
    ],
)  # fmt: skip
def test_what_does_not_exist_is_told_with_its_place(path, value, told, problem):
    message = message_of(put(path, value))
    assert message.startswith(f"my.yaml: {key_of(loc_of(told or path))}: ")
    assert re.search(problem, message), message


def _recording(folder: Path) -> Path:
    folder.mkdir()
    for name in ("recording.json", "hits.parquet", "tracks.parquet"):
        (folder / name).write_text(name)
    return folder


def test_files_of_a_recording_that_are_none_are_not_opened(tmp_path):
    def breaking(number: int, name: str) -> Path:
        folder = _recording(tmp_path / str(number))
        (folder / name).unlink()
        return folder / name

    os.mkfifo(breaking(0, "tracks.parquet"))  # whoever opens it waits for ever
    breaking(1, "tracks.parquet").mkdir()
    breaking(2, "tracks.parquet").symlink_to(tmp_path / "nowhere")
    breaking(3, "hits.parquet")
    for number, problem in enumerate(
        (
            "is no regular file; ",
            "is a folder; ",
            "no such file; ",
            "holds no recording, for it has no hits.pa",
        )
    ):
        message = message_of(put(".recordings.own", OWN | {"path": str(tmp_path / str(number))}))
        assert str(tmp_path / str(number)) in message
        assert problem in message
    assert plan(put(".recordings.own", OWN | {"path": str(_recording(tmp_path / "good"))})).recipes


def test_lists_of_cases_that_are_no_files_are_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    assert "no such file; name a list" in message_of(put("cases.small", str(tmp_path / "pipe.csv")))


@pytest.fixture
def own_domain(tmp_path, monkeypatch):
    """Writes a module of a domain of one's own."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(name: str, text: str) -> str:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("")
        (tmp_path / name / "rink.py").write_text(text)
        return f"{name}.rink"

    return write


FUNCTIONS = "def build_scene(settings): ...\ndef draw_task(settings, rng): ...\ndemonstrate = draw_task\n"


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("broken", "def build_scene(:\n", r"rink.py:1: not valid Python .*; mend that line"),
        ("latin", "# \xe9\n", r"rink.py:1: not valid Python .*; mend"),
        (
            "half",
            "def build_scene(settings): ...\n",
            r"is no domain, for it has no draw_task and no demonstrate",
        ),
        ("empty", "", r"is no domain, for it has no build_scene and no draw_task and no demonstrate; name"),
    ],
)
def test_a_domain_of_ones_own_is_read_before_anything_runs(own_domain, tmp_path, name, text, problem):
    module = own_domain(name, "")
    (tmp_path / name / "rink.py").write_bytes(text.encode("latin-1"))
    message = message_of(put(".scene", {"domain": module}))
    assert message.startswith("my.yaml: domains.hockey.scene.domain: ")
    assert re.search(problem, message), message


@pytest.mark.parametrize("name", ["leaving", "raising"])
def test_planning_runs_no_code_of_a_domain(own_domain, name):
    text = {"leaving": "import sys\nsys.exit()\n", "raising": "raise ValueError\n"}[name]
    assert plan(put(".scene", {"domain": own_domain(name, text + FUNCTIONS)})).recipes


def test_whose_code_will_run_is_said(own_domain, tmp_path, monkeypatch, capsys):
    module = own_domain("announced", FUNCTIONS)
    file = tmp_path / "my.yaml"
    file.write_text(f"domains: {{hockey: {{scene: {{domain: {module}}}}}}}\n")
    source = tmp_path / "announced" / "rink.py"
    line = f"domains.hockey.scene.domain: {source} is code of its own, which stages will run"
    for path, more in ((file, [line]), (Path("config/tiny.yaml"), [])):
        monkeypatch.setattr("sys.argv", ["slapshot", "config", str(path)])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        assert not caught.value.code
        said = capsys.readouterr().out.splitlines()
        assert said[0].startswith(f"{path}: ")
        assert said[1:] == more


GOOD = "name: my\ndomains:\n  hockey:\n    rollouts: {hits: 70}\n"


@pytest.mark.parametrize(
    ("content", "line", "problem"),
    [
        ("name: a\nname: b\n", 2, "not valid YAML (key 'name' stands there twice); mend that line"),
        (
            "domains:\n  hockey: {seed: 1,\n    seed: 2}\n",
            3,
            "not valid YAML (key 'seed' stands there twice)",
        ),
        ("cases:\n  lab:\n    blade: null\n    blade: null\n", 4, "(key 'blade' stands there twice)"),
        (
            "name: my\ndomains:\n  hockey:\n    rolouts: {}\n",
            4,
            "domains.hockey.rolouts: unknown key 'rolouts'; wr",
        ),
        (GOOD.replace("70", "0"), 4, "domains.hockey.rollouts.hits: 0 is out of range; it must be >= 1"),
        (
            GOOD + "    methods:\n      maml_2:\n        batch: 2\n",
            6,
            "domains.hockey.methods.maml_2: key 'hidden'",
        ),
        (
            GOOD + "    latents:\n      methods:\n      - lstm\n      - gru\n",
            8,
            "latents.methods.1: 'gru' is not",
        ),
        (
            GOOD + "    figures:\n    - F7\n    - F99\n",
            7,
            "domains.hockey.figures.1: 'F99' cannot be made here; use",
        ),
        (GOOD + "cases:\n  small: nowhere.csv\n", 6, "cases.small: nowhere.csv: no such file; name a list"),
        (
            GOOD + "    scene:\n      domain: curling\n",
            6,
            "domains.hockey.scene.domain: no domain 'curling': no mo",
        ),
        (
            GOOD + "    recordings:\n      own: {path: nowhere, samples: 1,\n            repeats: 1}\n",
            6,
            "path: nowhere: no such",
        ),
        (
            "cases: {lab: {blade: 3}}\n",
            1,
            "cases.lab.blade: 3 is not a mapping or null; write a mapping or null",
        ),
        ("domains: null\n", 1, "domains: None is not a mapping; write a mapping"),
    ],
)
def test_the_line_is_that_of_the_value(tmp_path, content, line, problem):
    file = tmp_path / "my.yaml"
    file.write_text(content)
    with pytest.raises(InputError) as caught:
        load_plan(file)
    assert str(caught.value).startswith(f"{file}:{line}: ")
    assert problem in str(caught.value)


def test_of_several_files_the_last_one_that_has_the_value_is_named(tmp_path):
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"

    def refused(*files: Path, **arguments: Any) -> str:
        with pytest.raises(InputError) as caught:
            read_config(files, arguments)
        return str(caught.value)

    first.write_text("domains:\n  hockey:\n    seed: 2\n    rollouts: {hits: 0}\n")
    second.write_text("name: my\ndomains: {hockey: {seed: 3}}\n")
    problem = "domains.hockey.rollouts.hits: 0 is out of range; it must be >= 1 (of each condition)"
    assert refused(first, second) == f"{first}:4: {problem}"
    assert refused(second, first) == f"{first}:4: {problem}"
    second.write_text("name: my\ndomains: {hockey: {seed: 3, rollouts: {hits: 0}}}\n")
    assert refused(first, second) == f"{second}:2: {problem}"
    assert refused(first, domains={"hockey": {"rollouts": {"hits": 0}}}) == f"--config: {problem}"
    # What only the default has stands there, whoever made it wrong.
    first.write_text("domains: {hockey: {training: {steps: 1}}}\n")
    assert refused(first).startswith(f"{first}:1: domains.hockey.training.steps: 1 is out of range")
    first.write_text("domains: {hockey: {evaluation: {samples: 33}}}\n")
    assert refused(first).startswith(f"{first}:1: domains.hockey.evaluation: samples + queries = 65")
    first.write_text("domains: {hockey: {acting: {exploration: {candidates: 15}}}}\n")
    line = next(
        number
        for number, text in enumerate((ROOT / "config/default.yaml").read_text().splitlines(), 1)
        if text.strip().startswith("exploration: {samples: 16")
    )
    place = "domains.hockey.acting.exploration.samples: 16 hits cannot be chosen from 15 candidates"
    assert refused(first).startswith(f"config/default.yaml:{line}: {place}")


def test_files_in_this_folder_are_called_as_a_person_calls_them(tmp_path, monkeypatch):
    (tmp_path / "config").mkdir()
    (tmp_path / "config/default.yaml").write_text("name: a\nname: b\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"^config/default.yaml:2: not valid YAML"):
        read_config([])
    shutil.copy(ROOT / "config/default.yaml", tmp_path / "config")
    (tmp_path / "my.yaml").write_text("nme: a\n")
    with pytest.raises(InputError, match=r"^my.yaml:1: nme: unknown key 'nme'; write 'name', or"):
        read_config([tmp_path / "my.yaml"])


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "my.yaml")
    with pytest.raises(InputError, match=r"my.yaml: is no regular file; give the path of a YAML file"):
        read_config([tmp_path / "my.yaml"])
