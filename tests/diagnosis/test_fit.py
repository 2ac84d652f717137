"""Fits end to end: recorded, segmented, fitted; on every kind of joint, with activations and closed loops."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from scipy import optimize, stats
from slapshot.diagnosis.fit.filter import innovations
from slapshot.diagnosis.fit.fit import (
    Fit,
    Fitter,
    _law_errors_apart,
    _with_gain_errors,
    prior_of,
    project_to_bounds,
)
from slapshot.diagnosis.fit.linear import STEP_ERROR, Perturbation
from slapshot.diagnosis.fit.noise import (
    ADDED,
    NOMINAL,
    TYPICAL_LAW_ERROR,
    Noise,
    Prior,
    marginal_likelihood,
)
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.rig_motion import rig_motion, torque_scale
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.effects.joints.actuator_gain import ActuatorGain
from slapshot.effects.joints.armature import Armature
from slapshot.effects.joints.effect import JointEffect, Parameter
from slapshot.effects.joints.encoder_delay import EncoderDelay
from slapshot.effects.joints.linear_drag import LinearDrag
from slapshot.effects.joints.link_mass import LinkMass
from slapshot.effects.joints.viscous_friction import ViscousFriction
from slapshot.recordings.channels import QUATERNION, Channel

from .mechanisms import BRICK, HANGER, PENDULUM, control_channel, joint, place, recording, simulate

Observed = dict[str, tuple[Channel, np.ndarray]]


class RigSimulator(NamedTuple):
    """A rig with data and noise, and what fits them."""

    rig: Rig
    segments: Segments
    trajectory: np.ndarray
    noise: Noise
    fitter: Fitter

    def effects(self, *kinds: type[JointEffect]) -> tuple[JointEffect, ...]:
        """The first instance of each kind."""
        of = rig_motion(self.rig, self.segments, self.trajectory)
        return tuple(next(iter(kind.instances(of))) for kind in kinds)

    def fit(self, *effects: JointEffect, rounds: int = 8, theta: Sequence[float] | None = None) -> Fit:
        hypothesis = Hypothesis(self.rig, effects)
        begin = hypothesis.start if theta is None else np.array(theta)
        return self.fitter.fit(hypothesis, begin, self.trajectory, self.noise, rounds)


def bench(
    text: str,
    t: np.ndarray | list[np.ndarray],
    data: Observed,
    white: Sequence[float],
    *,
    force: float = 1e-6,
    nuisance: tuple[Perturbation, ...] = (),
) -> RigSimulator:
    """What a diagnosis makes of a recording, the noise of its observations being known."""
    made = recording(t, data)
    rig = bind(MjSpec.from_string(text), made.channels)
    segments = segment_recording(made, rig)
    trajectory = recorded_trajectory(rig, segments)
    model, torque = rig.model, torque_scale(rig, segments, trajectory)
    initial = np.concatenate([np.full(model.nv, 0.1**2), np.full(model.nv, 3.0**2), np.ones(model.na)])
    ny = len(white)
    noise = Noise(
        white=np.array(white), coloured=np.zeros(ny), correlation_s=np.ones(ny), force=force, torque=torque,
        initial=initial, weight=np.ones_like(segments.y),
    )  # fmt: skip
    return RigSimulator(rig, segments, trajectory, noise, Fitter(Simulator(rig), segments, torque, nuisance))


def swinging(
    seed: int,
    *,
    true: str = PENDULUM,
    model: str = PENDULUM,
    white: float = 2e-3,
    seconds: float = 2.0,
    finer: int = 1,
    force: float = 1e-6,
    nuisance: tuple[Perturbation, ...] = (),
) -> RigSimulator:
    """A driven rod, simulated by the true model, as another has it."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds * 100)) * 0.01
    u = 1.5 * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t)[:, None] + rng.normal(size=(len(t), 1))
    qpos, *_ = simulate(true, t, u, [rng.uniform(-1, 1)], [rng.uniform(-2, 2)], finer=finer)
    angle = qpos[:, 0] + white * rng.standard_normal(len(t))
    data = {"angle": (joint("swing"), angle), "drive": (control_channel(actuator="drive"), u[:, 0])}
    return bench(model, t, data, [white], force=force, nuisance=nuisance)


