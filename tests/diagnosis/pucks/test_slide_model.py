"""Derivatives of slides by what acts on them."""

from dataclasses import replace

import numpy as np
import pytest
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.selection.free_form import FREE_FORMS
from slapshot.diagnosis.pucks.slide import slide_model
from slapshot.diagnosis.pucks.slide.first_guess import first_guess
from slapshot.diagnosis.pucks.slide.slide_model import COARSE_STEP, LATENTS, SlideModel
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks
from slapshot.effects.catalogue import catalogue

SLIDING = {e.name: e for e in (*catalogue().values(), *FREE_FORMS) if e.acts_on_slide}


@pytest.fixture(scope="module")
def model():
    tracks = hit_tracks(recording(np.random.default_rng(3), hits=12))
    return SlideModel(tracks, SLIDING, RADIUS, CAMERA)


def test_an_object_that_turned_before_its_release_has_its_slug_elsewhere(model):
    """After a quarter turn a slug that was ahead is on the left."""
    point = first_guess(model.tracks)
    point.latents[:, LATENTS.index("spin")] = 5.0
    ahead, left = (
        {"offcentre_mass": {"offset_x": x, "offset_y": y, "log_inertia": 0.0}}
        for x, y in ((0.01, 0.0), (0.0, 0.01))
    )
    turned = model.of(replace(model.tracks, turned=np.full(len(model.tracks), np.pi / 2)))
    expected = model.predict(replace(point, effects=left))
    np.testing.assert_allclose(turned.predict(replace(point, effects=ahead)), expected, atol=1e-9)
    assert np.abs(model.predict(replace(point, effects=ahead)) - expected).max() > 1e-3


@pytest.mark.parametrize("name", sorted(SLIDING))
def test_a_coarser_step_changes_derivatives_by_less_than_a_thousandth(model, name, monkeypatch):
    point, valid = first_guess(model.tracks), model.tracks.valid
    point.latents[:, LATENTS.index("spin")] = 2.0  # without a spin some do nothing
    columns = [c for c in model.columns([name]) if c.object < 0]
    coarse = model.derivatives(point, columns)[2][valid]
    monkeypatch.setattr(slide_model, "COARSE_STEP", COARSE_STEP / 4)
    exact = model.derivatives(point, columns)[2][valid]
    assert np.linalg.norm(coarse - exact) < 1e-3 * np.linalg.norm(exact)
