"""Signals on a grid: means of controls, shifts of samples, how episodes are cut."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mujoco import MjSpec
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.segments import (
    LONGEST_AVERAGE_S,
    ControlSignal,
    Segments,
    in_steps_of,
    node_interval,
    segment_recording,
)
from slapshot.errors import InputError
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

from .mechanisms import CART, PENDULUM, control_channel, joint, recording, with_stamps

times = st.lists(st.floats(0, 10, width=32), min_size=1, max_size=8, unique=True).map(sorted)


def rig_of(made: SignalRecording, model: str = PENDULUM) -> Rig:
    return bind(MjSpec.from_string(model), made.channels)


def swinging(t, values=None, control=None) -> SignalRecording:
    """The pendulum's angle at times t, one array or one an episode."""
    parts = t if isinstance(t, list) else [t]
    values = [np.sin(part) for part in parts] if values is None else values
    channels = {"angle": (joint("swing"), values)}
    if control is not None:
        channels["drive"] = (control_channel(actuator="drive"), control)
    return recording(parts, channels)


def fine_mean(signal: ControlSignal, begin: float, end: float) -> float:
    """Mean by the midpoint rule between all samples and the edges, where the signal is at most linear."""
    knots = np.unique(np.clip(np.concatenate([[begin], signal.t, [end]]), begin, end))
    middle, width = (knots[1:] + knots[:-1]) / 2, np.diff(knots)
    if signal.linear:
        values = np.interp(middle, signal.t, signal.value)
    else:
        values = signal.value[np.maximum(np.searchsorted(signal.t, middle, side="right") - 1, 0)]
    return float(values @ width / (end - begin))


@given(times, st.integers(0, 99), st.booleans(), st.floats(-1, 11), st.floats(1e-3, 3))
def test_means_of_controls_are_exact(t, seed, linear, begin, width):
    value = np.random.default_rng(seed).normal(size=len(t))
    signal = ControlSignal(np.array(t), value, linear)
    edges = begin + np.arange(6) * width
    expected = [fine_mean(signal, a, b) for a, b in pairwise(edges)]
    # Differences of an integral over up to 30 s, of values of about 1.
    np.testing.assert_allclose(signal.means(edges), expected, atol=1e-13 * 30 / width)


def test_before_and_after_its_samples_a_control_holds():
    for linear in (False, True):
        signal = ControlSignal(np.array([1.0, 2.0]), np.array([3.0, 5.0]), linear)
        before, within, after = signal.means(np.array([0.0, 1.0, 2.0, 3.0]))
        assert (before, within, after) == pytest.approx((3, 4 if linear else 3, 5))


def test_an_even_recording_is_its_own_grid():
    t = np.arange(101) * 0.01
    made = swinging(t, control=np.arange(101.0))
    rig = rig_of(made)
    segments = segment_recording(made, rig, segment_s=0.25)
    assert segments.interval == pytest.approx(0.01)
    assert segments.substeps == 1
    # 101 nodes in segments of 25; the last one of a single node is too short to tell a state.
    assert segments.shape == (4, 25)
    np.testing.assert_allclose(segments.y[..., 0].ravel(), np.sin(t[:100]), atol=1e-12)
    np.testing.assert_allclose(segments.shift, 0, atol=1e-12)
    np.testing.assert_allclose(segments.time.ravel(), t[:100], atol=1e-12)
    np.testing.assert_allclose(segments.control()[..., 0, 0].ravel(), np.arange(100.0), atol=1e-9)
    assert segments.inside.all()


def test_short_ends_are_filled_up():
    t = np.arange(60) * 0.01
    segments = segment_recording(made := swinging(t), rig_of(made), segment_s=0.25)
    assert segments.shape == (3, 25)
    assert segments.inside.sum(axis=1).tolist() == [25, 25, 10]
    assert np.isnan(segments.y[2, 10:]).all()
    assert np.isfinite(segments.y[segments.inside]).all()


@pytest.mark.parametrize(("timestep", "finer", "substeps"), [(0.002, 1, 5), (0.003, 1, 4), (0.01, 3, 3)])
def test_steps_are_at_most_as_long_as_the_models(timestep, finer, substeps):
    made = swinging(np.arange(50) * 0.01)
    rig = rig_of(made, PENDULUM.replace('timestep="0.01"', f'timestep="{timestep}"'))
    segments = segment_recording(made, rig, finer=finer)
    assert segments.substeps == substeps
    assert segments.step == pytest.approx(0.01 / substeps)


def shifted_back(segments: Segments, rate, bend) -> np.ndarray:
    """Samples at their nodes' own times, by the expansion that the linear system uses."""
    t = segments.time
    return np.sin(t) + segments.shift[..., 0] * rate(t) + segments.shift_square[..., 0] / 2 * bend(t)