DAMPED = PENDULUM.replace('damping="0.05"', 'damping="0.15"')


def test_a_parameter_of_a_pendulum_is_recovered():
    of = swinging(1, true=DAMPED)
    (friction,) = of.effects(ViscousFriction)
    found = of.fit(friction)
    assert found.converged
    # Values and trajectory together converge as Newton's method does: 27, 0.4 and 0.0002 standard deviations.
    assert of.fit(friction, rounds=3).moved < 1e-3
    assert found.theta[0] == pytest.approx(0.1, abs=3 * found.sd[0])
    assert found.sd[0] < 0.01
    # The trajectory is where the true rod was, far closer than its encoder says.
    assert np.sqrt(np.mean((found.trajectory[..., 0] - of.segments.y[..., 0]) ** 2)) == pytest.approx(
        2e-3, rel=0.2
    )


class TooFlat(Fitter):
    """Half of a parameter's effect, as a derivative across a kink may have it: steps go twice as far."""

    def system(self, *of, jacobian=None, **more):
        system, prior = super().system(*of, jacobian=jacobian, **more)
        W = system.W.copy()
        if jacobian is None:  # else it is that of a system before
            W[..., 0] /= 2
        return system.with_columns(W, system.psi), prior


@pytest.mark.parametrize("rounds", [12, 2])
def test_steps_to_and_fro_become_shorter(rounds):
    """A fit that is close when its rounds are used up gets more of them."""
    of = swinging(1, true=DAMPED)
    (friction,) = of.effects(ViscousFriction)
    known = of.fit(friction)
    near = known.theta + 0.3 * known.sd
    fields = {name: getattr(of.fitter, name) for name in of.fitter.__dataclass_fields__}
    found = TooFlat(**fields).fit(
        Hypothesis(of.rig, (friction,)), near, known.trajectory, of.noise, rounds, patient=rounds == 2
    )
    assert found.settled
    assert abs(found.theta - known.theta)[0] < 0.1 * known.sd[0]


class Counting(Fitter):
    """Counts systems, and changes the first one."""

    def system(self, *of, **more):
        system, prior = super().system(*of, **more)
        first, self.__dict__["systems"] = "systems" not in self.__dict__, self.__dict__.get("systems", 0) + 1
        return (self.changed(system) if first else system), prior

    def changed(self, system):
        raise NotImplementedError


def counting(
    of: RigSimulator, kind: type[Counting], theta: np.ndarray, trajectory: np.ndarray
) -> tuple[Fit, int]:
    """A fit of viscous friction, and how many systems it took."""
    fitter = kind(**{name: getattr(of.fitter, name) for name in of.fitter.__dataclass_fields__})
    found = fitter.fit(Hypothesis(of.rig, of.effects(ViscousFriction)), theta, trajectory, of.noise)
    return found, fitter.__dict__["systems"]


class TooLong(Counting):
    """Little of a parameter's effect: the first step goes three hundred times too far."""

    def changed(self, system):
        return system.with_columns(system.W / 300, system.psi)


class Promising(Counting):
    """Residuals that are small at first alone, as derivatives of elsewhere may promise."""

    def changed(self, system):
        return replace(system, r=0.1 * system.r)


def test_a_step_that_is_too_long_is_shortened():
    of = swinging(1, true=DAMPED)
    known = of.fit(*of.effects(ViscousFriction))
    found, _ = counting(of, TooLong, np.zeros(1), of.trajectory)
    assert found.settled
    assert abs(found.theta - known.theta)[0] < 0.1 * known.sd[0]


def test_what_no_shorter_step_mends_is_given_up():
    """A quarter of the step loses as much: no further ones are tried."""
    of = swinging(1, true=DAMPED)
    known = of.fit(*of.effects(ViscousFriction))
    start = known.theta + 0.5 * known.sd
    found, systems = counting(of, Promising, start, known.trajectory)
    assert systems == 4  # at the start, after the step with old and new derivatives, after a quarter of it
    np.testing.assert_array_equal(found.theta, start)
    assert not found.converged


