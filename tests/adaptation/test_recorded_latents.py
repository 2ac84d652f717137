import numpy as np
import pandas as pd
import pytest
from slapshot.adaptation.evaluate_recording import hit_latents
from slapshot.errors import InputError
from slapshot.recordings.format import Recording


@pytest.fixture
def make(rig):
    def make(latents, model="abc", commands=True, shift=0.0) -> Recording:
        times = np.arange(0, rig.model.sizes.duration, 0.01)
        tables = []
        for hit, latent in enumerate(latents):
            q = rig.model.motion(latent).position(times) + shift
            tables.append(pd.DataFrame({f"q{i}": q[:, i] for i in range(7)}).assign(hit=hit, t=times))
        hits = pd.DataFrame({"hit": range(len(latents)), "latent": list(latents)})
        return Recording(
            rig="test", objects={}, camera_rate_hz=30.0, frame_note="", stand_in=True, trajectory_model=model,
            note="", sealed_truth_sha256=None, hits=hits, tracks=None,
            commands=pd.concat(tables) if commands else None, joints=None,
        )  # fmt: skip

    return make


def test_latents_of_this_model_are_taken_as_they_are(make, rig, tmp_path):
    latents = rig.swings.latents[:3]
    assert hit_latents(make(latents, commands=False), rig.model, "abc", tmp_path) == pytest.approx(latents)


def test_commands_are_encoded_when_latents_are_another_model_s(make, rig, tmp_path):
    latents = rig.swings.latents[:5]
    encoded = hit_latents(make(latents, model="other"), rig.model, "abc", tmp_path)
    expected = rig.model.latents(rig.model.waypoints(latents))
    # Commands every 10 ms are interpolated linearly between waypoints 50 ms apart.
    assert encoded == pytest.approx(expected, abs=0.05)


def test_neither_latents_nor_commands_is_a_clear_error(make, rig, tmp_path):
    with pytest.raises(InputError, match=r"no commands\.parquet to encode"):
        hit_latents(make(rig.swings.latents[:2], "other", commands=False), rig.model, "abc", tmp_path)


def test_commands_that_the_model_cannot_make_are_refused(make, rig, tmp_path):
    with pytest.raises(InputError, match="rad from anything that trajectory model abc can do"):
        hit_latents(make(rig.swings.latents[:2], "other", shift=0.8), rig.model, "abc", tmp_path)
