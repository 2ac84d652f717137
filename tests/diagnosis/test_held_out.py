"""Predictions of held-out windows: from the data before alone, and as good as noise lets them be."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis import held_out
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.fit.filter import Innovations
from slapshot.diagnosis.fit.noise import Noise
from slapshot.diagnosis.held_out import Predictions, _gains_without_a_reading, initial_trajectory, predict
from slapshot.diagnosis.held_out_split import split, thinned
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.pulses import WINDOW_S
from slapshot.diagnosis.selection.steps import P_VALUE
from slapshot.diagnosis.verdict_of_search import MAX_REDUCED_CHI2
from slapshot.errors import InputError
from slapshot.recordings.signals import SignalRecording

from .mechanisms import PENDULUM, control_channel, joint, recording, simulate

WHITE = 2e-3
PUSH = (1.13, 1.32, 6.0)  # begin and end in s, N m
BOTH = np.array([0])


def taken(
    seed: int, episodes: int = 6, seconds: float = 2.0, pushed: int | None = None, white: float = WHITE
) -> SignalRecording:
    """A driven rod, simulated as the model itself does; in one episode, PUSH that nobody recorded."""
    rng, t = np.random.default_rng(seed), np.arange(round(100 * seconds)) * 0.01
    u = [1.5 * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t)[:, None] for _ in range(episodes)]
    laws = [push if episode == pushed else None for episode in range(episodes)]
    angles = [
        simulate(PENDULUM, t, p, [rng.uniform(-1, 1)], [0.0], finer=1, law=law)[0][:, 0]
        for p, law in zip(u, laws, strict=True)
    ]
    noisy = [angle + white * rng.standard_normal(len(t)) for angle in angles]
    channels = {
        "angle": (joint("swing"), noisy),
        "drive": (control_channel(actuator="drive"), [p[:, 0] for p in u]),
    }
    return recording([t] * episodes, channels)


def push(time: float, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    return np.full(1, PUSH[2] * (PUSH[0] - 1e-9 <= time < PUSH[1] - 1e-9))


@cache
def made(seed: int, model: str = PENDULUM) -> tuple[Rig, Problem, Segments, Noise]:
    of = taken(seed)
    rig = bind(MjSpec.from_string(model), of.channels)
    problem = Problem.of(rig, of.channels, segment_recording(of, rig))
    noise = replace(problem.initial_noise, white=np.array([WHITE]), force=1e-6)
    return rig, problem, segment_recording(of, rig, segment_s=1.0), noise


@cache
def predictions_of(seed: int) -> Predictions:
    """By the true model."""
    return predicted(made(seed))


def predicted(of: tuple[Rig, Problem, Segments, Noise], trajectory: np.ndarray | None = None) -> Predictions:
    _, problem, windows, noise = of
    trajectory = initial_trajectory(problem, problem, windows) if trajectory is None else trajectory
    return predict(problem, problem.base(()), np.zeros(0), windows, noise, trajectory)


def test_nothing_that_was_recorded_within_a_window_is_used():
    rig, problem, windows, noise = made(1)
    trajectory = initial_trajectory(problem, problem, windows)
    before = predicted((rig, problem, windows, noise), trajectory)
    y = windows.y.copy()
    y[:, 50:] += np.random.default_rng(2).normal(size=y[:, 50:].shape)
    after = predicted((rig, problem, replace(windows, y=y), noise), trajectory)
    np.testing.assert_array_equal(after.predicted, before.predicted)
    np.testing.assert_array_equal(after.floor, before.floor)
    np.testing.assert_allclose(after.error - before.error, (y - windows.y)[:, 50:], atol=1e-12)
    assert np.all(after.log_likelihood < before.log_likelihood)


def test_what_is_recorded_before_is_used():
    rig, problem, windows, noise = made(1)
    y = windows.y.copy()
    y[:, 40:50] += 0.01
    before = predictions_of(1)
    after = predicted((rig, problem, replace(windows, y=y), noise))
    assert np.abs(after.predicted - before.predicted).max() > 1e-3


def test_predictions_do_not_depend_on_where_first_states_are_looked_for():
    """The trajectory is only where linearising begins: five rounds take it to one and the same place."""
    rig, problem, windows, noise = made(1)
    before = predictions_of(1)
    y = windows.y.copy()
    y[:, 50:] += 0.3
    trajectory = initial_trajectory(problem, problem, replace(windows, y=y))
    np.testing.assert_allclose(
        predicted((rig, problem, windows, noise), trajectory).predicted, before.predicted, atol=1e-3 * WHITE
    )


def test_of_the_truth_the_error_is_the_floor():
    """Errors within a window go together: about 12 windows count, each with two unknowns at least."""
    found = [predictions_of(seed) for seed in (3, 4, 5)]
    ratio = np.sqrt(
        np.mean([f.rms(BOTH) ** 2 for f in found]) / np.mean([f.rms_floor(BOTH) ** 2 for f in found])
    )
    assert abs(ratio - 1) < 3 / np.sqrt(2 * 36)
    assert found[0].error.shape == (12, 50, 1)
    # Standardised, every window's error is that of noise: the mean square is 1.
    z = np.concatenate([(f.error / f.floor)[..., 0] for f in found])
    assert abs(np.mean(z**2) - 1) < 3 * np.std(np.mean(z**2, axis=1)) / np.sqrt(len(z)) + 1e-3
    np.testing.assert_allclose(found[0].squares(BOTH), np.mean(found[0].error[..., 0] ** 2, axis=1))


def test_a_wrong_model_predicts_worse_than_its_floor():
    wrong = PENDULUM.replace('damping="0.05"', 'damping="0.3"')
    found, true = predicted(made(3, wrong)), predictions_of(3)
    assert found.rms(BOTH) > 5 * found.rms_floor(BOTH)
    assert found.log_likelihood.sum() < true.log_likelihood.sum() - 10


@pytest.mark.parametrize("episodes", [5, 6, 11])
def test_whole_episodes_are_held_out(episodes: int):
    of = taken(6, episodes)
    segments = segment_recording(of, bind(MjSpec.from_string(PENDULUM), of.channels))
    used, held = split(segments)
    out = set(segments.episode[held])
    assert out == {e for e in range(episodes) if e % 5 == 2}
    assert not out & set(used.episode)
    assert used.shape[0] + len(held) == segments.shape[0]


def test_of_few_episodes_blocks_are_held_out():
    """Two segments side by side: one window to begin from, and one to predict."""
    of = taken(6, 1, 10.0)
    segments = segment_recording(of, bind(MjSpec.from_string(PENDULUM), of.channels))
    used, held = split(segments)
    assert list(held) == [4, 5, 14, 15]
    assert used.shape[0] == segments.shape[0] - 4


@pytest.mark.parametrize(("episodes", "seconds"), [(1, 40.0), (12, 3.0)])
def test_of_too_much_data_pairs_of_neighbours_all_over_it_are_kept(episodes: int, seconds: float):
    t = np.arange(round(100 * seconds)) * 0.01
    of = recording([t] * episodes, {"a": (joint("swing"), [np.sin(t)] * episodes)})
    segments = segment_recording(of, bind(MjSpec.from_string(PENDULUM), of.channels))
    some = thinned(segments, 20)
    assert len(some.episode) == 20
    runs = some.runs()
    assert {len(run) for run in runs} == {2}
    place = some.episode * seconds + some.first * 0.01
    assert np.all(np.diff(place[np.concatenate(runs)][::2]) < 1.6 * episodes * seconds / 10)
    assert (place.min(), place.max()) == (0.0, episodes * seconds - 0.5)
    assert len(thinned(segments, 10**6).episode) == len(segments.episode)


def test_a_recording_that_is_too_long_for_the_memory_is_fitted_in_part(monkeypatch):
    of = taken(8, episodes=8, seconds=3.0)
    rig = bind(MjSpec.from_string(PENDULUM), of.channels)
    used, _ = split(segment_recording(of, rig))
    least = Problem.of(rig, of.channels, used).memory_per_segment
    monkeypatch.setattr("slapshot.diagnosis.diagnose._MEMORY", 12.5 * least)
    found = diagnose(of, rig).verdict
    assert any(f"of {len(used.episode)} segments 12 were fitted" in note for note in found.findings)
    assert found.headline == "nothing_found"


@pytest.mark.parametrize(("episodes", "seconds", "expected"), [(8, 2.0, 8), (3, 10.0, 10), (1, 2.0, 4)])
def test_blocks_are_episodes_or_tenths(episodes: int, seconds: float, expected: int):
    t = np.arange(round(100 * seconds)) * 0.01
    of = recording([t] * episodes, {"a": (joint("swing"), [np.sin(t)] * episodes)})
    segments = segment_recording(of, bind(MjSpec.from_string(PENDULUM), of.channels))
    block = segments.blocks()
    assert len(np.unique(block)) == expected == block.max() + 1
    order = np.lexsort([segments.first, segments.episode])
    assert set(np.diff(block[order])) <= {0, 1}


def test_too_little_to_hold_any_out_is_refused():
    of = taken(6, 1, 1.5)
    with pytest.raises(InputError, match="record longer") as caught:
        split(segment_recording(of, bind(MjSpec.from_string(PENDULUM), of.channels)))
    assert "\n" not in str(caught.value)


def test_errors_as_large_as_expected_are_no_excess():
    """And those half as large again are; outliers do not decide."""
    rng = np.random.default_rng(4)
    sd = rng.uniform(1, 3, size=(30, 50, 2))
    error = sd * rng.normal(size=sd.shape)
    some = Predictions(error, error, sd, sd, np.zeros(30), np.ones((1, 1, 1)))
    low, high = some.excess(rng)
    assert low < 1 < high
    assert replace(some, error=1.5 * error).excess(rng)[0] > 1.8
    wild = error.copy()
    wild[::3, 0] = 1e6
    wild[:, 1] = np.nan
    assert replace(some, error=wild).excess(rng)[0] < 1.2


def test_two_windows_whose_errors_last_are_seldom_an_excess():
    """Of 2000 pairs of windows with a random offset and slope of each of three channels."""
    rng, t = np.random.default_rng(6), np.linspace(0, 1, 40)[:, None]
    calls = 0
    for _ in range(2000):
        offset, slope = rng.normal(size=(2, 2, 1, 3))
        error = (offset + slope * t) / np.sqrt(1 + t**2)
        one = np.ones_like(error)
        pair = Predictions(error, error, one, one, np.zeros(2), np.ones((1, 1, 1)))
        calls += pair.excess(rng)[0] > MAX_REDUCED_CHI2
        assert replace(pair, error=4 * np.abs(error) + 4).excess(rng)[0] > 1
    assert calls < 0.02 * 2000


def test_a_step_that_cannot_be_is_not_taken(monkeypatch):
    """If the first step of one window diverges, others are unaffected, and its trajectory is kept."""
    of = made(1)
    before, calls = predicted(of), []

    def smooth(*arguments):
        delta, force, coloured = held_out_smooth(*arguments)
        calls.append(1)
        if len(calls) == 1:
            delta[0] *= 1e200
        return delta, force, coloured

    held_out_smooth = held_out.smooth
    monkeypatch.setattr(held_out, "smooth", smooth)
    after = predicted(of)
    np.testing.assert_allclose(after.predicted[1:], before.predicted[1:], atol=1e-3 * WHITE)
    # Velocities of the recorded trajectory are as noisy as its readings are, over two intervals.
    speed = WHITE / np.sqrt(2) / 0.01
    assert np.abs(after.predicted[0] - before.predicted[0]).max() < 4 * (WHITE + 0.5 * speed)


def test_a_push_in_held_out_data_is_told_with_its_time():
    """No fit saw it, and no name can be held against other data."""
    of = taken(7, pushed=2)
    rig = bind(MjSpec.from_string(PENDULUM), of.channels)
    verdict = diagnose(of, rig, seed=1).verdict
    assert verdict.held_out_episodes == [2]
    assert verdict.headline == "found_not_named"
    assert verdict.unknown.flagged
    assert (verdict.location.part, verdict.location.follows) == ("swing", "time")
    assert "held-out data" in verdict.unknown.description
    (found,) = [finding for finding in verdict.findings if "held-out data" in finding]
    force, begin, end = map(
        float, re.findall(r"about (.*) N m push swing from (.*) to (.*) s of episode 2", found)[0]
    )
    # Windows of which it takes less than half do not stand out; its impulse is known better.
    assert (begin, end) == pytest.approx(PUSH[:2], abs=WINDOW_S / 2)
    assert force * (end - begin) == pytest.approx(PUSH[2] * (PUSH[1] - PUSH[0]), rel=0.1)


def test_beside_what_is_named_a_push_in_held_out_data_is_unknown():
    """A named law explains all the rest: the verdict says that something pushes besides."""
    of = taken(7, pushed=2)
    undamped = PENDULUM.replace(' damping="0.05"', "")
    verdict = diagnose(of, bind(MjSpec.from_string(undamped), of.channels), seed=1).verdict
    assert verdict.held_out_episodes == [2]
    assert [effect.name for effect in verdict.effects] == ["viscous_friction"]
    assert verdict.unknown is not None
    assert verdict.unknown.p_value > P_VALUE
    assert verdict.unknown.flagged
    assert "episode 2" in verdict.unknown.description
    assert verdict.reason.endswith("something pushes in held-out data")
    assert verdict.fit is not None
    # Of windows of half a second the push, of less, takes one or two.
    assert verdict.fit.windows_left_out in (1, 2)
    assert verdict.fit.windows >= verdict.fit.windows_left_out


def test_without_a_push_none_is_told_in_held_out_data():
    of = taken(7)
    rig = bind(MjSpec.from_string(PENDULUM), of.channels)
    verdict = diagnose(of, rig, seed=1).verdict
    assert verdict.headline == "nothing_found"
    assert not [finding for finding in verdict.findings if "held-out data" in finding]
    assert verdict.fit is not None
    assert verdict.fit.windows_left_out == 0


def test_a_wrong_reading_in_held_out_data_is_no_push():
    """A reading that is off by 25 standard deviations, once."""
    of = taken(7)
    rig = bind(MjSpec.from_string(PENDULUM), of.channels)
    (table,) = of.signals.values()
    table.loc[table.index[table.episode == 2][120], "angle"] += 25 * WHITE
    verdict = diagnose(of, rig, seed=1).verdict
    assert verdict.held_out_episodes == [2]
    assert verdict.headline == "nothing_found"


@pytest.mark.parametrize(("node", "size"), [(49, 5.0), (149, 7.0), (199, 6.0)])
def test_a_wrong_last_reading_of_a_segment_is_no_push(node: int, size: float):
    """A push of the last moment would move it alone."""
    white = 1e-4
    of = taken(7, white=white)
    rig = bind(MjSpec.from_string(PENDULUM), of.channels)
    (table,) = of.signals.values()
    table.loc[table.index[table.episode == 2][node], "angle"] += size * white
    verdict = diagnose(of, rig, seed=1).verdict
    assert verdict.held_out_episodes == [2]
    assert verdict.headline == "nothing_found"


@pytest.mark.parametrize("model", [PENDULUM, PENDULUM.replace("<option", '<option gravity="0 0 -6"')])
def test_readings_that_no_motion_explains_are_left_out_and_no_others(model: str):
    """One a thousand deviations off, in data before a window, and two smaller ones; also by a wrong model."""
    _, problem, windows, noise = made(4, model)
    hypothesis, theta = problem.base(()), np.zeros(0)

    def kept(y: np.ndarray) -> np.ndarray:
        found = held_out.without_wrong_readings(problem, hypothesis, theta, replace(windows, y=y), noise)
        np.testing.assert_array_equal(found.y[np.isfinite(found.y)], y[np.isfinite(found.y)])
        return np.isfinite(found.y)

    assert kept(windows.y).all()
    y = windows.y.copy()
    wrong = [(2, 20, 1000.0), (2, 70, -40.0), (5, 60, 30.0)]
    for segment, node, size in wrong:
        y[segment, node, 0] += size * WHITE
    assert sorted(map(tuple, np.argwhere(~kept(y)[..., 0]))) == [(s, k) for s, k, _ in wrong]


def test_a_push_is_no_wrong_reading():
    rig, problem, _, noise = made(4)
    windows = segment_recording(taken(4, pushed=2), rig, segment_s=1.0)
    found = held_out.without_wrong_readings(problem, problem.base(()), np.zeros(0), windows, noise)
    np.testing.assert_array_equal(found.y, windows.y)


def test_a_push_is_told_by_more_than_one_reading():
    """Against a recalculation without each reading in turn."""
    rng = np.random.default_rng(3)
    e, Z = rng.normal(size=(2, 5, 2)), rng.normal(size=(2, 5, 2, 3))
    Z[..., 2] = 0
    Z[1, 4, 1, 2] = 7.0  # a column that one reading tells
    e[1, 4, 1] = 5.0
    found = _gains_without_a_reading(Innovations(e, Z, np.zeros(2), 20, np.ones_like(e)))
    z, flat = Z.reshape(20, 3), e.reshape(20)
    others = [np.delete(np.arange(20), i) for i in range(20)]
    with np.errstate(invalid="ignore"):
        slow = [[(z[o, k] @ flat[o]) ** 2 / (2 * z[o, k] @ z[o, k]) for o in others] for k in (0, 1)]
    np.testing.assert_allclose(found[:2], np.min(slow, axis=1), rtol=1e-12)
    assert found[2] == 0
