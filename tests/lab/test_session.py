"""Sessions of scripted hits, recordings that keep less, and cores."""

import json

import numpy as np
import pandas as pd
import pytest
from slapshot.command import Run
from slapshot.config.lab import StandIns
from slapshot.config.trajectories import ScriptedHits
from slapshot.errors import InputError
from slapshot.lab.__main__ import produce, record
from slapshot.lab.commands import Diverse
from slapshot.recordings.read import read_recording
from slapshot.scenes.domain import load_domain
from slapshot.trajectories.safety import SafetyCheck
from slapshot.validation import validated

SCENE = {
    "domain": "hockey",
    "puck": "inline",
    "timestep_s": 0.0005,
    "start_m": [0.55, 0.0],
    "board_m": [2.4, 1.2],
}
DIVERSE = {
    "heading_rad": 1.57,
    "speed_m_s": [0.8, 2.4],
    "contact_offset_m": 0.06,
    "duration_s": 0.6,
    "waypoints": 17,
}
SMALL = {"hits": 2, "repeats": {"commands": 0, "times": 0}, "blade": None, "friction_field": None}


def truth_of(folder):
    return json.loads((folder / "truth" / "truth.json").read_text())


def test_diverse_hits_go_all_ways_and_hold_no_latents(lab_scene, lab_settings, tmp_path):
    settings = {**lab_settings, **SMALL, "hits": 5, "commands": {"diverse": DIVERSE}}
    config = {"seed": 1, "rig": 0, "scene": SCENE, "lab": settings}
    lab_scene.save(tmp_path)
    out = tmp_path / "out"
    out.mkdir()
    produce(Run(config, {"scene": tmp_path}, out, 2))
    recording, truth = read_recording(out / "recording"), truth_of(out)
    assert recording.kind == "full"
    assert recording.trajectory_model is None
    assert recording.hits["latent"].isna().all()
    tasks = truth["tasks"]
    assert len(tasks) == 10
    command = recording.hits["command_id"].to_numpy()
    launches = np.array([hit["launch"] for hit in truth["hits"]])
    headings = np.arctan2(launches[:, 4], launches[:, 3])
    asked = np.array([tasks[c]["heading"] for c in command])
    # Joints are off by 12 mrad each, and the object lies 10 mm off.
    assert np.abs(headings - asked).max() < 0.15
    assert asked.max() - asked.min() > 2.0
    ratio = np.hypot(*launches[:, 3:5].T) / [tasks[c]["speed"] for c in command]
    assert 0.9 < ratio.min() < ratio.max() < 1.5


def test_all_directions_and_strengths_can_be_executed(lab_scene):
    # Measured: every one of 400 tasks, with blade speeds up to 2.4 m/s, so launches up to 3.2 m/s.
    diverse = ScriptedHits(**DIVERSE)
    source = Diverse(lab_scene, load_domain("hockey"), diverse)
    rng = np.random.default_rng(0)
    tasks = [source.domain.draw_task(diverse, rng) for _ in range(40)]
    commands = source.draw(40, SafetyCheck(lab_scene), np.random.default_rng(0))
    assert [command.task for command in commands] == tasks


def test_what_the_arm_is_not_up_to_is_refused(lab_scene, lab_settings, tmp_path):
    fast = ScriptedHits(**DIVERSE | {"speed_m_s": [6.0, 8.0]})
    source = Diverse(lab_scene, load_domain("hockey"), fast)
    with pytest.raises(InputError, match=r"lab\.commands\.diverse: only 0 of"):
        record(lab_scene, source, validated(StandIns, {**lab_settings, **SMALL}, "lab"), 1, tmp_path)


def test_recordings_keep_what_is_asked_for(make):
    full = read_recording(make("full", **SMALL) / "recording")
    tracks = read_recording(make("tracks", **SMALL, keep="tracks only") / "recording")
    rests = read_recording(make("rests", **SMALL, keep="rest points only") / "recording")
    assert (full.kind, tracks.kind, rests.kind) == ("full", "tracks only", "rest points only")
    # The same hits, less said of them.
    pd.testing.assert_frame_equal(tracks.tracks, full.tracks, check_exact=True)
    assert tracks.commands is None
    assert tracks.joints is None
    assert tracks.trajectory_model is None
    assert tracks.hits["latent"].isna().all()
    pd.testing.assert_frame_equal(rests.hits, full.hits, check_exact=True)
    assert rests.commands is None
    assert rests.joints is None
    assert rests.trajectory_model == full.trajectory_model
    assert rests.hits["rest_x"].notna().all()


def test_rest_points_without_latents_keep_their_commands(make):
    rests = read_recording(make("rests", model=None, **SMALL, keep="rest points only") / "recording")
    assert rests.kind == "rest points only"
    assert rests.commands is not None
    assert rests.joints is None


def test_content_does_not_depend_on_cores(make):
    entries = [{"kind": "camera_scale", "displacement": 0.3}, {"kind": "restitution", "amplitude": 0.2}]
    one, two = (make(f"{cores}", cores=cores, **SMALL, concealed=entries) for cores in (1, 2))
    for file in ("recording/hits.parquet", "recording/tracks.parquet", "truth/truth.json"):
        assert (one / file).read_bytes() == (two / file).read_bytes()
