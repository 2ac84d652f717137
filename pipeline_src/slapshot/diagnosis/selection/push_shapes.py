"""Shapes of external pushes: constant, or linear between knots, whichever explains the data best.

A hand, or a disturbance that is switched on slowly, pushes for seconds by a force that comes and goes. Taken
for constant, it would be told as one push after another, each with the error of its shape, which hides laws.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.noise import Noise, marginal_likelihood, posterior_means
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.pulses import WINDOW_S, shape_error
from slapshot.effects.joints.effect import Joint
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

_KNOTS = (3, 5, 9, 17)
_ERRORS = (1.0, 0.1, 0.0)  # shares of the errors that shapes may have
_ROUNDING_S = 1e-9
_SHORTEST_S = 4 * WINDOW_S  # pushes below it stay constant
# By how much edges are moved: where a force comes slowly, its first windows do not stand out.
_MOVES_S = tuple(WINDOW_S * n for n in (-2, -1, 1, 2, 4, 8))


def shaped(
    system: Linear,
    push: ExternalPulse,
    start: Array,
    noise: Noise,
    segments: Segments,
    joint: Joint,
    constant: Sequence[bool],
    named: Sequence[Pulse] = (),
) -> tuple[ExternalPulse, Array]:
    """Pushes with the shapes that explain most of a linear system, and about their values.

    Args:
        system: about the fitted trajectory.
        push: constant ones.
        start: (pulses,) about their forces; 0 where nothing is known.
        noise: of the data; the windows of the pushes may be set aside.
        segments: data.
        joint: that is pushed.
        constant: (pulses,) which of them stay constant.
        named: pushes of the joint in the hypothesis, into whose time none grows.
    """
    pulses, values = list[Pulse](), list[Array]()
    for k, pulse in enumerate(push.pulses):
        if constant[k] or pulse.end - pulse.begin < _SHORTEST_S:
            pulses.append(pulse)
            values.append(start[k : k + 1])
            continue
        some = _about(pulse, segments)
        of = _Shapes(system.select(some), noise.select(some), segments.select(some), joint.v, joint.torque)
        least, most = _between(pulse, [*push.pulses, *named])
        found, force = of.best(pulse, start[k : k + 1], least, most)
        pulses.append(found)
        values.append(force)
    return ExternalPulse(joint, pulses), np.concatenate(values)


def _about(pulse: Pulse, segments: Segments) -> NDArray[np.intp]:
    """Indices of the segments near a push, in whose time its edges may be."""
    margin = max(_MOVES_S) + WINDOW_S
    near = (segments.time > pulse.begin - margin) & (segments.time < pulse.end + margin)
    return np.flatnonzero((segments.ids[segments.episode] == pulse.episode) & near.any(axis=1))


def _between(pulse: Pulse, pulses: Sequence[Pulse]) -> tuple[float, float]:
    """The time that a push may take, between the others of its episode."""
    others = [other for other in pulses if other is not pulse and other.episode == pulse.episode]
    return (
        max((other.end for other in others if other.end <= pulse.begin), default=-np.inf),
        min((other.begin for other in others if other.begin >= pulse.end), default=np.inf),
    )


class _Shapes:
    """Evidence of shapes of a push, in the segments around it."""

    def __init__(self, system: Linear, noise: Noise, segments: Segments, v: int, torque: float) -> None:
        self._system, self._noise, self._segments = system, noise, segments
        self._v, self._torque, self._prior = v, torque, torque

    def best(self, pulse: Pulse, start: Array, least: float, most: float) -> tuple[Pulse, Array]:
        """The best shape and about its values; the push as it is, and `start`, where that is constant."""
        times = self._segments.time[self._segments.inside]
        least, most = max(least, float(times.min())), min(most, float(times.max()) + self._segments.interval)
        size = float(np.abs(start).max()) or float(np.abs(self._try(pulse, 0.0)[1]).max())

        def better(of: Pulse, others: Iterable[Pulse]) -> Pulse:
            allowed = [
                other for other in others
                if least <= other.begin < other.end <= most
                and other.end - other.begin >= max((other.knots - 1) * WINDOW_S, _SHORTEST_S) - _ROUNDING_S
            ]  # fmt: skip
            return max([of, *allowed], key=lambda other: self._try(other, size)[0])

        def with_knots(of: Pulse) -> list[Pulse]:
            return [replace(of, knots=knots) for knots in _KNOTS]

        # Edges first, then the comparison with a constant: between wrong edges knots may be worse.
        shape, before = better(replace(pulse, knots=_KNOTS[0]), with_knots(pulse)), pulse
        size = float(np.abs(self._try(shape, size)[1]).max())
        while shape != before:
            before = shape
            shape = better(shape, [replace(shape, begin=shape.begin - move) for move in _MOVES_S])
            shape = better(shape, [replace(shape, end=shape.end + move) for move in _MOVES_S])
            shape = better(shape, with_knots(shape))
        self._prior = max(self._torque, size)
        if better(pulse, [shape]) == pulse:
            return pulse, start
        return shape, self._try(shape, size)[1]

    def _try(self, pulse: Pulse, size: float) -> tuple[float, Array]:
        """Log evidence of a push of about some size, and its values.

        It errs as much as shapes may, or hardly: what is constant is not to be told from knots by its error.
        """
        return max((self._with_error(pulse, share * size) for share in _ERRORS), key=lambda one: one[0])

    def _with_error(self, pulse: Pulse, size: float) -> tuple[float, Array]:
        segments, noise = self._segments, self._noise
        own = (segments.ids[segments.episode] == pulse.episode)[:, None]
        shape = pulse.shape(segments.time) * own[..., None]
        W = self._system.B[..., self._v, None] * shape[:, :, None, :]
        error = shape_error(pulse, size, segments) / noise.torque[self._v]
        if noise.push_error is not None:
            error = np.maximum(error, noise.push_error)
        noise = replace(noise, push_error=error)
        if noise.set_aside is not None:
            noise = replace(noise, set_aside=np.where(shape.any(-1), 0.0, noise.set_aside))
        seen = innovations(
            self._system.with_columns(W, np.zeros((*self._system.r.shape, pulse.knots))),
            noise.covariances(segments.interval),
        )
        sd = np.full(pulse.knots, self._prior)
        return marginal_likelihood(seen, sd), posterior_means(seen, sd)
