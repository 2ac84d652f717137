"""Errors of the model's own laws: of unit size, and free of a change of the whole law."""

from types import SimpleNamespace

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.fit.law_error import Friction, Law, Shapes, law_errors
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.rig_motion import rig_motion
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.effects.joints.effect import Joint, RigMotion, State

from .mechanisms import PENDULUM, control_channel, joint, recording

HINGE = Joint("swing", 0, 0, "N m", (), 1.0, (), 1.0, 1.0, 0.0, 1.0)
WHOLE = 0.2  # size of a change of the whole law


def moving(text: str, torque: float | None = None) -> tuple[RigMotion, State]:
    """The rod on a sine, its motor at a constant torque or at one that follows nothing."""
    t, rng = np.arange(300) * 0.01, np.random.default_rng(1)
    u = rng.normal(size=300) if torque is None else np.full(300, torque)
    made = recording(t, {"a": (joint("swing"), np.sin(5 * t)), "u": (control_channel(actuator="drive"), u)})
    rig = bind(MjSpec.from_string(text), made.channels)
    segments = segment_recording(made, rig)
    x = recorded_trajectory(rig, segments)
    acting = u[: segments.inside.sum()][:, None]
    flat = x[segments.inside]
    time = segments.time[segments.inside]
    return rig_motion(rig, segments, x), State(flat[:, :1], flat[:, 1:], acting, time, 0 * time)