def test_intervals_cover_as_often_as_they_say():
    """Friction and inertia together, 20 recordings: 40 values within two thirds and 95 %."""
    true = DAMPED.replace('damping="0.15"', 'damping="0.15" armature="0.02"')
    z = []
    for seed in range(20):
        of = swinging(100 + seed, true=true, seconds=1.5)
        found = of.fit(*of.effects(ViscousFriction, Armature))
        assert found.converged
        covariance = np.linalg.inv(found.precision)
        # Both in coordinates in which they are independent.
        root = np.linalg.cholesky(covariance)
        z.append(np.linalg.solve(root, found.theta - [0.1, 0.02]))
    z = np.abs(np.array(z)).ravel()
    for bound in (1.0, 2.0):
        inside, share = int(np.sum(z < bound)), 2 * stats.norm.cdf(bound) - 1
        assert stats.binomtest(inside, len(z), share).pvalue > 1e-3


def test_with_process_force_the_intervals_are_wider_and_hold():
    """A force that nobody recorded, white, of a tenth of the torque."""
    z, wide = [], []
    for seed in range(10):
        rng, t = np.random.default_rng(200 + seed), np.arange(200) * 0.01
        u = 1.5 * np.sin(6 * t)[:, None]
        plain = swinging(seed)
        pushed = 0.1 * plain.noise.torque[0] * rng.standard_normal((200, 1))
        qpos, *_ = simulate(DAMPED, t, u + pushed, [0.5], [0.0], finer=1)
        angle = qpos[:, 0] + 1e-3 * rng.standard_normal(200)
        data = {"angle": (joint("swing"), angle), "drive": (control_channel(actuator="drive"), u[:, 0])}
        of = bench(PENDULUM, t, data, [1e-3])
        held = 0.1 * plain.noise.torque[0] / of.noise.torque[0]
        of = of._replace(noise=replace(of.noise, force=held))
        found = of.fit(*of.effects(ViscousFriction))
        z.append((found.theta[0] - 0.1) / found.sd[0])
        wide.append(found.sd[0] / bench(PENDULUM, t, data, [1e-3]).fit(*of.effects(ViscousFriction)).sd[0])
    assert np.min(wide) > 2
    # A chi-squared of 10.
    assert 1e-3 < stats.chi2.sf(np.sum(np.square(z)), 10) < 0.999


def test_several_parameters_of_different_kinds():
    """Mass and gain by the compiled model, a delay of the readings by the observation."""
    true = PENDULUM.replace('mass="1"', 'mass="1.2"').replace("0.0833333333", "0.1")
    true = true.replace('diaginertia="0.1 0.1 0.001"', 'diaginertia="0.1 0.1 0.0012"')
    true = true.replace('joint="swing"/>', 'joint="swing" gear="1.15"/>')
    rng, t = np.random.default_rng(5), np.arange(400) * 0.01
    u = 2 * np.sin(5 * t)[:, None] + rng.normal(size=(400, 1))
    qpos, qvel, _, _ = simulate(true, t, u, [0.6], [0.0], finer=1)
    late = qpos[:, 0] - 0.004 * qvel[:, 0]
    data = {
        "angle": (joint("swing"), late + 1e-3 * rng.standard_normal(400)),
        "drive": (control_channel(actuator="drive"), u[:, 0]),
    }
    of = bench(PENDULUM, t, data, [1e-3])
    found = of.fit(*of.effects(LinkMass, ActuatorGain, EncoderDelay))
    assert found.converged
    # To first order in the delay: acceleration times half its square is 0.0003 rad, a third of the noise.
    np.testing.assert_array_less(np.abs(found.theta - [0.2, 0.15, 0.004]), 3.5 * found.sd)
    np.testing.assert_array_less(found.sd, [0.05, 0.05, 1e-3])


def test_it_says_when_rounds_run_out():
    of = swinging(6, true=PENDULUM.replace('damping="0.05"', 'damping="2.5"'))
    friction = of.effects(ViscousFriction)
    short = of.fit(*friction, rounds=1)
    assert not short.converged
    assert short.moved > 0.01
    assert of.fit(*friction, rounds=12).converged