@pytest.mark.parametrize("substeps", [1, 2, 3])
def test_in_longer_steps_controls_are_what_they_are_in_a_model_with_such_steps(substeps):
    t = np.arange(200) * 0.01
    rng = np.random.default_rng(substeps)
    made = swinging([t, t[:50]], control=[rng.normal(size=200), rng.normal(size=50)])
    fine = segment_recording(made, rig_of(made, PENDULUM.replace("0.01", "0.002")))
    assert fine.substeps == 5
    some = fine.select(np.array([0, 2]))
    longer = replace(rig_of(made), longest_step=0.01 / substeps)
    other = in_steps_of(longer, made, some)
    assert other.substeps == substeps
    expected = segment_recording(made, rig_of(made, PENDULUM.replace("0.01", str(0.01 / substeps))))
    assert np.array_equal(other.control(), expected.select(np.array([0, 2])).control())
    assert np.array_equal(other.y, some.y, equal_nan=True)


def test_jittered_samples_say_how_late_they_are():
    rng = np.random.default_rng(3)
    t = np.arange(400) * 0.01 + rng.uniform(-0.004, 0.004, 400)
    t -= t[0]
    made = swinging(t)
    segments = segment_recording(made, rig_of(made))
    there = np.isfinite(segments.y[..., 0])
    # No interval is longer than 18 ms, nor a median of 399 of them further from 10 ms than a few percent, so
    # that the grid drifts against the clock and a sample now and then shares its node with another.
    assert there[segments.inside].mean() > 0.8
    assert np.abs(segments.shift).max() <= segments.interval / 2 + 1e-12
    expected = shifted_back(segments, np.cos, lambda moment: -np.sin(moment))
    # What the second-order expansion leaves is at most shift³ / 6.
    np.testing.assert_allclose(segments.y[..., 0][there], expected[there], atol=0.0051**3 / 6 + 1e-12)
    # And the sign matters: without the shift the samples miss by up to 5 mrad.
    wrong = 2 * np.sin(segments.time) - expected
    assert np.abs(segments.y[..., 0] - wrong)[there].max() > 5e-3


def test_of_two_samples_at_one_node_the_mean_is_taken():
    t = np.array([0.0, 0.01, 0.018, 0.021, 0.03, 0.04, 0.05, 0.06, 0.07])
    segments = segment_recording(made := swinging(t, [np.arange(9.0)]), rig_of(made))
    assert segments.y[0, :8, 0].tolist() == [0, 1, 2.5, 4, 5, 6, 7, 8]
    assert segments.shift[0, 2, 0] == pytest.approx(-0.0005)
    assert segments.shift_square[0, 2, 0] == pytest.approx((0.002**2 + 0.001**2) / 2)


def test_gaps_are_missing_and_time_goes_on():
    t = np.concatenate([np.arange(30), np.arange(70, 100)]) * 0.01
    segments = segment_recording(made := swinging(t), rig_of(made), segment_s=1.0)
    assert segments.shape == (1, 100)
    missing = np.isnan(segments.y[0, :, 0])
    assert missing[30:70].all()
    assert not missing[:30].any()
    assert not missing[70:].any()
    np.testing.assert_allclose(segments.y[0, 70:, 0], np.sin(t[30:]), atol=1e-12)


def test_a_long_time_of_which_nothing_is_known_is_no_data():
    """Two motions of 3 s in one file, ten minutes apart."""
    t = np.concatenate([np.arange(300), 60300 + np.arange(300)]) * 0.01
    segments = segment_recording(made := swinging(t), rig_of(made), segment_s=1.0)
    assert segments.shape == (6, 100)
    assert np.isfinite(segments.y[..., 0]).all()
    np.testing.assert_allclose(segments.time[:, 0], [0, 1, 2, 603, 604, 605], atol=1e-9)
    np.testing.assert_allclose(segments.y[3, :, 0], np.sin(t[300:400]), atol=1e-12)


def several_clocks() -> SignalRecording:
    """An encoder at 100 Hz, a camera at 30 Hz that begins 4 ms later, commands at 17 Hz."""
    tables, channels = {}, {}
    for clock, begin, rate in (("encoder", 0.0, 100.0), ("camera", 0.004, 30.0), ("bus", 0.0, 17.0)):
        t = np.arange(begin, 2.0, 1 / rate)
        tables[clock] = pd.DataFrame({"episode": 0, "t": t, clock: np.sin(t)})
    channels["encoder"] = joint("swing")
    channels["camera"] = Channel(
        clock="camera", role="observation", quantity="position", unit="m", site="tip", component="x"
    )
    channels["bus"] = Channel(
        clock="bus", role="control", quantity="command", unit="N m", actuator="drive", hold="linear"
    )
    base = swinging(np.arange(3) * 0.1)
    return replace(base, channels=channels, signals=tables)