def laws_of(of: RigMotion, state: State) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Each law, (n,), what errors of it do at a share of 1, (looks, n), and their sizes; the law is last."""
    found, errors, sizes = [], [], []
    for perturbation in (perturbation for law in law_errors(of, state) for perturbation in law):
        errors.append(perturbation.effect.force(state, np.ones(1))[:, 0])
        sizes.append(perturbation.scale)
        if perturbation.scale == WHOLE:
            found.append(
                (errors[-1], np.array(errors[:-1]).reshape(-1, len(errors[-1])), np.array(sizes[:-1]))
            )
            errors, sizes = [], []
    assert not errors
    return found


@pytest.mark.parametrize("fine", [False, True])
def test_each_error_has_the_size_of_its_law_and_leaves_the_whole_alone(fine):
    of, state = moving(PENDULUM)
    rod = of.joints[0]
    law = Law(rod, lambda state: state.torque[:, rod.v], state, fine)
    *errors, whole = law.errors(state).T
    value = state.torque[:, 0]
    np.testing.assert_array_equal(whole, value)
    np.testing.assert_allclose(np.mean(np.square(errors), axis=1), np.mean(value**2), rtol=1e-9)
    np.testing.assert_allclose(np.array(errors) @ value / (value @ value), 0, atol=1e-9)
    # They are told apart, and together have unit size.
    products = np.array(errors) @ np.array(errors).T / (value @ value)
    np.testing.assert_allclose(products, np.eye(len(errors)), atol=1e-9)
    assert np.sum(law.share[:-1] ** 2) == pytest.approx(1)


def test_smooth_functions_of_speed_and_load_are_sums_of_the_shapes():
    """A wave of 10 % over the usual range: what is left of it is a few per cent of it."""
    of, state = moving(PENDULUM)
    rod = of.joints[0]
    law = Law(rod, lambda state: state.torque[:, rod.v], state, True)
    load = state.torque[:, 0] / np.sqrt(np.mean(state.torque[:, 0] ** 2))
    wave = state.torque[:, 0] * np.cos(1.2 * state.v[:, 0] / rod.speed + load)
    columns = law.errors(state)
    remaining = wave - columns @ np.linalg.lstsq(columns, wave, rcond=None)[0]
    assert np.sqrt(np.mean(remaining**2) / np.mean(wave**2)) < 0.1


def test_the_covariance_of_law_errors_is_that_of_two_length_scales():
    """Sums of squared exponentials of 0.6 and 1.8 usual speeds and loads, and a narrow one at rest."""
    rng = np.random.default_rng(2)
    speed, load = rng.normal(size=(2, 1500))
    weight = load**2 / np.sum(load**2)
    shapes = Shapes(speed, load, load**2, (1e-5, 120))
    columns = shapes(speed, load) * shapes.share
    squared = (speed[:, None] - speed) ** 2 + (load[:, None] - load) ** 2
    at_rest = np.exp(-((speed / 0.2) ** 2))
    expected = sum(np.exp(-squared / (2 * scale**2)) for scale in (0.6, 1.8)) + np.outer(at_rest, at_rest)
    mean = weight @ expected
    expected = expected - mean - mean[:, None] + mean @ weight  # what changes the whole law is apart
    expected /= weight @ np.diag(expected)
    usual = np.hypot(speed, load) < 2
    difference = (columns @ columns.T - expected)[np.ix_(usual, usual)]
    # A grid of Gaussians as far apart as they are wide ripples by 2 exp(-pi²/2), or 1.4 %, in either of two
    # directions, and half of the variance is of such a grid: 1.4 % of the whole. The other grid is finer.
    assert np.abs(difference).max() < 0.02 * np.diag(expected).max()


def test_looks_at_law_errors_are_small_steps():
    of, state = moving(PENDULUM)
    for perturbation in (perturbation for law in law_errors(of, state) for perturbation in law):
        assert perturbation.effect.name == "law_error"
        assert perturbation.values == (perturbation.probe,)


@pytest.mark.parametrize(
    ("text", "laws"),
    [
        (PENDULUM.replace(' damping="0.05"', ""), 1),
        (PENDULUM, 2),
        (PENDULUM.replace('damping="0.05"', 'damping="0.05" frictionloss="0.1"'), 3),
    ],
)
def test_only_laws_that_the_model_has_can_err(text, laws):
    of, state = moving(text)
    assert len(laws_of(of, state)) == laws


def test_a_motor_that_does_nothing_does_not_err():
    of, state = moving(PENDULUM, 0.0)
    ((law, errors, _),) = laws_of(of, state)
    np.testing.assert_allclose(law, -0.05 * state.v[:, 0])
    assert np.all(np.mean(errors**2, axis=1) > 0)


def test_what_does_not_vary_is_no_error_of_its_own():
    """A constant load: as a factor it would be a change of the whole law, blown up from rounding."""
    of, state = moving(PENDULUM, 0.7)
    for law, errors, sizes in laws_of(of, state):
        assert np.sum(sizes**2) == pytest.approx(1)
        np.testing.assert_allclose(errors @ law / (law @ law), 0, atol=1e-9)


@pytest.mark.parametrize("distance", [2e-3, 1e-2])
@pytest.mark.parametrize(("forwards", "backwards"), [(1.0, 1.0), (0.7, 0.1)])
def test_after_a_reversal_friction_lacks_the_bend_of_sliding(distance, forwards, backwards):
    """Of bristles dz/dx = F - z, in bends: from -B, the distance that they lack is the integral of F - z."""
    interval, speed = 0.005, np.concatenate([np.full(40, -0.5), np.linspace(-0.5, 0.5, 21), np.full(80, 0.5)])
    level = [np.array([[size]]) for size in (forwards, backwards)]
    deficit, share = (one[0] for one in Friction(HINGE, speed[None], *level).before_slip(interval, distance))
    following = np.append(speed[1:], speed[-1])
    deficit_now = np.sum(deficit * np.abs(speed + following) / 2) * interval
    # Half a bend's share of one of the parts, of which eight make an interval, is the error of the midpoint.
    rel = max(0.5 * 0.5 * interval / 8 / distance, 0.02)
    assert deficit_now == pytest.approx((forwards + backwards) * distance, rel=rel)
    # In steady sliding it decays with the distance.
    assert deficit[70] / deficit[69] == pytest.approx(np.exp(-0.5 * interval / distance), rel=1e-7)
    assert deficit[:39] == pytest.approx(0)
    # What nobody knows of the beginning is forgotten over one bend: in parts, a geometric series.
    part = 0.5 * interval / 8 / distance
    forgotten = np.sum(share * np.abs(speed + following) / 2) * interval
    assert forgotten == pytest.approx(distance * part / (1 - np.exp(-part)), rel=1e-6)


def test_a_friction_is_as_large_before_it_slips_as_in_sliding_either_way_in_each_episode():
    """A friction of .2 + .1 s forwards and of .4 backwards, in the segment s, of which one never moves."""
    rng = np.random.default_rng(2)
    speed = np.repeat(rng.choice((-0.5, 0.5), (3, 40)), 2, axis=1)
    speed[2] = 0.0
    size = np.where(speed > 0, 0.2 + 0.1 * np.arange(3)[:, None], 0.4) * (speed != 0)
    system = SimpleNamespace(B=np.full((3, 80, 2, 1), 0.01))
    state = State(np.zeros((240, 1)), speed.reshape(-1, 1), np.zeros((240, 1)), np.zeros(240), np.zeros(240))
    found = Friction.of(system, -np.sign(speed)[..., None] * size[..., None] * system.B[..., 0], state, HINGE)
    assert found.backwards[:, 0] == pytest.approx(0.4)
    assert found.forwards[:2, 0] == pytest.approx([0.2, 0.3])
    assert found.forwards[2, 0] == pytest.approx(np.median(size[speed > 0]))  # as usual in the others
