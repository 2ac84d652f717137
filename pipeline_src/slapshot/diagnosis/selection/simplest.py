"""Among rivals that act alike, the simplest."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.law_error import LOW_SPEED
from slapshot.diagnosis.fit.noise import LARGEST_LAW_ERROR
from slapshot.diagnosis.selection.steps import Rival, Step

SIMPLER_MARGIN = 0.1  # share of a gain that a rival may gain less which acts alike with fewer parameters


def simplest(step: Step, rivals: Sequence[Rival]) -> Rival:
    """The best rival, or one with fewer parameters and the same action within law errors.

    Actions are those of whole fits: where other effects moved, too, their change alone is no likeness.
    """
    best = rivals[0]
    change = _velocity_change(step, best)
    tied = [best]
    for rival in rivals[1:]:
        fewer = len(rival.effect.parameters) < len(best.effect.parameters)
        if not fewer or rival.gain < (1 - SIMPLER_MARGIN) * best.gain:
            continue
        compared = np.ones(len(change), bool)
        if best.effect.friction and rival.effect.friction and best.effect.part == rival.effect.part:
            compared = _away_from_rest(step, best.effect.part)
        left = float(np.sum((_velocity_change(step, rival) - change)[compared] ** 2))
        if left < LARGEST_LAW_ERROR**2 * float(np.sum(change[compared] ** 2)):
            tied.append(rival)
    return min(tied, key=lambda rival: (len(rival.effect.parameters), -rival.gain))


def _away_from_rest(step: Step, part: str) -> NDArray[np.bool_]:
    """Nodes at which a joint is fast enough for friction laws to hold."""
    problem = step.problem
    joint = next(joint for joint in problem.rig_motion.joints if joint.name == part)
    trajectory = step.scored.fit.trajectory[problem.segments.inside]
    speed = np.abs(trajectory[:, problem.simulator.tangent.nq + joint.v])
    return np.asarray(speed > 2 * LOW_SPEED * joint.speed)


def _velocity_change(step: Step, rival: Rival) -> Array:
    """Velocity change by a rival over an interval, along the trajectory, relative to the torques' effect."""
    problem, trajectory = step.problem, step.scored.fit.trajectory
    segments, simulator = problem.segments, problem.simulator
    n, nq = trajectory.shape[0] * trajectory.shape[1], simulator.tangent.nq
    x, time = trajectory.reshape(n, -1), segments.time.reshape(n)
    order = np.repeat(segments.order, segments.shape[1])
    ends = []
    for hypothesis, theta in (
        (step.hypothesis, step.scored.fit.theta),
        (rival.fit.hypothesis, rival.fit.theta),
    ):
        model = hypothesis.compiled(theta, segments.step)
        u = hypothesis.control(segments, theta).reshape(n, segments.substeps, -1)
        ends.append(simulator.advance(hypothesis, theta, model, x, u, time, order)[0])
    inertia = np.array([1.0] * simulator.tangent.nv)
    for joint in problem.rig_motion.joints:
        inertia[joint.v] = joint.inertia / joint.torque
    difference = (ends[1] - ends[0])[:, nq : nq + simulator.tangent.nv] * inertia
    return np.asarray(difference[segments.inside.reshape(n)])
