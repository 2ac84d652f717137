"""Errors of the model's own laws: of unit size, and free of a change of the whole law."""

from types import SimpleNamespace

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.fit.law_error import (
    NEAR_REST,
    Friction,
    Law,
    Shapes,
    added_law_errors,
    friction_at_rest,
    law_errors,
)
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.rig_motion import rig_motion
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.effects.joints.actuator_lag import ActuatorLag
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State
from slapshot.effects.joints.torque_ripple import TorqueRipple

from .mechanisms import PENDULUM, control_channel, joint, recording

HINGE = Joint("swing", 0, 0, "N m", (), 1.0, (), 1.0, 1.0, 0.0, 1.0)
HINGE_SIZE = Parameter("torque", "N m", 1.0)
LESS = 0.3  # share by which friction may be less near rest
WHOLE = 0.2  # size of a change of the whole law


class Empirical(JointEffect):
    empirical = True


class Dry(Empirical):
    friction = True


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


def test_a_drag_errs_smoothly_in_speed_alone_whichever_way_a_body_flies():
    """Speeds from 4 to 9 m/s; whoever flies as fast errs by the same share of the drag, and nothing lags."""
    rng, (S, L) = np.random.default_rng(5), (4, 100)
    speed = np.tile(rng.uniform(4, 9, S * L // 2), 2)
    way = rng.normal(size=(S * L, 3))
    v = speed[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
    state = State(np.zeros((S * L, 7)), np.pad(v, ((0, 0), (0, 3))), *np.zeros((3, S * L)))
    drag = np.concatenate([np.zeros((S * L, 6)), -speed[:, None] * v, np.zeros((S * L, 3))], axis=1)
    system = SimpleNamespace(W=drag.reshape(S, L, 12, 1))
    effect = Empirical("ball", [HINGE_SIZE])
    hypothesis = SimpleNamespace(effects=(effect,), slices=(slice(0, 1),))
    model = SimpleNamespace(body=lambda body: SimpleNamespace(name="ball"))
    rig = SimpleNamespace(joints=(), free_bodies=((1, 0),), model=model, speed=6.6)
    found = added_law_errors(system, hypothesis, np.array([3e-4]), rig, state, 0.01).reshape(S * L, 12, -1)
    assert 2 <= found.shape[-1] <= 12
    square = speed**2
    share = np.linalg.norm(found, axis=1) / square[:, None] / 3e-4
    assert share[: S * L // 2] == pytest.approx(share[S * L // 2 :], rel=1e-9, abs=1e-12)
    along = np.einsum("nck,nc->nk", found, drag)
    assert np.abs(along) == pytest.approx(share * 3e-4 * square[:, None] ** 2, rel=1e-9, abs=1e-12)
    # They change its shape and not its size.
    assert along.sum(axis=0) == pytest.approx(0, abs=1e-9 * np.abs(along).sum())


@pytest.mark.parametrize("which", [0, 1])
def test_near_rest_friction_lacks_what_the_motion_says_up_to_itself(which):
    """Of two coupled joints one has a friction of 2 and, node by node, lacks a force between -4 and 4.

    It may be less than its law says by a share alone: the model's next speed is then nearer to rest.
    """
    rng, (S, L) = np.random.default_rng(3), (2, 200)
    joints = [Joint(name, v, v, "N m", (), 1.0, (), 1.0, 1.0, 0.0, 1e-4) for v, name in enumerate("ab")]
    act = 0.005 * np.array([[0.002, -0.001], [-0.001, 0.003], [0.9, -0.4], [-0.4, 1.2]])
    process = np.tile(act, (S, L, 1, 1))
    speed = np.zeros((S, L, 2))
    speed[..., which] = rng.uniform(-0.1, 0.1, (S, L))
    lacks = np.zeros((S, L, 2))
    lacks[..., which] = rng.uniform(-4, 4, (S, L))
    slides = -2.0 * np.sign(speed[..., which])
    system = SimpleNamespace(
        W=(slides[..., None] * act[:, which])[..., None], B=process, process_force=process,
        d=np.einsum("ij,stj->sti", act, lacks),
    )  # fmt: skip
    friction = Dry("ab"[which], [HINGE_SIZE])
    hypothesis = SimpleNamespace(effects=(friction,), slices=(slice(0, 1),))
    state = State(speed.reshape(-1, 2), speed.reshape(-1, 2), *np.zeros((3, S * L)))
    variance = friction_at_rest(system, hypothesis, np.ones(1), SimpleNamespace(joints=joints), state)
    following = np.concatenate([speed[:, 1:, which], speed[:, -1:, which]], axis=1)
    moves_on = np.abs(following + system.d[..., 2 + which]) > np.abs(following)
    assert 0.2 < np.mean(moves_on) < 0.8
    most = np.where(moves_on, 2.0, 2.0 * LESS)
    near = np.exp(-((speed[..., which] / NEAR_REST) ** 2))
    expected = np.minimum(np.abs(lacks[..., which]), most) * near
    assert np.sqrt(variance[..., which]) == pytest.approx(expected, abs=1e-4 * 4)
    assert not variance[..., 1 - which].any()
    # Laws that are no friction hold nothing.
    damping = Empirical("ab"[which], [HINGE_SIZE])
    other = SimpleNamespace(effects=(damping,), slices=(slice(0, 1),))
    assert friction_at_rest(system, other, np.ones(1), SimpleNamespace(joints=joints), state) is None


def test_a_lag_may_differ_for_a_rise_and_a_fall_and_a_ripple_has_harmonics():
    """A commanded torque lacks 3 sin(t) through one joint of two; a ripple of 0.5 N m at order 4."""
    S, L, t = 2, 150, np.linspace(0, 12, 300)
    lacks = 3 * np.sin(t).reshape(S, L)
    act = np.array([[0.002, 0.001], [0.001, 0.003], [0.9, 0.4], [0.4, 1.2]])
    joints = tuple(Joint(name, v, v, "N m", (v,), 1.0, (), 1.0, 1.0, 0.1, 1.0) for v, name in enumerate("ab"))
    state = State(np.stack([t, t], 1), *np.zeros((2, 300, 2)), t, 0 * t)
    rig = SimpleNamespace(joints=joints, free_bodies=())
    lag = ActuatorLag("actuator b", (1,), HINGE_SIZE)
    ripple = TorqueRipple.at(joints[0], 4.0)
    waves = np.stack([np.sin(4 * (t - 0.1)), np.cos(4 * (t - 0.1)), 0 * t], axis=-1).reshape(S, L, 1, 3)
    by_lag = lacks[..., None, None] * act[:, 1][:, None] / 0.02
    by_ripple = waves * act[:, 0][:, None]
    system = SimpleNamespace(W=np.concatenate([by_lag, by_ripple], axis=-1), B=np.tile(act, (S, L, 1, 1)))
    hypothesis = SimpleNamespace(effects=(lag, ripple), slices=(slice(0, 1), slice(1, 4)))
    found = added_law_errors(system, hypothesis, np.array([0.02, 0.3, 0.4, 4.0]), rig, state, 0.01)
    force = np.linalg.lstsq(act, found.reshape(S * L, 4, -1).transpose(1, 0, 2).reshape(4, -1), rcond=None)[0]
    force = force.reshape(2, S * L, -1)
    # Lags of one and two nodes, the rise and fall, and two harmonics of two phases.
    assert force.shape[-1] == 7
    late = np.concatenate([np.repeat(lacks[:, :1], 2, 1), lacks[:, :-2]], 1) - lacks
    rms = np.sqrt(np.mean(lacks**2))
    for k, expected in ((1, late), (2, np.abs(lacks))):
        scaled = 0.4 * rms * expected.ravel() / np.sqrt(np.mean(expected**2))
        np.testing.assert_allclose(force[1, :, k], scaled, atol=1e-4)
    np.testing.assert_allclose(force[0, :, :3], 0, atol=1e-4)
    for k, wave in enumerate((np.sin(8 * (t - 0.1)), np.cos(8 * (t - 0.1)))):
        np.testing.assert_allclose(force[0, :, 3 + k], 0.5 * wave, atol=1e-9)
    np.testing.assert_allclose(force[1, :, 3:], 0, atol=1e-9)


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
