"""Which effects of a search keep their names."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis import held_out, held_out_split, held_out_validation
from slapshot.diagnosis.diagnose import _insufficiency_reason
from slapshot.diagnosis.fit.noise import Noise
from slapshot.diagnosis.held_out_validation import distinguishable, improves, predict_models
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection.free_forms import FreeForce, FreeReading
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.steps import Search, Step
from slapshot.diagnosis.verdict_of_search import _size, _unknown, channel_groups
from slapshot.effects.joints.coulomb_friction import CoulombFriction
from slapshot.effects.joints.direction_friction import DirectionFriction
from slapshot.effects.joints.effect import JointEffect, Observed
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse
from slapshot.effects.joints.joint_elasticity import JointElasticity
from slapshot.effects.joints.payload import Payload
from slapshot.effects.joints.spring import Spring
from slapshot.effects.joints.torque_offset import TorqueOffset
from slapshot.effects.joints.viscous_friction import ViscousFriction

from .mechanisms import CART, control_channel, joint, recording
from .test_linear import arm_situation


@pytest.mark.parametrize(
    ("likelihoods", "kept"),
    [
        ([0.0, 50.0, 60.0, 63.0], 3),
        ([0.0, 50.0, 60.0, 57.0], 2),
        ([0.0, 50.0, 40.0, 37.0], 1),
        # Less than two nats tell nothing: an effect stays or goes with the one before it.
        ([0.0, 50.0, 60.0, 59.0], 3),
        ([0.0, 50.0, 40.0, 41.0], 1),
        ([0.0, -50.0, -49.0, -48.0], 0),
        ([0.0, -5.0, -6.0, -7.0], 0),
        # Better than the one before it, and still worse than none.
        ([0.0, -9.0, -8.0, -5.0], 0),
        # One that helps after one that does not: together they do.
        ([0.0, 50.0, 40.0, 45.0], 3),
    ],
)
def test_effects_that_do_not_make_held_out_windows_more_likely_are_dropped(monkeypatch, likelihoods, kept):
    rig, _, of, _ = arm_situation(20)
    effects: list[JointEffect] = [
        next(iter(kind.instances(of))) for kind in (ViscousFriction, Payload, Spring)
    ]
    notes: list[str] = []
    found = searched(rig, effects)
    predictions(monkeypatch, likelihoods)
    cut, by_model = predict_models(found, None, None, 0, notes.append)
    assert list(cut.named) == effects[:kept]
    assert by_model[2].hypothesis.effects == tuple(effects[:kept])
    assert len(cut.dropped) == 3 - kept
    assert all(effect.key in " ".join(notes) for effect in cut.dropped)


def test_an_effect_that_makes_errors_larger_is_dropped_though_windows_are_more_likely(monkeypatch):
    rig, _, of, _ = arm_situation(20)
    effects = [next(iter(kind.instances(of))) for kind in (ViscousFriction, Payload)]
    predictions(monkeypatch, [0.0, 50.0, 60.0], clumsy=2)
    cut, _ = predict_models(searched(rig, effects), None, None, 0, lambda text: None)
    assert list(cut.named) == effects[:1]


@pytest.mark.parametrize(
    ("shrunk", "agree"),
    [
        ([0.5, 0.9, 0.6, 0.7], True),  # by chance in one of 16 cases
        ([0.5, 0.9, 0.6], False),  # in one of 8
        ([0.5, 1.3, 0.6, 0.7], False),
        ([0.5, 1.01, 0.6, 0.7, 0.6, 0.8], True),
        ([1.0, 1.0, 1.0, 1.0], False),
    ],
)
def test_where_errors_shrink_in_window_after_window_the_likelihood_has_no_veto(shrunk, agree):
    """It may be that of a smaller process force, which one window with something else makes unlikely."""
    count = len(shrunk)

    def prediction(errors, likelihood, place=10.0):
        ones = np.ones((count, 1, 1))
        found = SimpleNamespace(
            error=np.array(errors)[:, None, None],
            floor=ones,
            predicted=place * ones,
            log_likelihood=np.full(count, likelihood),
            correlation=np.ones((1, 1, 1)),
        )
        return SimpleNamespace(predictions=found)

    before, after = prediction([1.0] * count, 0.0, place=0.0), prediction(shrunk, -50.0)
    assert improves(before, after) == agree
    assert improves(before, prediction(shrunk, 50.0)) == (min(shrunk) < 1)
    # As likely as before: it stays, but where errors grow in window after window.
    assert improves(before, prediction(shrunk, 1.9 / count))
    assert improves(prediction(shrunk, 1.9 / count), before) != agree


@pytest.mark.parametrize(
    ("travel", "noise", "suffices"),
    [(0.01, 1e-3, True), (1e-3, 1e-5 / 2, True), (1e-3, 1e-3, False), (0.0, 1e-9, False)],
)
def test_a_stage_of_short_travel_suffices_where_its_encoder_sees_it(travel, noise, suffices):
    rig = bind(MjSpec.from_string(CART), {"p": joint("rail", unit="m")})
    around = 1 + travel * np.sqrt(2) * np.sin(np.linspace(0, 20 * np.pi, 2000, endpoint=False))
    problem = SimpleNamespace(
        rig=rig,
        trajectory=around[None, :, None],
        segments=SimpleNamespace(inside=np.ones((1, 2000), bool)),
        initial_noise=SimpleNamespace(single=np.array([noise])),
        rig_motion=SimpleNamespace(joints=[SimpleNamespace(q=0, v=0, middle=1.0)], free_bodies=()),
    )
    assert (_insufficiency_reason(problem) is None) == suffices


@pytest.mark.parametrize("worse", [-50.0, 50.0])
def test_a_window_with_an_event_that_no_model_explains_has_no_veto(worse):
    """Nine windows are predicted twice as well; a push of a hundred times their errors falls in the tenth."""

    def prediction(errors, likelihoods, place):
        ones = np.ones((10, 1, 1))
        found = SimpleNamespace(
            error=np.array(errors)[:, None, None],
            floor=ones,
            predicted=place * ones,
            log_likelihood=np.array(likelihoods),
            correlation=np.ones((1, 1, 1)),
        )
        return SimpleNamespace(predictions=found)

    before = prediction([2.0] * 9 + [100.0], [0.0] * 10, 0.0)
    after = prediction([1.0] * 9 + [100.0 - worse / 5], [3.0] * 9 + [worse], 10.0)
    assert improves(before, after)
    assert not improves(after, before)
    # Between times of rest most windows are no events, but the motion.
    still = prediction([20.0] * 4 + [1.0] * 6, [0.0] * 10, 0.0)
    moved = prediction([8.0] * 4 + [1.01] * 6, [5.0] * 4 + [-0.1] * 6, 10.0)
    assert improves(still, moved)
    # In all windows but that event it is as bad as before.
    assert not improves(before, prediction([2.1] * 9 + [50.0], [-3.0] * 9 + [50.0], 10.0))


@pytest.mark.parametrize("correlation_s", [1e-6, 0.1])
def test_lasting_noise_tells_as_much_as_the_likelihood_has_it(correlation_s):
    """Of a shift that stays, in 20 readings of two channels with gaps: told by the covariance as a whole."""
    noise = Noise(
        white=np.array([0.3, 1.0]), coloured=np.array([0.4, 0.0]), correlation_s=np.full(2, correlation_s),
        force=1.0, torque=np.ones(1), initial=np.ones(2), weight=np.ones((1, 20, 2)),
    )  # fmt: skip
    error = np.zeros((1, 20, 2))
    error[0, 5:8, 0] = np.nan
    own = np.isfinite(error[0, :, 0])
    time = 0.005 * np.arange(20)[own]
    covariance = 0.4**2 * np.exp(-np.abs(np.subtract.outer(time, time)) / correlation_s) + 0.3**2 * np.eye(17)
    nats = 0.5 * (np.linalg.inv(covariance).sum() + 20)  # a shift of 1 in both channels
    for scale, told in ((0.99, False), (1.01, True)):
        shift = scale * np.sqrt(2.0 / nats)  # two nats are asked for
        before, after = (
            SimpleNamespace(
                error=error,
                floor=np.broadcast_to(noise.single, error.shape),
                predicted=np.full(error.shape, place),
                correlation=noise.correlation(20, 0.005),
                log_likelihood=np.array([likelihood]),
            )
            for place, likelihood in ((0.0, 0.0), (shift, -2.1))
        )
        assert distinguishable(before, after) is told


@pytest.mark.parametrize(("apart", "kept"), [(1.99, 2), (2.01, 1)])
def test_an_effect_that_no_held_out_window_shows_stays(monkeypatch, apart, kept):
    """Of one reading, two standard deviations apart: two nats are expected to tell."""
    rig, _, of, _ = arm_situation(20)
    effects = [next(iter(kind.instances(of))) for kind in (ViscousFriction, Payload)]
    predictions(monkeypatch, [0.0, 50.0, 47.0], apart=apart)
    cut, _ = predict_models(searched(rig, effects), None, None, 0, lambda text: None)
    assert list(cut.named) == effects[:kept]


def test_a_push_needs_no_held_out_window_to_show_it(monkeypatch):
    rig, _, of, _ = arm_situation(20)
    push = ExternalPulse(of.joints[0], [Pulse(0, 0.0, 0.1, 0.2)])
    effects = [next(iter(ViscousFriction.instances(of))), push]
    predictions(monkeypatch, [0.0, 50.0, 49.0])
    cut, _ = predict_models(searched(rig, effects), None, None, 0, lambda text: None)
    assert list(cut.named) == effects


def test_a_push_after_a_law_that_does_not_hold_saves_it_not(monkeypatch):
    rig, _, of, _ = arm_situation(20)
    push = ExternalPulse(of.joints[0], [Pulse(0, 0.0, 0.1, 0.2)])
    laws = [next(iter(kind.instances(of))) for kind in (ViscousFriction, Payload)]
    notes: list[str] = []
    predictions(monkeypatch, [0.0, 50.0, 40.0, 60.0])
    monkeypatch.setattr(held_out_validation, "with_pushes", lambda found, seed, report: found)
    cut, _ = predict_models(searched(rig, [*laws, push]), None, None, 0, notes.append)
    assert list(cut.named) == laws[:1]
    assert notes == [f"dropped {laws[1].key}, {push.key}: it does not predict held-out windows better"]
    assert cut.dropped == (laws[1], push)
    assert push.variant in _unknown(cut.final, 0.001, cut.dropped)
    predictions(monkeypatch, [0.0, 50.0])
    cut, _ = predict_models(searched(rig, [push]), None, None, 0, notes.append)
    assert list(cut.named) == [push]


@pytest.mark.parametrize(("likelihoods", "holds"), [([0.0, 50.0, 60.0], True), ([0.0, -50.0, -60.0], False)])
def test_a_law_that_came_of_two_others_is_confirmed_as_any_other(monkeypatch, likelihoods, holds):
    """A constant torque and Coulomb friction became friction by direction in the step that added a push."""
    rig, _, of, _ = arm_situation(20)
    push = ExternalPulse(of.joints[0], [Pulse(0, 0.0, 0.1, 0.2)])
    offset, coulomb, direction = (
        next(iter(kind.instances(of))) for kind in (TorqueOffset, CoulombFriction, DirectionFriction)
    )
    found, merged = searched(rig, [offset, coulomb, push]), searched(rig, [direction, push]).final
    found = replace(found, steps=(*found.steps[:-1], merged))
    assert [found.first_with(effect.key) for effect in (offset, coulomb, direction, push)] == [1, 2, 3, 3]
    predictions(monkeypatch, likelihoods)
    monkeypatch.setattr(held_out_validation, "with_pushes", lambda found, seed, report: found)
    cut, _ = predict_models(found, None, None, 0, lambda text: None)
    assert list(cut.named) == ([direction, push] if holds else [])
    # Without both, the torque that was found before them is tried, too.
    assert list(cut.dropped) == ([] if holds else [offset, direction, push])


def test_pushes_that_went_with_a_law_are_looked_for_again(monkeypatch):
    rig, _, of, _ = arm_situation(20)
    push = ExternalPulse(of.joints[0], [Pulse(0, 0.0, 0.1, 0.2)])
    laws = [next(iter(kind.instances(of))) for kind in (ViscousFriction, Payload)]
    predictions(monkeypatch, [0.0, 50.0, 40.0, 60.0, 70.0])

    def with_pushes(found: Search, seed: int, report: Callable[[str], None]) -> Search:
        assert list(found.named) == laws[:1]
        return replace(searched(rig, [laws[0], push]), dropped=(laws[1],))

    monkeypatch.setattr(held_out_validation, "with_pushes", with_pushes)
    cut, by_model = predict_models(searched(rig, [*laws, push]), None, None, 0, lambda text: None)
    assert list(cut.named) == [laws[0], push]
    assert by_model[2].hypothesis.effects == cut.named
    assert cut.dropped == (laws[1],)


def test_a_law_that_was_removed_takes_no_push_along(monkeypatch):
    rig, _, of, _ = arm_situation(20)
    push = ExternalPulse(of.joints[0], [Pulse(0, 0.0, 0.1, 0.2)])
    laws = [next(iter(kind.instances(of))) for kind in (ViscousFriction, Payload)]
    found = searched(rig, [*laws, push])
    without = searched(rig, [laws[0], push]).final
    predictions(monkeypatch, [0.0, 50.0, 40.0, 60.0])
    found = replace(found, steps=(*found.steps, without))
    cut, _ = predict_models(found, None, None, 0, lambda text: None)
    assert list(cut.named) == [laws[0], push]
    assert not cut.dropped


@pytest.mark.parametrize(("likelihood", "laws"), [(-5.0, True), (5.0, False)])
def test_laws_stand_in_for_a_hidden_state_that_does_not_predict_better(monkeypatch, likelihood, laws):
    rig, _, of, _ = arm_situation(20)
    (hidden, *_), (law, *_), (other, *_) = (
        list(kind.instances(of)) for kind in (JointElasticity, ViscousFriction, Payload)
    )
    found = replace(searched(rig, [hidden]), by_laws=searched(rig, [law, other]).steps)
    predictions(monkeypatch, [0.0, likelihood, 50.0])
    cut, by_model = predict_models(found, None, None, 0, lambda text: None)
    assert list(cut.named) == ([law, other] if laws else [hidden])
    assert by_model[2].hypothesis.effects == cut.named


@pytest.mark.parametrize(("likelihood", "holds"), [(50.0, True), (-20.0, False)])
def test_a_hidden_state_stands_in_for_laws_that_do_not_hold(monkeypatch, likelihood, holds):
    """It explained as much as they did; where it does not predict better either, nothing is named."""
    rig, _, of, _ = arm_situation(20)
    (hidden, *_), (law, *_), (other, *_) = (
        list(kind.instances(of)) for kind in (JointElasticity, ViscousFriction, Payload)
    )
    found = replace(searched(rig, [law]), by_structure=searched(rig, [other, hidden]).steps)
    predictions(monkeypatch, [0.0, -5.0, likelihood])
    cut, by_model = predict_models(found, None, None, 0, lambda text: None)
    assert list(cut.named) == ([other, hidden] if holds else [])
    assert cut.dropped[-1] == law
    assert by_model[2].hypothesis.effects == cut.named


@pytest.mark.parametrize(
    ("p_value", "likelihood", "law_stays"), [(0.5, 50.0, True), (1e-3, 50.0, False), (1e-3, 4.0, True)]
)
def test_a_law_that_leaves_a_mismatch_gives_way_to_a_hidden_state(
    monkeypatch, p_value, likelihood, law_stays
):
    """Which explained nearly as much, if held-out windows are predicted better with it."""
    rig, _, of, _ = arm_situation(20)
    (hidden, *_), (law, *_), (other, *_) = (
        list(kind.instances(of)) for kind in (JointElasticity, ViscousFriction, Payload)
    )
    steps = searched(rig, [law]).steps
    last = replace(steps[-1], test=SimpleNamespace(p_value=p_value))
    structural = searched(rig, [other, hidden]).steps
    found = replace(searched(rig, [law]), steps=(*steps[:-1], last), by_structure=structural)
    predictions(monkeypatch, [0.0, 5.0, likelihood])
    cut, by_model = predict_models(found, None, None, 0, lambda text: None)
    assert list(cut.named) == ([law] if law_stays else [other, hidden])
    assert by_model[2].hypothesis.effects == cut.named
    assert list(cut.dropped) == ([] if law_stays else [law])


def test_a_law_stays_where_a_hidden_state_in_its_place_diverges(monkeypatch):
    rig, _, of, _ = arm_situation(20)
    (hidden, *_), (law, *_) = (list(kind.instances(of)) for kind in (JointElasticity, ViscousFriction))
    steps = searched(rig, [law]).steps
    last = replace(steps[-1], test=SimpleNamespace(p_value=1e-3))
    structural = searched(rig, [hidden]).steps
    found = replace(searched(rig, [law]), steps=(*steps[:-1], last), by_structure=structural)
    predictions(monkeypatch, [0.0, 5.0])
    plain = held_out.predict

    def predict(problem: Problem, hypothesis: Hypothesis, *rest: object) -> SimpleNamespace:
        if hidden in hypothesis.effects:
            raise np.linalg.LinAlgError
        return plain(problem, hypothesis, *rest)

    monkeypatch.setattr(held_out, "predict", predict)
    cut, _ = predict_models(found, None, None, 0, lambda text: None)
    assert list(cut.named) == [law]


def test_a_push_stays_where_the_only_law_does_not_hold(monkeypatch):
    """Whichever of the two was found first: pushes are looked for again without the law."""
    rig, _, of, _ = arm_situation(20)
    push = ExternalPulse(of.joints[0], [Pulse(0, 0.0, 0.1, 0.2)])
    law = next(iter(Payload.instances(of)))
    predictions(monkeypatch, [0.0, -50.0, -60.0], clumsy=1)

    def with_pushes(found: Search, seed: int, report: Callable[[str], None]) -> Search:
        assert not found.named
        return replace(searched(rig, [push]), dropped=(law,))

    monkeypatch.setattr(held_out_validation, "with_pushes", with_pushes)
    cut, by_model = predict_models(searched(rig, [law, push]), None, None, 0, lambda text: None)
    assert list(cut.named) == [push]
    assert cut.dropped == (law,)
    assert by_model[2].hypothesis.effects == (push,)
    cut, _ = predict_models(searched(rig, [push, law]), None, None, 0, lambda text: None)
    assert list(cut.named) == [push]
    assert cut.dropped == (law,)


@pytest.mark.parametrize("interval", [0.003, 1 / 75, 1 / 15, 0.00799999, 0.01])
def test_a_long_episode_has_windows_at_any_rate(interval):
    t = np.arange(round(30 / interval)) * interval
    made = recording(t, {"p": (joint("rail", unit="m"), 0.3 * t)})
    rig = bind(MjSpec.from_string(CART), made.channels)
    segments = segment_recording(made, rig)
    _, held = held_out_split.split(segments)
    windows = held_out_split.held_out_windows(made, rig, segments, held)
    assert len(windows.episode) == len(held) // 2
    assert windows.shape[1] // 2 * windows.interval == pytest.approx(0.5, abs=interval)
    times = {round(float(t), 6) for t in segments.time[held][segments.inside[held]]}
    assert {round(float(t), 6) for t in windows.time[windows.inside]} <= times


def test_windows_without_readings_in_either_half_are_none():
    t = np.arange(2000) * 0.01
    read = np.where((t > 2.495) & (t < 2.995), np.nan, 0.3 * t)
    made = recording(t, {"p": (joint("rail", unit="m"), read)})
    rig = bind(MjSpec.from_string(CART), made.channels)
    segments = segment_recording(made, rig)
    _, held = held_out_split.split(segments)
    windows = held_out_split.held_out_windows(made, rig, segments, held)
    assert segments.time[held].min() == pytest.approx(2.0)
    assert windows.time.min() > 3
    assert len(windows.episode) == len(held) // 2 - 1


@pytest.mark.parametrize(("seconds", "window_s"), [(0.75, 0.37), (2.6, 0.5)])
def test_held_out_windows_of_short_and_of_long_episodes(seconds, window_s):
    """Short flights are predicted from their first half; every fifth episode is held out."""
    t = np.arange(round(seconds / 0.01)) * 0.01
    made = recording([t] * 10, {"p": (joint("rail", unit="m"), [0.3 * t] * 10)})
    rig = bind(MjSpec.from_string(CART), made.channels)
    segments = segment_recording(made, rig)
    _, held = held_out_split.split(segments)
    windows = held_out_split.held_out_windows(made, rig, segments, held)
    assert sorted(set(windows.episode)) == [2, 7]
    assert windows.shape[1] // 2 * windows.interval == pytest.approx(window_s)
    assert len(windows.episode) == 2 * int(seconds / (2 * window_s))
    assert windows.inside.mean() > 0.75


def test_held_out_blocks_of_a_long_episode_are_windows():
    t = np.arange(2000) * 0.01
    made = recording(t, {"p": (joint("rail", unit="m"), 0.3 * t)})
    rig = bind(MjSpec.from_string(CART), made.channels)
    segments = segment_recording(made, rig)
    _, held = held_out_split.split(segments)
    windows = held_out_split.held_out_windows(made, rig, segments, held)
    blocks = set(segments.first[held])
    assert {f for first in windows.first for f in (first, first + 50)} == blocks


def test_the_size_of_a_force_over_load_is_that_at_the_loads_that_acted_with_its_interval():
    rng, t = np.random.default_rng(8), np.arange(400) * 0.01
    drive = 3 * np.sin(2 * t) + 0.1 * rng.standard_normal(len(t))
    made = recording(
        t, {"p": (joint("rail", unit="m"), 0.3 * np.sin(t)), "u": (control_channel(actuator="push"), drive)}
    )
    rig = bind(MjSpec.from_string(CART), made.channels)
    problem = Problem.of(rig, made.channels, segment_recording(made, rig))
    (rail,) = problem.rig_motion.joints
    form = FreeForce(rail, "load", -4.0, 4.0)
    values = rng.standard_normal(len(form.parameters))
    step = SimpleNamespace(
        problem=problem, scored=SimpleNamespace(fit=SimpleNamespace(trajectory=problem.trajectory))
    )
    gear = rig.model.actuator_gear[0, 0]
    held = gear * drive[np.rint(problem.segments.time[problem.segments.inside] / 0.01).astype(int)]
    force = form.basis(held) @ (values * [parameter.scale for parameter in form.parameters])
    size = _size(step, form, values, 1e-4 * np.eye(len(values)))
    assert size.value == pytest.approx(np.sqrt(np.mean(force**2)), rel=1e-6)
    # By draws of the weights; 4000 tell a standard deviation to four times 1.1 %.
    draws = values + 1e-2 * rng.standard_normal((4000, len(values)))
    drawn = form.basis(held) @ (draws * [parameter.scale for parameter in form.parameters]).T
    spread = np.std(np.sqrt(np.mean(drawn**2, axis=0)))
    assert (size.high - size.value) / 1.645 == pytest.approx(spread, rel=0.045)
    assert size.value - size.low == pytest.approx(size.high - size.value)


def test_the_size_of_an_error_of_readings_is_that_where_the_joint_was_read():
    """About 2 m, where a slow clock has no reading at every second node; about 0 the error is another."""
    t = np.arange(400) * 0.01
    place = 2 + 0.3 * np.sin(t)
    made = recording(t, {"p": (joint("rail", unit="m"), place)})
    rig = bind(MjSpec.from_string(CART), made.channels)
    problem = Problem.of(rig, made.channels, segment_recording(made, rig))
    problem.segments.y[:, ::2] = np.nan
    (rail,) = problem.rig_motion.joints
    form = FreeReading(rail, [0], "position", -1.0, 3.0)
    values = np.array([5.0, 4.0, 3.0, 2.0, 1.0, 0.5])
    step = SimpleNamespace(
        problem=problem, scored=SimpleNamespace(fit=SimpleNamespace(trajectory=problem.trajectory))
    )
    seen = Observed(place[:, None], 0 * place[:, None], 0 * place[:, None], 0 * place)
    error = form.observe(seen, values * [parameter.scale for parameter in form.parameters])
    size = _size(step, form, values, np.eye(len(values)))
    assert size.value == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-3)


def test_errors_in_rad_and_in_m_are_told_apart():
    def observed(quantity, dof):
        return SimpleNamespace(quantity=quantity, dof=dof)

    rig = SimpleNamespace(
        observations=[observed("position", 0), observed("position", 1), observed("position", None)]
    )
    alike = channel_groups(rig, ["rad", "rad", "m"])
    assert {kind: c.tolist() for kind, c in alike.items()} == {"joint position": [0, 1], "body position": [2]}
    apart = channel_groups(rig, ["m", "rad", "m"])
    assert {kind: c.tolist() for kind, c in apart.items()} == {
        "joint position in m": [0], "joint position in rad": [1], "body position": [2],
    }  # fmt: skip


def searched(rig, effects: list[JointEffect]) -> Search:
    """A search that added these one after another."""
    steps = []
    for k in range(len(effects) + 1):
        hypothesis = Hypothesis(rig, tuple(effects[:k]))
        fit = SimpleNamespace(hypothesis=hypothesis, theta=hypothesis.start, trajectory=None, precision=None)
        scored = SimpleNamespace(fit=fit, noise=None)
        steps.append(Step(None, scored, None, effects[k - 1] if k else None))
    return Search(tuple(steps), ())


def predictions(monkeypatch, likelihoods: list[float], clumsy: int | None = None, apart: float = 3.0) -> None:
    """Likelihood of held-out windows by the number of effects; errors fall, but for so many.

    Predictions of so many effects and of one more differ by `apart` standard deviations of a reading.
    """
    monkeypatch.setattr(held_out, "initial_trajectory", lambda *a: None)
    monkeypatch.setattr(held_out, "refitted_noise", lambda *a: (None, None))

    def predict(problem, hypothesis, *a):
        value = np.array([likelihoods[len(hypothesis.effects)]])
        count = len(hypothesis.effects)
        error = np.full((1, 1, 1), 2.0 if count == clumsy else 1 / (1 + count))
        ones = np.ones((1, 1, 1))
        return SimpleNamespace(
            log_likelihood=value, error=error, floor=ones, predicted=apart * count * ones, correlation=ones
        )

    monkeypatch.setattr(held_out, "predict", predict)