def test_each_clock_keeps_its_own_time():
    made = several_clocks()
    rig = rig_of(made)
    assert node_interval(made, rig) == pytest.approx(0.01)
    segments = segment_recording(made, rig)
    slow = np.isfinite(segments.y[..., 1])
    assert slow.sum() == pytest.approx(60, abs=1)
    taken = (segments.time + segments.shift[..., 1])[slow]
    np.testing.assert_allclose(segments.y[..., 1][slow], np.sin(taken), atol=1e-12)
    np.testing.assert_allclose(taken, 0.004 + np.arange(slow.sum()) / 30, atol=1e-9)
    # Commands go straight from sample to sample: off a sine by at most (1/17)² / 8.
    middle = segments.time + segments.interval / 2
    before = middle < 1.9
    np.testing.assert_allclose(segments.control()[..., 0, 0][before], np.sin(middle)[before], atol=5e-4)


def test_controls_are_read_at_the_observations_times():
    """A ramp of commands, and observations that begin half a second after the episode."""
    made = several_clocks()
    made.signals["encoder"] = made.signals["encoder"][lambda table: table["t"] >= 0.499]
    made.signals["camera"] = made.signals["camera"][lambda table: table["t"] >= 0.55]
    made.signals["bus"]["bus"] = made.signals["bus"]["t"]
    segments = segment_recording(made, rig_of(made))
    assert segments.time[0, 0] == pytest.approx(0.5)  # from the episode's start, as effects of time count it
    u, middle = segments.control()[..., 0, 0], segments.time + segments.interval / 2
    before = middle < 1.9
    np.testing.assert_allclose(u[before], middle[before], atol=1e-9)


def test_rates_are_of_second_order_and_end_with_the_episode():
    t = np.arange(63) * 0.01
    segments = segment_recording(made := swinging(t), rig_of(made), segment_s=0.25)
    assert segments.inside.sum(axis=1).tolist() == [25, 25, 13]
    for power in (1, 2):  # exact for parabolas, at both ends too
        values = np.where(segments.inside, segments.time**power, 1e6)[..., None]
        expected = np.where(segments.inside, power * segments.time ** (power - 1), 0)
        np.testing.assert_allclose(segments.rate(values)[..., 0], expected, atol=1e-9)


@pytest.mark.parametrize("nodes", [1, 2])
def test_rates_of_very_short_ends(nodes):
    t = np.arange(4 + nodes) * 0.01
    segments = segment_recording(made := swinging(t), rig_of(made), segment_s=0.04)
    rate = segments.rate(np.where(segments.inside, segments.time, np.nan))
    assert rate[1].tolist() == pytest.approx([1, 1, 0, 0] if nodes == 2 else [0, 0, 0, 0])


def test_episodes_stay_apart_and_in_the_order_of_the_session():
    t = np.arange(80) * 0.01
    made = swinging([t, t[:45], t], [np.full(80, 1.0), np.full(45, 2.0), np.full(80, 3.0)])
    made.episodes["order"] = [2, 0, 1]
    segments = segment_recording(made, rig_of(made), segment_s=0.4)
    assert segments.ids.tolist() == [1, 2, 0]
    # 45 nodes are 40 and 5, which are too few.
    assert segments.episode.tolist() == [0, 1, 1, 2, 2]
    assert segments.first.tolist() == [0, 0, 40, 0, 40]
    assert segments.order.tolist() == [-0.5, 0, 0, 0.5, 0.5]
    recorded = np.array([2.0, 3.0, 3.0, 1.0, 1.0])
    np.testing.assert_array_equal(np.nanmax(segments.y[..., 0], axis=1), recorded)
    np.testing.assert_array_equal(np.nanmin(segments.y[..., 0], axis=1), recorded)


def test_edits_of_controls_see_whole_episodes():
    t = np.arange(60) * 0.01
    made = swinging(t, control=np.ones(60))
    segments = segment_recording(
        made, rig_of(made, PENDULUM.replace('timestep="0.01"', 'timestep="0.005"')), segment_s=0.2
    )
    seen = []

    def edit(u: np.ndarray, step: float) -> np.ndarray:
        seen.append((u.shape, step))
        return np.cumsum(u, axis=0)

    u = segments.control(edit)
    assert seen == [((120, 1), pytest.approx(0.005))]
    assert u.shape == (3, 20, 2, 1)
    np.testing.assert_allclose(u.ravel(), np.arange(1, 121))


