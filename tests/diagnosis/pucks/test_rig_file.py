"""Rig files: what is wrong in one is said in one line, and code that it names is named before it runs."""

import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from slapshot import cli, own_code
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.rig_file import read_rig
from slapshot.diagnosis.pucks.selection.free_form import FREE_FORMS
from slapshot.diagnosis.pucks.selection.trial import that_work
from slapshot.effects import catalogue as catalogue_module
from slapshot.effects.catalogue import OF_DIAGNOSIS, catalogue, import_effects
from slapshot.errors import InputError
from slapshot.recordings.write import write_recording

from .bad_rigs import BAD_MODULES, FAILS_LATER, GOOD, TABLE, bad_rigs, effect, failing_later

ROOT = Path(__file__).parents[3]
BAD = bad_rigs()


@pytest.fixture
def rig_file(tmp_path):
    """Writes a rig file and returns its path."""

    def write(text):
        file = tmp_path / "rig.yaml"
        file.write_text(text)
        return file

    return write


def refusal(file):
    """The line with which a rig file is refused."""
    with pytest.raises(InputError) as caught:
        read_rig(file)
    return str(caught.value)


@pytest.mark.parametrize("name", GOOD)
def test_good_rig_files_are_read(rig_file, name):
    rig = read_rig(rig_file(yaml.safe_dump(GOOD[name])))
    assert rig.setting.friction == tuple(GOOD[name]["friction"])
    np.testing.assert_array_equal(rig.setting.camera, GOOD[name]["camera_m"])
    assert not rig.effects


@pytest.mark.parametrize("bad", BAD, ids=[bad.name for bad in BAD])
def test_a_bad_rig_file_is_refused_in_one_line_that_names_the_key(rig_file, bad):
    file = rig_file(bad.text)
    line = refusal(file)
    assert re.match(rf"{re.escape(str(file))}(:\d+)?: ", line)
    assert bad.key in line
    assert line.isprintable()
    assert len(line) < len(str(file)) + 600


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "mass_kg: 0.4",
            "mass_kg: 1e300",
            "4: scene.mass_kg: '1e300' is not a number; write a number such as 1e+300 (kg)",
        ),
        (
            "mass_kg: 0.4",
            "mass_kg: 1.0e+300",
            "4: scene.mass_kg: 1e+300 is out of range; it must be <= 1000 (kg)",
        ),
        (
            "mass_kg: 0.4",
            "mass_kg: 400",
            "1: scene: mass_kg 400 in size_m [0.26, 0.26, 0.23] is denser than any metal (2.57e+04 kg/m^3); "
            "correct the mass or the size",
        ),
        (
            "timestep_s: 0.001",
            "timestep_s: 0",
            "6: scene.timestep_s: 0 is out of range; it must be >= 1e-05 (integration step in s; divides "
            "1 ms)",
        ),
        (
            "timestep_s: 0.001",
            "timestep_s: 0.0003",
            "6: scene.timestep_s: 0.0003 does not divide 0.001 s; use 0.001, 0.0005, 0.00025 or "
            "another whole part",
        ),
        (
            "table_m: [2.0, 2.0]",
            "table_m: [-2.0, 2.0]",
            "7: scene.table_m.0: -2.0 is out of range; it must be >= 0.01 (m, extent of a surface)",
        ),
        ("  mass_kg: 0.4\n", "", "1: scene: key 'mass_kg' is missing; add it (kg)"),
        (
            "mass_kg: 0.4",
            "mass: 0.4",
            "4: scene.mass: unknown key 'mass'; write 'mass_kg', or use one of: domain, mass_kg, size_m, "
            "start_m, table_m, timestep_s",
        ),
        (
            "0.02]",
            "0.02, 0.02]",
            "8: friction: [0.2, 0.2, 0.02, 0.02] has 4 values; write at most 3 (nominal mu_x, mu_y, and "
            "torsional friction in m)",
        ),
        (
            "0.02]",
            "2.0]",
            "8: friction.2: 2 m is out of range; it must be <= 0.15 m for this object of radius 0.15 m",
        ),
        (
            "domain: table",
            "domain: nowhere",
            "2: scene.domain: no domain 'nowhere'; use a folder of slapshot.domains, or the dotted name of "
            "a module of your own that can be imported",
        ),
    ],
)
def test_the_line_says_where_what_and_how_to_mend_it(rig_file, old, new, line):
    text = (
        "scene:\n"
        "  domain: table\n"
        "  size_m: [0.26, 0.26, 0.23]\n"
        "  mass_kg: 0.4\n"
        "  start_m: [0.5, 0.0]\n"
        "  timestep_s: 0.001\n"
        "  table_m: [2.0, 2.0]\n"
        "friction: [0.2, 0.2, 0.02]\n"
        "camera_m: [0.5, 0.5]\n"
    )
    assert old in text
    file = rig_file(text.replace(old, new))
    assert refusal(file) == f"{file}:{line}"


def test_only_regular_files_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    for name, words in (("pipe.yaml", "no regular file"), ("", "is a folder"), ("none.yaml", "no such file")):
        assert words in refusal(tmp_path / name)


