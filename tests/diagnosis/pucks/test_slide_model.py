"""Derivatives of slides by what acts on them."""

from dataclasses import replace

import numpy as np
import pytest
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.selection.free_form import FREE_FORMS
from slapshot.diagnosis.pucks.slide.first_guess import first_guess
from slapshot.diagnosis.pucks.slide.slide_model import LATENTS, NUISANCE, SlideModel
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks
from slapshot.effects.catalogue import catalogue

EVERY = {e.name: e for e in (*catalogue().values(), *FREE_FORMS)}
SLIDING = {e.name: e for e in (*catalogue().values(), *FREE_FORMS) if e.acts_on_slide}


@pytest.fixture(scope="module")
def model():
    tracks = hit_tracks(recording(np.random.default_rng(3), hits=12))
    return SlideModel(tracks, EVERY, RADIUS, CAMERA)


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


def by_differences(model, point, columns):
    """The same derivatives by slides that are simulated anew."""
    found = []
    for column in columns:
        here = point.effects.get(column.owner, SLIDING[column.owner].neutral())
        ends = []
        for sign in (1, -1):
            changed = {**here, column.parameter: here[column.parameter] + sign * column.step / 8}
            ends.append(model.predict(replace(point, effects={**point.effects, column.owner: changed})))
        found.append((ends[0] - ends[1]) / (column.step / 4))
    return np.stack(found, axis=-1)


@pytest.mark.parametrize(
    "beside",
    [
        {},
        {"offcentre_mass": {"offset_x": 0.004, "offset_y": -0.002, "log_inertia": 0.1}},
        {"uneven_board": 0.003, "camera_scale": {"log_scale": 0.05, "shift_x": 0.01, "shift_y": 0.0}},
    ],
    ids=["alone", "slug", "board and camera"],
)
@pytest.mark.parametrize("name", sorted(SLIDING))
def test_derivatives_are_those_of_simulated_differences(model, name, beside):
    point, valid = first_guess(model.tracks), model.tracks.valid
    point.latents[:, LATENTS.index("spin")] = 2.0  # without a spin some do nothing
    rng = np.random.default_rng(5)
    effects = {
        other: of if isinstance(of, dict) else {p: of * rng.normal() for p in EVERY[other].neutral()}
        for other, of in beside.items()
    }
    point = replace(point, effects=effects)
    columns = [c for c in model.columns([name]) if c.object < 0]
    some = columns[::7]
    found, exact = model.derivatives(point, some)[2][valid], by_differences(model, point, some)[valid]
    assert np.linalg.norm(found - exact) < 1e-3 * np.linalg.norm(exact)


@pytest.mark.parametrize("name", ["uneven_board", "place_friction", "curl"])
def test_derivatives_hold_where_spin_dies_fast(model, name):
    """By a torsional friction as large as the object; at 0.3 m, where spin dies within a step, none grows."""
    point, valid = first_guess(model.tracks), model.tracks.valid
    point.latents[:, LATENTS.index("spin")] = 2.0
    some = [c for c in model.columns([name]) if c.object < 0][::7]
    torsional = NUISANCE.index("log_mu_torsional")
    point.nuisance[:, torsional] = np.log(1.3 * RADIUS)
    found, exact = model.derivatives(point, some)[2][valid], by_differences(model, point, some)[valid]
    assert np.linalg.norm(found - exact) < 0.03 * np.linalg.norm(exact)
    largest = np.abs(found).max()
    point.nuisance[:, torsional] = np.log(0.3)
    assert np.abs(model.derivatives(point, some)[2][valid]).max() < 100 * largest