def test_without_actuators_there_are_no_controls():
    made = recording(np.arange(50) * 0.01, {"place": (joint("rail", unit="m"), np.zeros(50))})
    passive = CART[: CART.index("<actuator>")] + "</mujoco>"
    segments = segment_recording(made, rig_of(made, passive))
    assert segments.control().shape == (*segments.shape, 1, 0)


def test_samples_of_a_fast_clock_are_averaged():
    """25 samples to a node; of a smooth motion their mean is a value at their mean time, to second order."""
    t = np.arange(500) * 2e-4
    segments = segment_recording(made := swinging(t), rig_of(made))
    assert segments.interval == pytest.approx(LONGEST_AVERAGE_S)
    there, shift, square = segments.inside, segments.shift[..., 0], segments.shift_square[..., 0]
    # In the middle as many before a node as after it, at multiples of 0.2 ms: 2 (1 + 4 + ... + 144) / 25.
    assert shift[0, 5] == pytest.approx(0, abs=1e-12)
    assert square[0, 5] == pytest.approx(52 * 2e-4**2)
    expected = shifted_back(segments, np.cos, lambda moment: -np.sin(moment))
    # Beyond that the mean cube of the offset, which is largest at the ends: 2.4 ms cubed over 24.
    np.testing.assert_allclose(segments.y[there][:, 0], expected[there], atol=2.4e-3**3 / 24)
    noise = np.random.default_rng(5).normal(size=500)
    noisy = segment_recording(swinging(t, [np.sin(t) + noise]), rig_of(made))
    change = (noisy.y - segments.y)[there]
    assert np.std(change) == pytest.approx(1 / 5, rel=4 / np.sqrt(2 * there.sum()))


def test_slower_clocks_keep_every_sample():
    for interval in (1 / 300, 0.005, 0.02):
        made = swinging(np.arange(200) * interval)
        assert node_interval(made, rig_of(made)) == pytest.approx(interval)


def test_an_episode_without_observation_is_refused():
    made = swinging([np.arange(5) * 0.01] * 2)
    made.signals["encoder"].loc[made.signals["encoder"]["episode"] == 1, "angle"] = np.nan
    with pytest.raises(InputError, match=r"^episode 1: nothing was observed; leave the episode out$"):
        segment_recording(made, rig_of(made))


def test_a_control_without_value_is_refused():
    made = swinging([np.arange(5) * 0.01] * 2, control=[np.ones(5), np.ones(5)])
    made.signals["encoder"].loc[made.signals["encoder"]["episode"] == 1, "drive"] = np.nan
    with pytest.raises(InputError, match=r"^episode 1: channel drive has no value; leave the episode out$"):
        segment_recording(made, rig_of(made))


def test_a_later_part_has_the_controls_of_its_own_times():
    t = np.arange(100) * 0.01
    made = swinging(t, control=np.cos(3 * t))
    segments = segment_recording(made, rig_of(made), segment_s=0.4)
    later = segments.later(15)
    assert later.shape == (segments.shape[0], 25)
    np.testing.assert_array_equal(later.time, segments.time[:, 15:])
    there = later.inside
    np.testing.assert_array_equal(later.control()[there], segments.control()[:, 15:][there])


def test_stamps_of_controls_err_as_their_intervals_scatter():
    """Where they are meant to be regular: those written when they change, or at regular times, do not err."""
    rng, t = np.random.default_rng(3), np.arange(2000) * 0.01
    made = swinging([t, t], control=[np.sin(3 * t)] * 2)
    error = 8e-4 * rng.standard_normal(4000)
    found = segment_recording(stamped := with_stamps(made, ["drive"], error), rig_of(stamped)).stamp_error
    # The standard deviation of 4000 draws is known to 1.1 %, that of differences to a little more.
    assert found == pytest.approx([8e-4], rel=0.05)
    assert segment_recording(made, rig_of(made)).stamp_error is None
    rare = with_stamps(made, ["drive"], np.tile(np.sort(rng.uniform(0, 20, 2000)) - t, 2))
    assert segment_recording(rare, rig_of(rare)).stamp_error is None


def test_of_several_changes_between_nodes_each_stamp_errs_by_itself():
    """Readings at 100 Hz, torques at 400 Hz: the change over an interval is that of four."""
    rng, t = np.random.default_rng(4), np.arange(4000) * 0.0025
    made = swinging(t, control=np.sin(3 * t))
    ((clock, table),) = made.signals.items()
    made = with_stamps(made, ["drive"], 2e-4 * rng.standard_normal(4000))
    made = replace(made, signals={**made.signals, clock: table.drop(columns="drive").iloc[::4]})
    assert segment_recording(made, rig_of(made)).stamp_error == pytest.approx([2e-4 / 2], rel=0.05)
