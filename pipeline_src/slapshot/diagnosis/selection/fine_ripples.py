"""Detection of torque ripples with short periods: a periodogram, over position, of the force that is left.

The catalogue starts ripples from a few long periods, whose columns are cheap. A ripple of a gear or motor may
have hundreds of periods over the travel, too many for columns of their own. The smoothed process force over
its variance is the derivative of the likelihood with respect to a force at each node (Fisher's identity), so
that one pass of the smoother gives the scores of all periods.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import innovations, smooth
from slapshot.diagnosis.fit.law_error import NEAR_REST
from slapshot.diagnosis.fit.noise import posterior_means
from slapshot.diagnosis.selection.steps import EQUIVALENCE_NATS, Step
from slapshot.effects.joints.effect import Joint
from slapshot.effects.joints.torque_ripple import MOST, TorqueRipple

_MOST_ORDERS = 600  # of a joint, spaced as those of the catalogue
_PER_SPACING = 2  # points of the periodogram
_NEIGHBOURS = 100  # orders whose median is the level of an order's noise
_LEVELS = _NEIGHBOURS * np.log(2) ** 2  # orders whose mean would be as uncertain as that median
_LARGEST_PHASE = np.pi / 2  # rms change of the phase between nodes


@dataclass(frozen=True)
class FineRipple:
    """A ripple that was detected.

    Attributes:
        effect: with its order.
        start: (3,) first values of sine, cosine and order.
        trials: logarithm of the number of orders that were looked at.
    """

    effect: TorqueRipple
    start: Array
    trials: float


def fine_ripples(step: Step) -> Sequence[FineRipple]:
    """The ripple of a short period that stands out most at each joint, where one does."""
    problem, fit, noise = step.problem, step.scored.fit, step.scored.residual_noise
    system, prior = problem.fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    covariances = noise.covariances(problem.segments.interval)
    values = posterior_means(innovations(system, covariances), prior.at(noise))
    _, force, _ = smooth(system.moved(values).without_columns(), covariances)
    variance = np.broadcast_to(covariances.force, force.shape)
    if covariances.inflation is not None:
        variance = variance * covariances.inflation[..., None]
    found = []
    for joint in problem.rig_motion.joints:
        q = fit.trajectory[:, :-1, joint.q]
        moving = np.abs(problem.speed(fit.trajectory)[:, :-1, joint.v]) > NEAR_REST * joint.speed
        score = np.where(moving, force[:, :-1, joint.v] / variance[:, :-1, joint.v], 0.0)
        ripple = _largest(joint, q - joint.middle, score)
        if ripple is not None:
            found.append(ripple)
    return found


def _largest(joint: Joint, q: Array, score: Array) -> FineRipple | None:
    """The largest peak of a joint's periodogram; None where noise may well have made it.

    Args:
        joint: whose force it is.
        q: (S, L) position about its middle.
        score: (S, L) derivative of the log-likelihood with respect to a force at each node, 1/N or 1/(N m).
    """
    apart = TorqueRipple.spacing(joint)
    change = float(np.sqrt(np.mean(np.diff(q, axis=1) ** 2)))
    most = min(MOST + _MOST_ORDERS, int(_LARGEST_PHASE / max(change, 1e-300) / apart))
    orders = apart * np.arange(MOST + 1.5, most, 1 / _PER_SPACING)
    if len(orders) <= _NEIGHBOURS * _PER_SPACING:
        return None
    of = np.array([np.sum(score * np.exp(1j * order * q)) for order in orders])
    power = np.abs(of) ** 2
    # Without a ripple the power is exponential, about a level that changes slowly over orders.
    level = median_filter(power, _NEIGHBOURS * _PER_SPACING, mode="reflect") / np.log(2)
    # The level is uncertain, too: the ratio has an F distribution, here with the tail of an exponential one.
    gain, trials = _LEVELS * np.log1p(power / level / _LEVELS), float(np.log(len(orders) / _PER_SPACING))
    peak = int(np.argmax(gain))
    if gain[peak] < trials + EQUIVALENCE_NATS:
        return None
    # The level is the information on both amplitudes.
    sine, cosine = of[peak].imag / (level[peak] / 2), of[peak].real / (level[peak] / 2)
    order = float(orders[peak])
    return FineRipple(TorqueRipple.at(joint, order), np.array([sine, cosine, order]), trials)
