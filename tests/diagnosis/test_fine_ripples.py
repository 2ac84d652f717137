"""Ripples with short periods, detected in the force that is left."""

import numpy as np
from mujoco import MjSpec
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection.fine_ripples import _largest, fine_ripples
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.search import _forward_step
from slapshot.diagnosis.selection.steps import EQUIVALENCE_NATS, nominal_motion, nominal_step
from slapshot.effects.joints.effect import Joint
from slapshot.effects.joints.torque_ripple import TorqueRipple

from .mechanisms import control_channel, joint, recording
from .test_one_axis import AXIS, COULOMB, VISCOUS, moved

TRAVEL, SPREAD = 0.5, 0.2  # rad, and N m of a force at a node by noise alone
HINGE = Joint("hinge", 0, 0, "N m", (0,), 10.0, (10.0,), 1.0, TRAVEL, 0.0, 1.0)


def positions() -> np.ndarray:
    """(20, 100) rad of twenty segments of half a second."""
    t = np.arange(2000).reshape(20, 100) * 0.005
    return TRAVEL * np.sqrt(2) * np.sin(1.3 * t + 0.2 * np.sin(0.37 * t))


def test_a_ripple_of_fifty_periods_is_found():
    """By scores of independent forces at each node, as if these were read."""
    q, order, sine, cosine = positions(), 230.0, 0.05, -0.03
    force = sine * np.sin(order * q) + cosine * np.cos(order * q)
    force = force + SPREAD * np.random.default_rng(1).standard_normal(q.shape)
    found = _largest(HINGE, q, force / SPREAD**2)
    assert found is not None
    assert abs(found.start[2] - order) < TorqueRipple.spacing(HINGE)
    # Between two orders of the periodogram phases differ, so that sizes alone compare: 4 sd, and three times
    # the level's own error, that of a median of 100 exponentials (14 %).
    size = np.hypot(sine, cosine)
    assert abs(np.hypot(*found.start[:2]) - size) < 4 * SPREAD * np.sqrt(2 / q.size) + 3 * 0.14 * size


def test_noise_alone_makes_no_ripple():
    """In one of twenty recordings by the threshold, and at most twice that between orders."""
    q, rng = positions(), np.random.default_rng(2)
    draws = 200
    found = sum(_largest(HINGE, q, rng.standard_normal(q.shape) / SPREAD) is not None for _ in range(draws))
    most = 2 * np.exp(-EQUIVALENCE_NATS)
    assert found / draws < most + 3 * np.sqrt(most / draws)


def test_a_ripple_of_an_axis_is_named_with_its_period():
    """2 N in every 7 mm of an axis whose friction is known, by steps of 50 microseconds."""
    order, size = 900.0, 2.0
    rng, t = np.random.default_rng(3), np.arange(4000) * 0.005
    wanted = 0.1 * np.sin(1.1 * t) * np.sin(0.31 * t) + 0.05 * np.sin(2.9 * t)
    speed = np.gradient(wanted, 0.005)

    def controller(k: int, q: float, v: float) -> float:
        return 8000 * (wanted[k] - q) + 1500 * (speed[k] - v)

    place, force = moved(t, 100, controller, lambda time, q: size * np.sin(order * q))
    read = place + 2e-5 * rng.standard_normal(len(t))
    made = recording(
        t, {"q": (joint("slide", unit="m"), read), "u": (control_channel("N", actuator="motor"), force)}
    )
    axis = AXIS.replace('type="slide"', f'type="slide" frictionloss="{COULOMB}" damping="{VISCOUS}"')
    rig = bind(MjSpec.from_string(axis), made.channels)
    problem = Problem.of(rig, made.channels, segment_recording(made, rig))
    before = nominal_step(nominal_motion(problem, ()), np.random.default_rng(1))
    (found,) = fine_ripples(before)
    assert abs(found.start[2] - order) < TorqueRipple.spacing(problem.rig_motion.joints[0])
    step = _forward_step(before, np.random.default_rng(2), lambda text: None)
    assert step is not None
    assert isinstance(step.added, TorqueRipple)
    sine, cosine, fitted = step.scored.fit.theta
    assert abs(fitted - order) < 4 * step.scored.fit.sd[2]
    assert abs(np.hypot(sine, cosine) - size) < 4 * np.hypot(*step.scored.fit.sd[:2])
    assert fine_ripples(step) == []
