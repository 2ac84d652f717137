import copy
import hashlib
import json

import numpy as np
import pandas as pd
import pytest
from slapshot.config.lab import StandIns
from slapshot.errors import InputError
from slapshot.lab.rig import draw_rig, truth_dict
from slapshot.recordings.read import read_recording
from slapshot.validation import validated


def truth_of(folder):
    return json.loads((folder / "truth" / "truth.json").read_text())


def test_recording_and_truth(make, lab_settings, lab_scene):
    folder = make("one")
    recording, truth = read_recording(folder / "recording"), truth_of(folder)
    assert recording.kind == "full"
    assert recording.stand_in
    header = (folder / "recording" / "recording.json").read_text()
    words = json.loads(header)
    for key in ("rig", "note", "frame_note"):
        assert "stand-in" in words[key].lower()
    sealed = (folder / "truth" / "truth.json").read_bytes()
    assert recording.sealed_truth_sha256 == hashlib.sha256(sealed).hexdigest()
    assert "seed" not in header

    hits = recording.hits
    assert len(hits) == 2 * lab_settings["hits"]
    assert hits["object_id"].value_counts().to_dict() == {"red": 4, "blue": 4}
    assert hits["hit"].tolist() == hits["order"].tolist() == list(range(8))
    assert hits["object_id"].tolist() != sorted(hits["object_id"], reverse=True)
    repeats = hits.groupby(["command_id", "object_id"]).size()
    assert sorted(repeats) == [1, 1, 1, 1, 2, 2]
    for _, same in hits.groupby("command_id"):
        assert len({tuple(latent) for latent in same["latent"]}) == 1
    assert (hits[["start_x", "start_y"]].to_numpy() == lab_scene.info.start).all()

    rests = np.array([hit["rest"][:2] for hit in truth["hits"]])
    # A median of 12 frames of 3 mm, alike by 0.2: 3 * 1.25 * sqrt(1.5 / 12) = 1.3 mm along each axis.
    error = hits[["rest_x", "rest_y"]].to_numpy() - rests
    assert np.abs(error).max() < 6 * 1.3e-3
    assert np.linalg.norm(rests - lab_scene.info.start, axis=1).min() > 0.1
    for name, info in recording.objects.items():
        true_mass = truth["rig"]["objects"][name]["mass"]
        assert info.mass_kg == pytest.approx(true_mass, abs=6 * info.mass_sd_kg)
        assert info.mass_kg != true_mass
        assert info.size_m == (2 * lab_scene.info.object_radius, lab_scene.info.object_height)
    errors = np.array([hit["start_error_m"] for hit in truth["hits"]])
    first_frames = recording.tracks.groupby("hit").head(10).groupby("hit")[["x", "y"]].median()
    seen = first_frames.to_numpy() - lab_scene.info.start
    assert np.abs(seen - errors).max() < 6 * 1.3e-3 * np.sqrt(12 / 10)


def test_commands_and_joints_are_of_the_same_hit(make):
    recording = read_recording(make("one") / "recording")
    assert recording.commands is not None
    assert recording.joints is not None
    assert recording.commands.groupby("hit")["t"].max().to_numpy() == pytest.approx(0.8)
    assert recording.joints.groupby("hit")["t"].max().min() > 0.8
    both = recording.commands.merge(recording.joints.round({"t": 9}), on=["hit", "t"])
    assert len(both) > 0.9 * len(recording.commands)
    at_start = both[both["t"] == 0.0]
    for joint in range(7):
        # At rest a servo is sent where the arm is; encoders read it to 1 mrad.
        difference = at_start[f"q{joint}_x"] - at_start[f"q{joint}_y"]
        assert difference.abs().max() < 6e-3


def test_same_seed_same_recording_other_seed_another(make):
    folders = [make("first", 1), make("again", 1), make("other", 2)]
    sealed = [(f / "truth" / "truth.json").read_bytes() for f in folders]
    assert sealed[0] == sealed[1]
    assert sealed[0] != sealed[2]
    first, again, other = (read_recording(f / "recording") for f in folders)
    for name in ("hits", "tracks", "commands", "joints"):
        pd.testing.assert_frame_equal(getattr(first, name), getattr(again, name), check_exact=True)
    assert first.objects == again.objects
    assert not first.hits["rest_x"].equals(other.hits["rest_x"])
    assert first.objects != other.objects


def test_rigs_of_one_seed_are_different_rigs(make):
    small = {"hits": 1, "repeats": {"commands": 0, "times": 0}}
    # Rig 1 of seed 0 is not rig 0 of seed 1 either.
    folders = [make(f"{seed}-{rig}", seed, rig=rig, **small) for seed, rig in ((1, 0), (1, 1), (0, 1))]
    rigs = [truth_of(folder)["rig"] for folder in folders]
    for part in ("objects", "blade", "board_height_m"):
        assert rigs[0][part] != rigs[1][part] != rigs[2][part] != rigs[0][part]
    hits = [read_recording(folder / "recording").hits for folder in folders]
    assert not hits[0]["latent"].map(tuple).isin(hits[1]["latent"].map(tuple)).any()


def test_parts_are_drawn_apart(lab_settings):
    # To take the blade away leaves everything else as it was, so that rigs can be compared.
    without = copy.deepcopy(lab_settings)
    without["blade"] = without["friction_field"] = None
    one, other = (
        truth_dict(draw_rig(validated(StandIns, s, "lab"), np.random.default_rng(0)))
        for s in (lab_settings, without)
    )
    assert other["blade"] is None
    assert other["board_log_friction"] == []
    for key in ("objects", "board_height_m", "scatter", "camera"):
        assert one[key] == other[key], key


def test_without_a_model_id_there_are_no_latents(make):
    small = {"hits": 1, "repeats": {"commands": 0, "times": 0}, "blade": None}
    recording = read_recording(make("none", model=None, **small) / "recording")
    assert recording.trajectory_model is None
    assert recording.hits["latent"].isna().all()


def test_settings_that_cannot_be(make, lab_settings):
    short = {**lab_settings["scatter"], "joint_offset_sd_rad": [0.01]}
    with pytest.raises(InputError, match="1 values for 7 joints"):
        make("joints", scatter=short)
