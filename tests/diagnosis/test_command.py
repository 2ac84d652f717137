"""`slapshot diagnose`: files in, a folder out, one line for every mistake."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from slapshot import cli
from slapshot.diagnosis.rig_file import camera_foot, read_rig, rig_of_domain
from slapshot.recordings.write import write_recording

from .synthetic import recording

ROOT = Path(__file__).parents[2]


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