def test_values_stay_within_bounds():
    """Less friction than none: the fit rests at the bound, and has converged there."""
    of = swinging(7, true=PENDULUM.replace('damping="0.05"', 'damping="0.0"'), model=DAMPED)
    (friction,) = of.effects(ViscousFriction)
    narrow = type(friction)(
        friction._joint, Parameter("coefficient", "N m s/rad", 0.3, low=-0.05, probe=0.01)
    )
    found = of.fit(narrow)
    assert found.theta[0] == -0.05
    assert found.converged


@pytest.mark.parametrize("seed", range(3))
def test_a_step_beyond_what_is_possible_is_the_best_possible_one(seed):
    """Against a bounded least squares; more than one value is at its limit in some."""
    rng = np.random.default_rng(seed)
    of = swinging(7, true=DAMPED)
    friction, armature = of.effects(ViscousFriction, Armature)
    hypothesis = Hypothesis(of.rig, (friction, armature))
    low = np.array([parameter.low for parameter in hypothesis.parameters])
    theta, sd = low + np.array([0.02, 0.001]), np.concatenate([hypothesis.prior_sd, [1.0, 1.0]])
    columns = rng.normal(size=(30, 4)) * [9.0, 9.0, 3.0, 3.0]
    # Only what the first value wants is not possible.
    wanted = columns @ np.array([-1.0, 0.5, 0.3, -0.2])
    scaled, gradient = np.eye(4) + columns.T @ columns, columns.T @ wanted
    limits = np.append((low - theta) / sd[:2], [-np.inf, -np.inf]), np.full(4, np.inf)
    best = optimize.lsq_linear(
        np.vstack([columns, np.eye(4)]), np.append(wanted, np.zeros(4)), limits, tol=1e-14
    )
    found = project_to_bounds(hypothesis, theta, np.linalg.solve(scaled, gradient), sd, scaled)
    np.testing.assert_allclose(found, best.x, atol=1e-8)


def test_the_evidence_prefers_the_truth():
    of = swinging(8, true=DAMPED)
    friction, armature = of.effects(ViscousFriction, Armature)
    nothing, right, more = of.fit(), of.fit(friction), of.fit(friction, armature)
    assert right.log_evidence > nothing.log_evidence + 10
    # A needless value costs about the logarithm of how much the data narrow it down.
    shrunk = np.log(armature.parameters[0].scale / more.sd[1])
    assert right.log_evidence - more.log_evidence == pytest.approx(shrunk, abs=5)


def test_priors_and_data_share_a_value_by_their_precisions():
    of = swinging(15, true=DAMPED)
    (friction,) = of.effects(ViscousFriction)
    wide, narrow = with_scale(friction, 100.0), with_scale(friction, 0.002)
    data, both = of.fit(wide), of.fit(narrow)
    share = 0.002**2 / (0.002**2 + data.sd[0] ** 2)
    assert 0.05 < share < 0.95
    # The effect is linear but for what changes between the two values.
    assert both.theta[0] == pytest.approx(share * data.theta[0], rel=0.05)
    assert both.sd[0] == pytest.approx(np.sqrt(share) * data.sd[0], rel=0.05)


def with_scale(friction: ViscousFriction, scale: float) -> ViscousFriction:
    return ViscousFriction(friction._joint, Parameter("coefficient", "N m s/rad", scale, low=-0.05))


@pytest.mark.parametrize("scale", [0.002, 0.3])
def test_the_evidence_is_the_integral_of_likelihood_times_prior(scale):
    """Over a grid of values, with trajectories on which the model is as good as linear."""
    of = swinging(8, true=DAMPED)
    friction = with_scale(of.effects(ViscousFriction)[0], scale)
    right = of.fit(friction)
    sd, at = right.sd[0], right.theta[0]
    grid = at + sd * np.linspace(-5, 5, 21)
    height = []
    for value in grid:
        hypothesis = Hypothesis(of.rig, (friction,))
        system = of.fitter.linearise(hypothesis, np.array([value]), right.trajectory).system
        seen = innovations(system, of.noise.covariances(of.segments.interval))
        prior = stats.norm.logpdf(value, 0, scale)
        height.append(-0.5 * (np.sum(seen.e**2) + seen.logdet.sum()) + prior)
    height = np.array(height)
    integral = np.log(np.trapezoid(np.exp(height - height.max()), grid)) + height.max()
    assert right.log_evidence == pytest.approx(integral + of.noise.log_prior, abs=0.05)


