from dataclasses import replace
from math import erfc

import numpy as np
import pytest
from slapshot.lab.camera import OUTLIER_SIZE, observe
from slapshot.lab.rig import Camera

PERFECT = Camera(
    rate=30.0,
    noise_sd=0.0,
    noise_time=0.0,
    stamp_jitter=0.0,
    outlier_share=0.0,
    missing_share=0.0,
    mistrack_share=0.0,
    mistrack=(0.05, 0.2),
    after_rest=0.5,
    view=None,
)


def moving(duration=1.0):
    """(n, 4): an object that moves with 1 m/s along x and rests at x = duration."""
    t = np.linspace(0, duration, 1001)
    return np.column_stack([t, t, 0 * t, 0 * t])


def test_a_perfect_camera_sees_what_is():
    sighting = observe(moving(), PERFECT, np.random.default_rng(0))
    t = sighting.frames[:, 0]
    assert 0 <= t[0] < 1 / 30
    assert np.diff(t) == pytest.approx(1 / 30)
    assert 1.5 - 1 / 30 <= t[-1] < 1.5
    assert sighting.frames[:, 1] == pytest.approx(np.minimum(t, 1.0))
    assert sighting.rest == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("time", [0.0, 0.02, 0.1])
def test_noise_has_the_size_and_the_memory_asked_for(time):
    camera = replace(PERFECT, noise_sd=0.003, noise_time=time)
    noise = observe(moving(1000.0), camera, np.random.default_rng(1)).frames
    noise = noise[:, 1:3] - np.column_stack([np.minimum(noise[:, 0], 1000.0), 0 * noise[:, 0]])
    memory = 0.0 if time == 0 else np.exp(-1 / (30 * time))
    count = noise.size
    # A variance from n correlated samples is as good as one from n (1 - a^2) / (1 + a^2) free ones.
    free = count * (1 - memory**2) / (1 + memory**2)
    assert noise.var() == pytest.approx(0.003**2, rel=6 * np.sqrt(2 / free))
    alike = np.mean(noise[1:] * noise[:-1]) / noise.var()
    assert alike == pytest.approx(memory, abs=6 / np.sqrt(free))


def test_yaw_is_recorded_where_that_is_asked_for():
    """From any orientation, which stays the same in a hit; within a turn."""
    track = moving()
    track[:, 3] = 9.0 * track[:, 0]
    assert np.isnan(observe(track, PERFECT, np.random.default_rng(5)).frames[:, 3]).all()
    camera = replace(PERFECT, rate=2000.0, yaw_sd=0.02)
    hits = [observe(track, camera, np.random.default_rng(k)).frames for k in range(6, 26)]
    first = []
    for t, x, y, yaw in (frames.T for frames in hits):
        assert np.abs(yaw).max() <= np.pi
        left = np.unwrap(yaw) - 9.0 * np.minimum(t, 1.0)
        assert left.std() == pytest.approx(0.02, rel=6 / np.sqrt(2 * len(left)))
        np.testing.assert_allclose(x, np.minimum(t, 1.0), atol=1e-9)
        assert (y == 0).all()
        first.append(left.mean())
    assert np.std(first) > 1.0
    unlike = observe(track, replace(camera, yaw_sd=None), np.random.default_rng(6)).frames
    np.testing.assert_array_equal(unlike[:, :3], hits[0][:, :3])


def test_stamps_jitter_and_outliers_have_the_size_asked_for():
    camera = replace(PERFECT, stamp_jitter=0.1)
    frames = observe(moving(1000.0), camera, np.random.default_rng(3)).frames
    late = (frames[:, 0] - frames[:, 1])[frames[:, 0] < 999]  # at 1 m/s
    # Limits at 4 standard deviations take nothing from the variance that 3e4 samples would show.
    assert late.std() == pytest.approx(0.1 / 30, rel=6 / np.sqrt(2 * len(late)))
    assert (np.diff(frames[:, 0]) > 0).all()
    firsts = [observe(moving(), camera, np.random.default_rng(k)).frames[0, 0] for k in range(200)]
    assert min(firsts) >= 0
    share, usual = 0.05, 0.003
    camera = replace(PERFECT, noise_sd=usual, outlier_share=share)
    noise = observe(moving(1000.0), camera, np.random.default_rng(4)).frames[:, 2]
    assert noise.var() == pytest.approx(usual**2 * (1 + share * OUTLIER_SIZE**2), rel=0.06)
    # Of an outlier's noise, which is normal too, and of the usual one (6e-5).
    beyond = share * erfc(4 / np.sqrt(2 * (1 + OUTLIER_SIZE**2))) + (1 - share) * erfc(4 / np.sqrt(2))
    seen = np.mean(np.abs(noise) > 4 * usual)
    assert seen == pytest.approx(beyond, abs=6 * np.sqrt(beyond / len(noise)))


def test_lost_frames_and_mistracks_have_the_shares_asked_for():
    lost, wrong = 0.03, 0.01
    camera = replace(PERFECT, missing_share=lost, mistrack_share=wrong)
    frames = observe(moving(1000.0), camera, np.random.default_rng(2)).frames
    count = int(1000.5 * 30)
    sd = np.sqrt(count * lost * (1 - lost))
    assert count - len(frames) == pytest.approx(count * lost, abs=6 * sd + 1)
    off = np.hypot(frames[:, 1] - np.minimum(frames[:, 0], 1000.0), frames[:, 2])
    mistaken = off > 1e-9
    sd = np.sqrt(len(frames) * wrong * (1 - wrong))
    assert mistaken.sum() == pytest.approx(len(frames) * wrong, abs=6 * sd)
    assert off[mistaken].min() >= 0.05
    assert off[mistaken].max() <= 0.2


def test_mistracks_do_not_move_the_rest_point():
    # Twelve frames: with every tenth mistaken for sure, the median stays among the good ones, which
    # scatter by 3 mm. At most 5 of 12 may be wrong: seeds with more are 1 in 200.
    camera = replace(PERFECT, noise_sd=0.003, mistrack_share=0.1)
    rests = np.array([observe(moving(), camera, np.random.default_rng(s)).rest for s in range(40)])
    error = np.linalg.norm(rests - [1.0, 0.0], axis=1)
    assert np.sort(error)[-3] < 0.006


def test_what_leaves_the_view_is_not_seen():
    camera = replace(PERFECT, view=(-0.5, 0.8, -1.0, 1.0))
    sighting = observe(moving(), camera, np.random.default_rng(3))
    assert sighting.rest is None
    assert sighting.frames[-1, 1] < 0.8
    assert len(sighting.frames) >= 22


def test_same_seed_same_frames():
    camera = replace(PERFECT, noise_sd=0.003, missing_share=0.1, mistrack_share=0.1)
    first, again, other = (observe(moving(), camera, np.random.default_rng(s)).frames for s in (4, 4, 5))
    assert np.array_equal(first, again, equal_nan=True)
    assert not np.array_equal(first[:5], other[:5], equal_nan=True)
