"""Yaw of tracks: unwrapped, and the spin at the release that it tells."""

from dataclasses import replace

import numpy as np
import pytest
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter, Scatter
from slapshot.diagnosis.pucks.slide.noise import CameraNoise
from slapshot.diagnosis.pucks.slide.slide_model import SlideModel
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks
from slapshot.diagnosis.pucks.slide.yaw import spins_seen, turn_of, unwrapped
from slapshot.effects.catalogue import catalogue

YAW_SD = 0.02


def test_whole_turns_and_markers_that_flip_are_taken_out():
    t = np.arange(60) * 0.02
    true = 1.0 + 14.0 * t - 5.0 * t**2
    seen = (true + np.pi) % (2 * np.pi) - np.pi
    seen[[7, 8]] = np.nan
    seen[30] += 1.5
    found = unwrapped(seen)
    turns = (found - true) / (2 * np.pi)
    assert np.isnan(found[[7, 8, 30]]).all()
    good = np.isfinite(found)
    assert good.sum() == 57
    np.testing.assert_allclose(turns[good], round(turns[0]), atol=1e-9)
    assert np.isnan(unwrapped(np.full(9, np.nan))).all()


def test_the_first_frames_tell_orientation_and_spin():
    t = np.arange(60) * 0.02
    slides = np.clip(t - 0.2, 0, 0.8)
    yaw = -2.0 + 0.1 * (t >= 0.2) + 5.0 * slides - 3.0 * slides**2
    turn = turn_of(t, yaw, 10, 10, 50)
    assert turn.turned == pytest.approx(0.1, abs=1e-9)
    assert turn.spin == pytest.approx(5.0, abs=1e-9)
    # 14 frames of a parabola, 20 ms apart: its slope at the first of them has 3.37 / 14^1.5 / 20 ms, nearly
    # (for many frames the factor is sqrt(192), that of Legendre polynomials up to the second).
    assert turn.spin_error == pytest.approx(np.sqrt(192) / 14**1.5 / 0.02, rel=0.15)


def test_spins_have_the_errors_that_are_stated():
    """Of 3000 hits with noise, from the frames at rest; the law's share is left out, spins being small."""
    rng = np.random.default_rng(1)
    t = np.arange(60) * 0.02
    slides = np.clip(t - 0.2, 0, 0.8)
    turns, true = [], rng.normal(0, 0.05, 3000)
    for spin in true:
        yaw = 0.4 + spin * slides - spin / 1.6 * slides**2 + YAW_SD * rng.normal(size=60)
        turns.append(turn_of(t, yaw, 10, 10, 50))
    spin, sd = spins_seen(turns)
    # 3000 squares: 2.6 % each way for a variance, twice.
    assert np.mean(((spin - true) / sd) ** 2) == pytest.approx(1.0, abs=0.1)


def test_where_nobody_saw_it_nothing_is_known():
    tracks = hit_tracks(recording(np.random.default_rng(2), 10))
    assert np.isinf(tracks.spin_sd).all()
    assert not tracks.turn_seen.any()
    assert (tracks.spin == 0).all()


@pytest.fixture(scope="module")
def seen():
    return recording(np.random.default_rng(2), 40, yaw_sd=YAW_SD, spin_sd=3.0)


def fitter_of(made):
    return HitFitter(SlideModel(hit_tracks(made), catalogue(), RADIUS, CAMERA), CameraNoise(0.003, 0.0))


def test_yaw_tells_the_spin_that_places_do_not(seen):
    fitter = fitter_of(seen)
    blind = fitter_of(replace(seen, tracks=seen.tracks.assign(yaw=np.nan)))
    np.testing.assert_array_equal(fitter.freedom(), blind.freedom() + 1)
    fits = [one.fit(one.start(), Scatter(0.03, np.zeros((0, 0)))) for one in (fitter, blind)]
    told, blindly = (np.sqrt(fit.marginal.covariance[:, 4, 4]) for fit in fits)
    assert np.median(told) < 0.5 * np.median(blindly)
    tracks = fitter.model.tracks
    assert np.mean(np.abs(fits[0].point.latents[:, 4] - tracks.spin) < 3 * tracks.spin_sd) > 0.9
    np.testing.assert_array_equal(tracks.take(np.arange(5)).spin, tracks.spin[:5])