def test_noise_with_large_law_errors_is_less_credible():
    """Laws that err by three times what is typical, where no law errs: only their prior differs."""
    of = swinging(9)
    usual, large = (
        of.fitter.fit(Hypothesis(of.rig), np.zeros(0), of.fit().trajectory, replace(of.noise, law_error=size))
        for size in (TYPICAL_LAW_ERROR, 3 * TYPICAL_LAW_ERROR)
    )
    assert usual.log_evidence - large.log_evidence == pytest.approx((3**2 - 1) / 2)


@pytest.mark.parametrize("law_error", [1e-4, 0.15])
def test_sizes_of_laws_are_those_of_a_regression_however_much_laws_err(law_error):
    """Errors explain what a regression on the sizes leaves, and make these less sure by a share of them."""
    rng, count = np.random.default_rng(4), 400
    own = rng.normal(size=(count, 2))
    errors = own @ rng.normal(size=(2, 5)) + rng.normal(size=(count, 5))
    prior = Prior(np.ones(8), np.array([0, 0, 0, ADDED, ADDED, ADDED, NOMINAL, NOMINAL]), np.zeros(8, int))
    other = rng.normal(size=(count, 1))
    raw = np.concatenate([own, other, errors], axis=1)
    sd = np.concatenate([[30.0, 20.0, 5.0], np.full(5, law_error)])
    before = raw * sd
    z = before @ _law_errors_apart(before.T @ before, prior, np.array([True, True, False]))
    # Only errors were changed, by multiples of the laws.
    assert z[:, :3] == pytest.approx(before[:, :3])
    changed = z[:, 3:] - before[:, 3:]
    assert own @ np.linalg.lstsq(own, changed, rcond=None)[0] == pytest.approx(changed, abs=1e-9)
    assert np.abs(changed).max() > 0.1 * np.abs(before[:, 3:]).max()
    # Whatever the data, the sizes are those of ridge regression on them alone.
    e = own @ [3.0, -2.0] + errors @ np.full(5, 0.3) + rng.normal(size=count)
    alone = [0, 1]
    columns = z[:, [0, 1, 3, 4, 5, 6, 7]]
    joint_fit = np.linalg.solve(np.eye(7) + columns.T @ columns, columns.T @ e)[alone] * sd[alone]
    regression = np.linalg.solve(np.diag(sd[alone] ** -2.0) + own.T @ own, own.T @ e)
    assert joint_fit == pytest.approx(regression, rel=1e-6)


@pytest.mark.parametrize(("kinds", "error"), [((NOMINAL,), 0.06), ((ADDED,), 0.08), ((NOMINAL, ADDED), 0.1)])
def test_laws_that_err_in_shape_err_by_a_fifth_of_that_as_a_whole(kinds, error):
    """Variances add up, of the laws that have errors: 6 % of those of the model and 8 % of those added."""
    prior = Prior(np.ones(len(kinds)), np.array(kinds), np.zeros(len(kinds), int))
    noise = SimpleNamespace(law_error=0.06, added_error=0.08)
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.2], [0.5, 0.2, 1.0]])
    sizes = np.array([200.0, -20.0, 0.0])  # the last is no law's
    found = np.linalg.inv(_with_gain_errors(np.linalg.inv(covariance), prior, noise, sizes))
    assert found == pytest.approx(covariance + np.diag((0.2 * error * sizes) ** 2))


def test_a_hypothesis_without_parameters_is_a_smoother():
    of = swinging(9)
    found = of.fit()
    assert found.converged
    assert found.theta.shape == found.sd.shape == (0,)
    fresh = of.fitter.linearise(Hypothesis(of.rig), np.zeros(0), found.trajectory).system
    # Without process force the smoothed trajectory is one that the model goes.
    np.testing.assert_allclose(fresh.d[:, :-1][of.segments.inside[:, 1:]], 0, atol=1e-9)


