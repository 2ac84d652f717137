"""`slapshot diagnose`: files in, a folder out, one line for every mistake."""

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from slapshot import cli
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks import command
from slapshot.diagnosis.pucks.report import location_map
from slapshot.diagnosis.pucks.rig_file import camera_foot, read_rig, rig_of_domain
from slapshot.recordings.write import write_recording

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Folder -> recording: one that is tilted, one that is too short."""
    folder = tmp_path_factory.mktemp("recordings")
    tilt = {"tilt": {"slope_x": 0.0, "slope_y": 0.03}}
    write_recording(recording(np.random.default_rng(2), 30, tilt), folder / "tilted")
    write_recording(recording(np.random.default_rng(2), 6), folder / "short")
    return folder


@pytest.fixture
def slapshot(monkeypatch, capsys):
    """Runs the command in the repository; returns exit code, output and errors."""

    def run(*arguments):
        monkeypatch.chdir(ROOT)
        monkeypatch.setattr("sys.argv", ["slapshot", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        captured = capsys.readouterr()
        return caught.value.code or 0, captured.out, captured.err

    return run


def test_it_writes_a_verdict_and_a_scene_that_has_what_was_found(slapshot, recorded, tmp_path):
    code, out, _ = slapshot("diagnose", recorded / "tilted", "--out", tmp_path / "verdict")
    assert code == 0
    assert "tilt" in out
    verdict = json.loads((tmp_path / "verdict/verdict.json").read_text())
    assert [e["name"] for e in verdict["effects"]] == ["tilt"]
    assert {"scene", "code", "recording", "slapshot"} == set(verdict["versions"])
    effects = json.loads((tmp_path / "verdict/augmented/effects.json").read_text())
    assert effects["tilt"]["slope_y"] == pytest.approx(0.03, abs=0.01)
    mujoco.MjModel.from_xml_path(str(tmp_path / "verdict/augmented/scene.xml"))
    assert {p.name for p in tmp_path.iterdir()} == {"verdict"}


def test_a_recording_that_cannot_tell_is_no_error(slapshot, recorded, tmp_path):
    code, out, _ = slapshot("diagnose", recorded / "short", "--out", tmp_path / "verdict")
    assert code == 0
    assert "record at least 12" in out
    assert not (tmp_path / "verdict/augmented").exists()


def test_a_figure_that_fails_costs_nothing_else(slapshot, recorded, tmp_path, monkeypatch):
    def fail(outcome):
        raise KeyError("binned_force")

    monkeypatch.setattr(location_map, "draw", fail)
    out = tmp_path / "verdict"
    code, said, errors = slapshot("diagnose", recorded / "tilted", "--out", out)
    assert code == 1
    assert "tilt" in said
    assert errors.count("D1-location could not be drawn (KeyError: 'binned_force')") == 1
    verdict = json.loads((out / "verdict.json").read_text())
    assert verdict["headline"] == "found"
    assert any("D1-location could not be drawn" in note for note in verdict["notes"])
    page = (out / "verdict.md").read_text()
    assert "D1-location could not be drawn" in page
    assert "D1-location.png" not in page
    kept = {path.name for path in out.iterdir()}
    assert {"D2-ranking.png", "D3-tracks.png", "D4-errors.png", "diagnosis.rrd", "augmented"} <= kept
    assert not [name for name in kept if name.startswith(("D1", "."))]


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_an_end_while_figures_are_drawn_keeps_the_verdict_and_hides_nothing(recorded, tmp_path, how):
    out = tmp_path / "verdict"
    code = f"""
import os, signal, sys
from slapshot import cli
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background
from slapshot.diagnosis.pucks import command
from slapshot.diagnosis.pucks.report import location_map
from slapshot.diagnosis.pucks.report import ranking

def stop(outcome):
    os.kill(os.getpid(), {int(how)})

ranking.draw = stop
sys.argv = ["slapshot", "diagnose", {str(recorded / "tilted")!r}, "--out", {str(out)!r}]
cli.main()
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 128 + how, done.stderr
    assert "Traceback" not in done.stderr
    assert json.loads((out / "verdict.json").read_text())["headline"] == "found"
    assert {"verdict.md", "D1-location.png", "augmented"} <= {path.name for path in out.iterdir()}
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("3", "format_version is 3, but this slapshot reads version 1, 2; write the recording in that one"),
        ("true", "format_version is True, but this slapshot reads version"),
        ("1,", "is not valid JSON"),
    ],
)
def test_a_recording_of_another_version_is_refused_in_one_line(
    slapshot, recorded, tmp_path, monkeypatch, version, words
):
    monkeypatch.setattr(command, "diagnose", None)
    shutil.copytree(recorded / "short", tmp_path / "later")
    header = tmp_path / "later/recording.json"
    text = header.read_text()
    assert text.count('"format_version": 1') == 1
    header.write_text(text.replace('"format_version": 1', f'"format_version": {version}'))
    code, _, errors = slapshot("diagnose", tmp_path / "later", "--out", tmp_path / "verdict")
    assert code == 1
    assert errors.count("\n") == 1
    assert f"{header}: {words}" in errors
    assert not (tmp_path / "verdict").exists()


@pytest.mark.parametrize("option", ["--out", "--signatures"])
def test_places_to_write_to_are_checked_before_anything_is_computed(
    slapshot, recorded, tmp_path, monkeypatch, option
):
    def compute(*args, **kwargs):
        raise AssertionError("computed")

    monkeypatch.setattr(command, "diagnose", compute)
    (tmp_path / "file").write_text("no folder")
    asked = {"--out": tmp_path / "verdict"} | {option: tmp_path / "file" / "below"}
    code, _, errors = slapshot("diagnose", recorded / "tilted", *(x for pair in asked.items() for x in pair))
    assert code == 1
    assert errors.count("\n") == 1
    assert "is no folder" in errors
    assert {path.name for path in tmp_path.iterdir()} == {"file"}


def test_a_file_that_holds_no_signatures_is_refused_before_anything_is_computed(
    slapshot, recorded, tmp_path, monkeypatch
):
    monkeypatch.setattr(command, "diagnose", None)
    file = tmp_path / "signatures"
    for content in (b"", b"garbage", b"\x08\x00\x00\x00\x00\x00\x00\x00{}      "):
        file.write_bytes(content)
        code, _, errors = slapshot(
            "diagnose", recorded / "tilted", "--signatures", file, "--out", tmp_path / "out"
        )
        assert code == 1
        assert "holds no signatures" in errors


def test_a_folder_that_exists_is_left_alone(slapshot, recorded, tmp_path):
    code, _, errors = slapshot("diagnose", recorded / "short", "--out", tmp_path)
    assert code == 1
    assert errors.count("\n") == 1
    assert "exists already" in errors


def test_the_rig_of_a_domain_has_its_scene_its_friction_and_its_camera(hockey_config):
    rig = rig_of_domain(hockey_config)
    assert rig.setting.scene is rig.scene
    np.testing.assert_allclose(rig.setting.friction, (0.55, 0.55, 0.0255))
    model = rig.scene.compile()
    np.testing.assert_allclose(camera_foot(rig.scene), model.camera("ceiling").pos[:2])


def test_the_shipped_rig_of_a_box_on_a_table_has_no_arm():
    rig = read_rig(ROOT / "config/rigs/lasa-table.yaml")
    assert rig.setting.scene is None
    assert rig.setting.radius == pytest.approx(0.26 / np.sqrt(3))