# --- Code that a rig file names


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Writes own_module.py, where it can be imported, and forgets it afterwards."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(catalogue_module, "_registered", dict(catalogue()))
    monkeypatch.setattr(own_code, "_imported", set())

    def write(source):
        file = tmp_path / "own_module.py"
        file.write_text(source)
        return file

    yield write
    sys.modules.pop("own_module", None)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Folder of a recording of 30 hits."""
    folder = tmp_path_factory.mktemp("recorded") / "flat"
    write_recording(recording(np.random.default_rng(2), 30), folder)
    return folder


@pytest.fixture
def diagnose(rig_file, recorded, tmp_path, monkeypatch, capsys):
    """Runs `slapshot diagnose` with a rig; returns exit code, output and lines of errors."""

    def run(rig):
        command = [
            "slapshot",
            "diagnose",
            recorded,
            "--rig",
            rig_file(yaml.safe_dump(rig)),
            "--out",
            tmp_path / "out",
        ]
        monkeypatch.setattr("sys.argv", list(map(str, command)))
        with pytest.raises(SystemExit) as caught:
            cli.main()
        captured = capsys.readouterr()
        assert not (tmp_path / "out").exists() or caught.value.code == 0
        return caught.value.code, captured.out, captured.err.splitlines()

    return run


@pytest.mark.parametrize("what", BAD_MODULES)
def test_a_bad_module_of_effects_is_named_and_then_refused_in_one_line(own, diagnose, what):
    source, words = BAD_MODULES[what]
    file = own(source)
    code, out, lines = diagnose(TABLE | {"effects": ["own_module"]})
    assert (code, out) == (1, "")
    assert lines[0] == f"slapshot: running code from own_module ({file})"
    assert len(lines) == 2, lines
    assert lines[1].startswith(f"slapshot: {file.with_name('rig.yaml')}:5: effects.0: ")
    assert words in lines[1]
    assert lines[1].isprintable()
    assert len(lines[1]) < 800


def test_a_module_that_does_not_exist_is_refused_and_nothing_runs(own, diagnose, tmp_path):
    own("raise ValueError\n")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "__init__.py").write_text("raise ValueError('ran')\n")
    for module in ("no_such_module", "own_module.inner", "folder.inner", "__main__", "slapshot.effects.tlit"):
        code, _, lines = diagnose(TABLE | {"effects": [module]})
        assert code == 1
        assert len(lines) == 1
        assert f"effects.0: no module {module}; use the dotted name of one that can be imported" in lines[0]


@pytest.mark.parametrize("statement", FAILS_LATER)
def test_an_effect_that_fails_in_the_middle_ends_the_command_in_one_line(own, diagnose, statement):
    file = own(failing_later(statement))
    code, _, lines = diagnose(TABLE | {"effects": ["own_module"]})
    assert code == 1
    assert f"own_module ({file}:" in lines[-1]
    assert lines[-1].endswith(FAILS_LATER[statement])
    assert not [line for line in lines if "Traceback" in line]


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("raise SystemExit(0)", "it calls sys.exit"),
        ("raise ValueError('gale')", "gale"),
        ("raise OSError", "OSError"),
    ],
)
def test_an_effect_that_never_works_is_dropped_with_a_note(own, statement, reason):
    own(effect("        return 0 *", f"        {statement}\n        return 0 *"))
    import_effects("own_module")
    known = {name: catalogue()[name] for name in ("tilt", "own_wind")}
    kept, notes = that_work(known, np.zeros(2), (0.2, 0.2, 0.02), 0.15)
    assert list(kept) == ["tilt"]
    assert notes == (f"the hypothesis own_wind was dropped: its simulation failed ({reason})",)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("raise ValueError('no')\n", "scene.domain: own.module ({file}:1): ValueError: no; mend it"),
        ("raise SystemExit(0)\n", "scene.domain: own.module ({file}:1): it calls sys.exit; mend it"),
        ("x = (\n", "scene.domain: {file}:1: SyntaxError: '(' was never closed"),
        ("x = 1\n", "scene.domain: module own.module has no function build_scene"),
        (
            "def build_scene(settings):\n    raise SystemExit(0)\n",
            "scene: cannot be built (it calls sys.exit)",
        ),
        ("def build_scene(settings):\n    return 3\n", "scene: cannot be built ('int' object has no"),
        ("def build_scene():\n    return 3\n", "scene: cannot be built (build_scene() takes 0"),
        (
            "import dataclasses\nfrom slapshot.domains.table.model import build_scene as table\n\n\n"
            "def build_scene(settings):\n    return dataclasses.replace(table(settings), xml='<mujoco>')\n",
            "scene: cannot be built (XML parse error",
        ),
        (
            "from slapshot.domains.table.settings import TableScene as SceneSettings\nbuild_scene = print\n",
            "scene: key 'table_m' is missing",
        ),
    ],
)
def test_a_bad_domain_of_ones_own_is_refused_in_one_line(
    tmp_path, monkeypatch, capsys, rig_file, source, words
):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(own_code, "_imported", set())
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "__init__.py").touch()
    file = tmp_path / "own" / "module.py"
    file.write_text(source)
    scene = {k: v for k, v in TABLE["scene"].items() if k != "table_m" or "SceneSettings" not in source}
    try:
        line = refusal(rig_file(yaml.safe_dump(TABLE | {"scene": scene | {"domain": "own.module"}})))
    finally:
        for name in ("own", "own.module"):
            sys.modules.pop(name, None)
    assert words.format(file=file) in line
    assert line.isprintable()
    assert capsys.readouterr().err == f"slapshot: running code from own.module ({file})\n"


def test_names_of_the_diagnosis_begin_alike():
    assert all(form.name.startswith(OF_DIAGNOSIS) for form in FREE_FORMS)