def test_nuisance_takes_the_error_of_the_step():
    """Data by steps of 1 ms, and a model whose steps of 10 ms err more than the noise of the data."""
    coarse = PENDULUM.replace("implicitfast", "Euler")
    without = swinging(10, true=coarse, model=coarse, finer=10, white=2e-4)
    with_it = swinging(10, true=coarse, model=coarse, finer=10, white=2e-4, nuisance=(STEP_ERROR,))
    (friction,) = without.effects(ViscousFriction)
    off, mended = without.fit(friction), with_it.fit(friction)
    assert abs(off.theta[0]) > 4 * off.sd[0]
    assert abs(mended.theta[0]) < 3.5 * mended.sd[0]
    # What is eliminated leaves less to tell the rest by: as the inverse of the whole precision has it.
    hypothesis = Hypothesis(with_it.rig, (friction,))
    system = with_it.fitter.linearise(hypothesis, mended.theta, mended.trajectory, (STEP_ERROR,)).system
    seen = innovations(system, with_it.noise.covariances(0.01))
    Z, prior = seen.Z.reshape(-1, 2), np.array([friction.parameters[0].scale, STEP_ERROR.scale])
    covariance = np.linalg.inv(np.diag(prior**-2.0) + Z.T @ Z)
    assert mended.sd[0] == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)
    assert mended.sd[0] > 1.02 / np.sqrt((Z.T @ Z)[0, 0])
    # The evidence is that of a linear model of both, told from where the value is 0.
    at_zero = replace(seen, e=seen.e + seen.Z[..., 0] * mended.theta[0])
    expected = marginal_likelihood(at_zero, prior) + with_it.noise.log_prior
    assert mended.log_evidence == pytest.approx(expected, abs=0.05)
    assert prior_of(Hypothesis(with_it.rig, (friction,)), (STEP_ERROR,)).sd[1] == STEP_ERROR.scale


def test_a_free_body_that_falls_with_drag():
    rng = np.random.default_rng(11)
    times, data = [], {c: [] for c in "xyz"}
    for _ in range(3):
        t = np.arange(80) * 0.01
        start = np.concatenate([[0, 0, 2], np.array([1.0, 0, 0, 0])])
        velocity = np.concatenate([rng.uniform(-4, 4, 2), [6.0], rng.uniform(-3, 3, 3)])
        drag = lambda _, qpos, qvel: np.concatenate([-0.15 * qvel[:3], np.zeros(3)])  # noqa: E731
        qpos, *_ = simulate(BRICK, t, np.zeros((80, 0)), start, velocity, law=drag, finer=2)
        times.append(t)
        for i, c in enumerate("xyz"):
            data[c].append(qpos[:, i] + 2e-3 * rng.standard_normal(80))
    of = bench(BRICK, times, {c: (place("body", "brick", c), data[c]) for c in "xyz"}, [2e-3] * 3)
    (drag,) = of.effects(LinearDrag)
    found = of.fit(drag)
    assert found.converged
    assert found.theta[0] == pytest.approx(0.15, abs=3.5 * found.sd[0])
    assert found.sd[0] < 0.01


class BallDamping(JointEffect):
    """More damping of a ball joint, which no effect of the catalogue sits on."""

    name, physics, source, phrase = "ball_damping", "", "", ""

    def edit(self, model: mujoco.MjModel, values: np.ndarray) -> None:
        model.dof_damping[:] += values[0]


