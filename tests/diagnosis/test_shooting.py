"""Shooting: as the filter on linear systems, and where it cannot follow: a spring and play in a joint."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.fit.fit import Fit
from slapshot.diagnosis.fit.shooting import shoot, simulate
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.model.structure import restructured
from slapshot.diagnosis.selection.problem import Problem
from slapshot.effects.joints.actuator_gain import ActuatorGain
from slapshot.effects.joints.backlash import Backlash
from slapshot.effects.joints.catalogue import instances
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.encoder_delay import EncoderDelay
from slapshot.effects.joints.joint_elasticity import JointElasticity

from . import mechanisms
from .mechanisms import CART, PENDULUM, control_channel, joint, recording

WHITE = 3e-4
ROD = PENDULUM.replace('damping="0.05"', 'damping="0.05" armature="0.05"').replace(
    'timestep="0.01"', 'timestep="0.002"'
)
T = np.arange(100) * 0.01


def drives(seed: int, count: int = 4) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [
        3 * np.sin(2 * np.pi * rng.uniform(1, 2.5) * T + rng.uniform(0, 6))[:, None]
        + 2 * np.repeat(rng.normal(size=(20, 1)), 5, axis=0)
        for _ in range(count)
    ]


def problem(text: str, name: str, u: list[np.ndarray], angles: list[np.ndarray], seed: int) -> Problem:
    rng = np.random.default_rng([seed, 1])
    noisy = [angle + WHITE * rng.standard_normal(len(angle)) for angle in angles]
    unit, motor = ("m", "push") if name == "rail" else ("rad", "drive")
    channels = {
        "angle": (joint(name, unit=unit), noisy),
        "drive": (control_channel(actuator=motor), [part[:, 0] for part in u]),
    }
    taken = recording([T] * len(u), channels)
    rig = bind(MjSpec.from_string(text), taken.channels)
    return Problem.of(rig, taken.channels, segment_recording(taken, rig))


def flexible(kind: type[JointEffect], variant: int, values: list[float], seed: int) -> Problem:
    """A rod with a spring or play that the model has not."""
    u = drives(seed)
    nothing = problem(ROD, "swing", u, [0.3 * np.sin(7 * T + part[0]) for part in u], seed)
    effect = list(kind.instances(nothing.rig_motion))[variant]
    rig = restructured(nothing.rig, effect, nothing.channels)
    model = Hypothesis(rig, (effect,)).compiled(np.array(values), 0.002)
    angles = []
    for k, part in enumerate(u):
        qpos, *_ = mechanisms.simulate(model, T, part, [0.2 * k, 0.0], [0.5, 0.0], finer=5)
        angles.append(qpos.sum(axis=1) if effect.reads_link else qpos[:, 0])
    return problem(ROD, "swing", u, angles, seed)


@pytest.mark.parametrize("factor", [3.0, 1 / 3])
@pytest.mark.parametrize(
    ("kind", "variant", "values"),
    [(JointElasticity, 0, [0.01, 0.3]), (JointElasticity, 1, [0.01, 0.3]), (Backlash, 0, [0.02, 0.05])],
)
def test_a_spring_and_play_are_recovered(
    kind: type[JointEffect], variant: int, values: list[float], factor: float
):
    of = flexible(kind, variant, values, 1)
    own = [e for e in instances(of.rig_motion) if isinstance(e, kind)][variant]
    moved = of.restructured(own, of.trajectory)
    hypothesis = Hypothesis(moved.rig, (own.on(moved.rig_motion),))
    noise, noise_of_rigid = (replace(p.initial_noise, white=np.array([WHITE])) for p in (moved, of))
    theta = np.array([factor * values[0], hypothesis.start[1]])

    def shot(level: float = -np.inf, rounds: int = 40) -> Fit:
        simulator, segments = moved.fitter.simulator, moved.segments
        return shoot(simulator, hypothesis, theta, segments, moved.trajectory, noise, rounds, level=level)

    found = shot()
    # A rigid model explains less: one with a spring or play comes there, and is not given up on the way.
    rigid = shoot(of.simulator, Hypothesis(of.rig), np.zeros(0), of.segments, of.trajectory, noise_of_rigid)
    assert shot(rigid.log_evidence).log_evidence == found.log_evidence > rigid.log_evidence
    assert shot(found.log_evidence + 1e5).log_evidence == -np.inf
    # What ends before it came there may come there in later rounds.
    assert np.isfinite(shot(found.log_evidence - 20, rounds=3).log_evidence)
    if kind is Backlash:
        # The gap is what a verdict tells; damping within it acts for milliseconds, and hardly shows.
        assert found.theta[0] == pytest.approx(values[0], rel=0.05)
        return
    assert found.converged
    assert np.all(np.abs(found.theta - values) < 4 * found.sd)
    assert found.sd[0] < 0.01 * values[0]
    # What is left is noise: the trajectory goes where the rod went.
    simulator, first = moved.fitter.simulator, found.trajectory[:, 0]
    left = moved.segments.y - simulate(simulator, hypothesis, found.theta, moved.segments, first)[1]
    assert np.sqrt(np.nanmean(left**2)) < 1.05 * WHITE


def sliding(seed: int, gain: float = 1.2) -> Problem:
    u = drives(seed)
    places = [mechanisms.simulate(CART, T, gain * part, [0.1], [0.2], finer=1)[0][:, 0] for part in u]
    return problem(CART, "rail", u, places, seed)


@pytest.mark.parametrize("coloured", [0.0, 5e-4])
@pytest.mark.parametrize("kinds", [(), (ActuatorGain,), (ActuatorGain, EncoderDelay)])
def test_on_a_linear_system_it_is_the_filter(coloured: float, kinds: tuple[type[JointEffect], ...]):
    """Both evidences are exact. The filter's prior of initial states moves with the trajectory, all that they
    differ by: half the squared distance, in prior standard deviations, by which first states moved."""
    of = sliding(2)
    of.segments.y[0, 5:9] = np.nan  # what is missing counts in neither
    noise = replace(
        of.initial_noise, white=np.array([WHITE]), coloured=np.array([coloured]), force=1e-6,
        initial=np.array([0.5**2, 20.0**2]), growth=np.array([0.8]), order=of.segments.order,
    )  # fmt: skip
    assert np.ptp(of.segments.order) > 0  # noise differs between segments
    hypothesis = Hypothesis(of.rig, tuple(next(iter(kind.instances(of.rig_motion))) for kind in kinds))
    fitter = replace(of.fitter, nuisance=(), rig=None, law_errors=None)
    one = fitter.fit(hypothesis, hypothesis.start, of.trajectory, noise)
    two = shoot(fitter.simulator, hypothesis, hypothesis.start, of.segments, of.trajectory, noise)
    assert one.converged
    assert two.converged
    off = (two.trajectory[:, 0] - of.trajectory[:, 0]) / np.sqrt(noise.initial)
    assert abs(one.log_evidence - two.log_evidence) < 0.5 * np.sum(off**2) + 0.02
    if kinds:
        np.testing.assert_allclose(two.sd, one.sd, rtol=1e-2)
        assert np.all(np.abs(two.theta - one.theta) < 0.05 * one.sd)
    inside = of.segments.inside
    np.testing.assert_allclose(two.trajectory[inside][:, 0], one.trajectory[inside][:, 0], atol=0.1 * WHITE)
