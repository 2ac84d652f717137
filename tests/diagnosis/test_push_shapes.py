"""Shapes of pushes: of two masses on rails one is pushed, by a constant force or one that comes and goes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from slapshot.diagnosis.fit.filter import Linear
from slapshot.diagnosis.fit.noise import Noise
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.push_shapes import shaped
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

from .test_pulses import masses, noise, rig, segments

FORCE = 3.0  # N
JOINT = rig(0.01).joints[1]


def precise(of: Segments) -> Noise:
    """Noise by which the usual force is a hundredth of the push, and places are known to a micrometre."""
    return replace(noise(of), force=1e-3, white=np.full(2, 1e-6))


def pushed(of: Segments, force: Callable[[np.ndarray], np.ndarray], seed: int = 4) -> Linear:
    """The masses at rest, of which the second is pushed in the second episode by a force of the time."""
    rng = np.random.default_rng(seed)
    system = masses(of, rng)
    h, own = of.interval, of.episode == 1
    r = 1e-6 * rng.standard_normal(system.r.shape)
    state = np.zeros(2)
    for s in np.flatnonzero(own):
        for t, time in enumerate(of.time[s]):
            r[s, t, 1] += state[0]
            f = float(force(time[None])[0])
            state = np.array([state[0] + h * state[1] + h**2 * f, state[1] + h * f])
    return replace(system, r=r)


def found(of: Segments, system: Linear, begin: float, end: float) -> tuple[Pulse, np.ndarray]:
    push = ExternalPulse(JOINT, [Pulse(9, 0.5, begin, end)])
    shape, values = shaped(system, push, np.zeros(1), precise(of), of, JOINT, [False])
    (pulse,) = shape.pulses
    assert len(values) == len(shape.parameters) == pulse.knots
    return pulse, values


def test_a_constant_force_stays_constant():
    of = segments()
    system = pushed(of, lambda t: FORCE * ((t > 0.3 - 1e-9) & (t < 1.1 - 1e-9)))
    pulse, values = found(of, system, 0.3, 1.1)
    assert pulse == Pulse(9, 0.5, 0.3, 1.1)
    assert values == pytest.approx([0.0])  # the given start: a fit finds it


def test_a_force_that_comes_and_goes_has_knots_on_it():
    """Over segments, and wider than the windows in which it stood out."""
    of, begin, end = segments(), 0.15, 1.35

    def force(t: np.ndarray) -> np.ndarray:
        return np.where(
            (t > begin) & (t < end), FORCE * np.sin(np.pi * (t - begin) / (end - begin)) ** 2, 0.0
        )

    pulse, values = found(of, pushed(of, force), 0.35, 1.1)
    assert pulse.knots >= 5
    assert pulse.begin < 0.3
    assert pulse.end > 1.2
    # Between knots it is linear: by as much as the shape may err.
    spacing = (pulse.end - pulse.begin) / (pulse.knots - 1)
    curvature = 2 * FORCE * (np.pi / (end - begin)) ** 2
    times = np.linspace(pulse.begin, pulse.end, 200, endpoint=False)
    assert pulse.shape(times) @ values == pytest.approx(force(times), abs=spacing**2 * curvature / 4)


def test_a_short_push_stays_constant():
    of = segments()
    system = pushed(of, lambda t: FORCE * np.maximum(1 - np.abs(t - 0.7) / 0.08, 0))
    assert found(of, system, 0.62, 0.78)[0] == Pulse(9, 0.5, 0.62, 0.78)


def test_a_push_does_not_grow_into_another():
    of = segments()
    first, second = Pulse(9, 0.5, 0.1, 0.55), Pulse(9, 0.5, 0.6, 0.7)
    system = pushed(of, lambda t: FORCE * np.sin(2 * np.pi * t / 1.4) ** 2 * (t < 1.4))
    push = ExternalPulse(JOINT, [first, second])
    shape, values = shaped(system, push, np.zeros(2), precise(of), of, JOINT, [False, False])
    grown, beside = shape.pulses
    assert grown.knots > 1
    assert grown.end <= second.begin
    assert beside == second
    assert len(values) == grown.knots + 1


def test_a_shape_is_linear_between_knots():
    pulse = Pulse(0, 0.0, 1.0, 3.0, knots=3)
    times = np.array([0.99, 1.0, 1.5, 2.0, 2.75, 3.0])
    expected = np.interp(times, [1.0, 2.0, 3.0], [4.0, 8.0, 2.0])
    expected[[0, -1]] = 0.0  # it acts from begin to before end
    assert pulse.shape(times) @ np.array([4.0, 8.0, 2.0]) == pytest.approx(expected)


@pytest.mark.parametrize(("begin", "end"), [(0.4, 1.0), (0.35, 1.0), (0.5, 1.0), (0.3, 0.8)])
def test_knots_do_not_hang_on_where_windows_stood_out(begin, end):
    """At edges within the push a constant force may explain more than knots there, and less than the best."""
    of = segments()
    system = pushed(
        of, lambda t: np.where((t > 0.15) & (t < 1.35), np.sin(np.pi * (t - 0.15) / 1.2) ** 2, 0) * 3
    )
    pulse, values = found(of, system, begin, end)
    assert pulse.knots >= 5
    times = np.linspace(pulse.begin, pulse.end, 200, endpoint=False)
    wanted = FORCE * np.sin(np.pi * (times - 0.15) / 1.2) ** 2 * ((times > 0.15) & (times < 1.35))
    assert pulse.shape(times) @ values == pytest.approx(wanted, abs=0.1 * FORCE)


def test_a_push_ends_with_its_episode():
    """Of 0.9 s of the second episode's 1.5 there are data; the rest is padding."""
    of = segments()
    inside = of.inside.copy()
    inside[of.time > 0.9 - 1e-9] = False
    system = pushed(of, lambda t: FORCE * np.sin(np.pi * t / 2) ** 2)
    system = replace(system, r=np.where(inside[..., None], system.r, np.nan))
    pulse, _ = found(replace(of, inside=inside), system, 0.4, 0.9)
    assert pulse.end <= 0.9 + 1e-9


def test_a_push_does_not_grow_into_a_named_one():
    of = segments()
    system = pushed(of, lambda t: FORCE * np.sin(2 * np.pi * t / 1.4) ** 2 * (t < 1.4))
    push = ExternalPulse(JOINT, [Pulse(9, 0.5, 0.1, 0.55)])
    named = [Pulse(9, 0.5, 0.6, 0.7)]
    shape, _ = shaped(system, push, np.zeros(1), precise(of), of, JOINT, [False], named)
    assert shape.pulses[0].end <= 0.6


def test_what_is_to_stay_constant_does():
    of = segments()
    system = pushed(of, lambda t: FORCE * np.sin(np.pi * t / 1.5) ** 2)
    push = ExternalPulse(JOINT, [Pulse(9, 0.5, 0.3, 1.2)])
    shape, values = shaped(system, push, np.array([2.5]), precise(of), of, JOINT, [True])
    assert (shape.pulses, values.tolist()) == (push.pulses, [2.5])