def test_a_ball_joint():
    rng, t = np.random.default_rng(12), np.arange(250) * 0.01
    true = HANGER.replace('damping="0.01"', 'damping="0.03"')
    start = np.array([np.cos(0.6), 0, np.sin(0.6), 0])
    qpos, *_ = simulate(true, t, np.zeros((250, 0)), start, [1.0, 2.0, 4.0], finer=2)
    noisy = qpos + 1e-3 * rng.standard_normal(qpos.shape)
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    channels = {c: joint("hook", unit="1", component=c) for c in QUATERNION}
    of = bench(HANGER, t, {c: (channels[c], noisy[:, i]) for i, c in enumerate(QUATERNION)}, [1e-3] * 4)
    assert (of.rig.model.nq, of.rig.model.nv) == (4, 3)
    found = of.fit(BallDamping("hook", (Parameter("coefficient", "N m s/rad", 0.05, low=-0.01, probe=1e-3),)))
    assert found.converged
    assert found.theta[0] == pytest.approx(0.02, abs=3.5 * found.sd[0])
    assert found.sd[0] < 5e-3
    np.testing.assert_allclose(np.linalg.norm(found.trajectory[..., :4], axis=-1), 1, atol=1e-12)


LAGGED = PENDULUM.replace(
    '<motor name="drive" joint="swing"/>',
    '<general name="drive" joint="swing" dyntype="filterexact" dynprm="0.08"/>',
)


def test_an_actuator_with_a_state_of_its_own():
    rng, t = np.random.default_rng(13), np.arange(300) * 0.01
    true = LAGGED.replace('damping="0.05"', 'damping="0.2"')
    u = 3 * np.sign(np.sin(7 * t))[:, None]
    qpos, _, act, _ = simulate(true, t, u, [0.2], [0.0], finer=1)
    data = {
        "angle": (joint("swing"), qpos[:, 0] + 1e-3 * rng.standard_normal(300)),
        "drive": (control_channel(actuator="drive"), u[:, 0]),
    }
    of = bench(LAGGED, t, data, [1e-3])
    assert of.rig.model.na == 1
    found = of.fit(*of.effects(ViscousFriction))
    assert found.converged
    assert found.theta[0] == pytest.approx(0.15, abs=3.5 * found.sd[0])
    assert found.sd[0] < 0.02
    # The state of the actuator, which nobody observed, is found too; of a segment of 0.5 s better at its end.
    ends = found.trajectory[:, -1, 2]
    np.testing.assert_allclose(ends, act[49::50, 0][: len(ends)], atol=0.1)


CLOSED = """
<mujoco>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body name="left">
      <joint name="a" axis="0 1 0" damping="0.05"/>
      <inertial mass="1" pos="0 0 -0.2" diaginertia="0.01 0.01 0.01"/>
    </body>
    <body name="right" pos="0.3 0 0">
      <joint name="b" axis="0 1 0" damping="0.05"/>
      <inertial mass="0.6" pos="0 0 -0.3" diaginertia="0.01 0.01 0.01"/>
    </body>
  </worldbody>
  <equality><joint joint1="b" joint2="a" polycoef="0 -0.7 0 0 0" solimp="0.95 0.95 0.001"/></equality>
  <actuator><motor name="drive" joint="a"/></actuator>
</mujoco>
"""


def test_a_closed_loop():
    """Two links whose joints an equality constraint binds together; one of them is observed.

    The constraint's impedance does not depend on its violation. MuJoCo's default does, in a way so rough that
    a fit without sight of the second joint goes round the optimum, a tenth of a standard deviation away.
    """
    rng, t = np.random.default_rng(14), np.arange(300) * 0.01
    true = CLOSED.replace('name="b" axis="0 1 0" damping="0.05"', 'name="b" axis="0 1 0" damping="0.35"')
    u = 2 * np.sin(6 * t)[:, None]
    qpos, *_ = simulate(true, t, u, [0.5, -0.35], [0.0, 0.0], finer=2)
    data = {
        "angle": (joint("a"), qpos[:, 0] + 1e-3 * rng.standard_normal(300)),
        "drive": (control_channel(actuator="drive"), u[:, 0]),
    }
    of = bench(CLOSED, t, data, [1e-3])
    _, friction = ViscousFriction.instances(rig_motion(of.rig, of.segments, of.trajectory))
    assert friction.part == "b"
    found = of.fit(friction)
    assert found.converged
    assert found.theta[0] == pytest.approx(0.3, abs=3.5 * found.sd[0])
    assert found.sd[0] < 1e-3
    # The joint that nobody observed follows the other.
    np.testing.assert_allclose(found.trajectory[..., 1], -0.7 * found.trajectory[..., 0], atol=0.02)
