"""Calibration of effect sizes: find the amplitude of a hidden effect that has a requested size.

A whole session is simulated with each amplitude. The size of a hidden effect is the rms change of the
noiseless record of the joint that changes most, over the standard deviation of the encoder noise (for a site,
along an axis).
"""

from collections.abc import Callable, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.execution import LawFactory, SimulatedMotion
from slapshot.lab.joints.hidden_effect import Bounds, Concealed, HiddenEffect, NominalMotion, Shape
from slapshot.lab.joints.noise import NOISE_SD, read_clean
from slapshot.lab.joints.rig import Excitation, Rig
from slapshot.lab.joints.rig_simulator import RigSimulator

CLOSE = 0.05  # tolerated relative error of the size
TRIES = 9  # simulations in a search
DRAWS = 4  # shapes that are tried until one attains the size
_STRIDE = 20.0  # largest factor between amplitudes of successive tries


class EffectSizeCalibration:
    """Size calibration for a session on a rig.

    Args:
        rig: the rig.
        excitation: of the session.
        laws: further laws besides hidden effects.
    """

    def __init__(self, rig: Rig, excitation: Excitation, laws: Sequence[LawFactory] = ()) -> None:
        self._rig, self._excitation, self._laws = rig, excitation, tuple(laws)
        motion = RigSimulator(rig, laws=self._laws).execute(excitation)
        assert motion is not None, "a nominal rig is stable"
        self._null, self._clean = motion, read_clean(rig, motion, ())
        self._last: tuple[Concealed, SimulatedMotion] | None = None
        forces, peaks = motion.forces, motion.peak
        if rig.drive == "mocap":
            forces = rig.damping * motion.speeds
            peaks = np.abs(forces).max((0, 1))
        self.nominal = NominalMotion(
            rig=rig,
            episodes=motion.commands.shape[0],
            seconds=excitation.wave.shape[1] * rig.clock.period,
            positions=self._clean,
            speeds=motion.speeds,
            forces=forces,
            peaks=peaks,
            tip=motion.tip,
        )

    def motion(self, concealed: Sequence[Concealed]) -> SimulatedMotion | None:
        """Simulated motion with hidden effects; None if unstable."""
        if not any(c.amplitude and c.effect.moves() for c in concealed):
            return self._null
        if len(concealed) == 1 and self._last is not None and _same(concealed[0], self._last[0]):
            return self._last[1]
        motion = RigSimulator(self._rig, concealed, self._laws).execute(self._excitation)
        if len(concealed) == 1 and motion is not None:
            self._last = concealed[0], motion
        return motion

    def size(self, concealed: Sequence[Concealed], motion: SimulatedMotion | None = None) -> float:
        """Size of all effects together; infinite if the rig is unstable."""
        motion = motion or self.motion(concealed)
        if motion is None:
            return np.inf
        return change(read_clean(self._rig, motion, concealed), self._clean)

    def find(self, effect: HiddenEffect, requested: float, rng: np.random.Generator) -> Concealed:
        """The effect at the requested size, or at the nearest size that some shape attains."""
        nearest: Concealed | None = None
        for _ in range(DRAWS):
            shape = effect.draw(self.nominal, rng)
            bounds = effect.bounds(self.nominal, shape)
            # If the largest amplitude of one shape was too small, the next shape starts from its largest.
            short = nearest is not None and nearest.size is not None and nearest.size < requested
            found = self.fit(effect, shape, requested, bounds.maximum if short else bounds.typical)
            if nearest is None or _miss(found) < _miss(nearest):
                nearest = found
            if not nearest.bounded:
                break
        assert nearest is not None
        return nearest

    def fit(self, effect: HiddenEffect, shape: Shape, requested: float, first: float) -> Concealed:
        """The amplitude of a shape with the requested size, or the nearest possible one.

        Args:
            effect: the hidden effect.
            shape: drawn shape.
            requested: size.
            first: initial amplitude.
        """
        bounds = effect.bounds(self.nominal, shape)
        amplitude, size = _search(
            lambda a: self.size([Concealed(effect, a, shape)]), requested, bounds, float(first)
        )
        return Concealed(
            effect, amplitude, shape, size, requested, bounded=abs(size / requested - 1) > 2 * CLOSE
        )


def change(angles: Array, null: Array) -> float:
    """Rms change of the joint that changes most, over the noise's standard deviation."""
    return float(np.sqrt(((angles - null) ** 2).mean((0, 1)).max()) / NOISE_SD)


def _same(one: Concealed, other: Concealed) -> bool:
    return (one.effect, one.amplitude, one.shape) == (other.effect, other.amplitude, other.shape)


def _miss(found: Concealed) -> float:
    assert found.size is not None
    assert found.requested is not None
    return abs(np.log(max(found.size, 1e-9) / found.requested))


def _search(
    measure: Callable[[float], float], requested: float, bounds: Bounds, first: float
) -> tuple[float, float]:
    """The possible amplitude whose size is nearest to `requested`, and that size.

    Size grows with amplitude, mostly in proportion, for some effects only beyond a threshold: secant steps on
    logarithms alternate with bisection.
    """
    amplitude = first
    tries: list[tuple[float, float]] = []
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None
    for attempt in range(TRIES):
        size = measure(amplitude)
        tries.append((amplitude, size))
        if size >= requested:
            above = min(above or (amplitude, size), (amplitude, size))
        else:
            below = max(below or (amplitude, size), (amplitude, size))
        end = bounds.maximum if above is None else bounds.minimum if below is None else None
        if abs(size / requested - 1) < CLOSE or amplitude == end:
            break
        if below is not None and above is not None:
            amplitude = _between(below, above, requested, halve=attempt % 2 == 1)
            continue
        ratio = requested / size if size > 0 else _STRIDE
        amplitude *= float(np.clip(ratio, 1 / _STRIDE, _STRIDE))
        amplitude = float(min(max(amplitude, bounds.minimum), bounds.maximum))
    finite = [one for one in tries if np.isfinite(one[1])] or [(0.0, 0.0)]
    return min(finite, key=lambda one: abs(np.log(max(one[1], 1e-9) / requested)))


def _between(below: tuple[float, float], above: tuple[float, float], requested: float, halve: bool) -> float:
    """Interpolate between both on logarithmic axes."""
    share = 0.5
    if not halve and np.isfinite(above[1]):
        low, high = np.log(max(below[1], 1e-6)), np.log(above[1])
        # Kept away from the ends, so that curvature cannot stall the search.
        share = float(np.clip((np.log(requested) - low) / (high - low), 0.1, 0.9))
    return float(np.exp((1 - share) * np.log(below[0]) + share * np.log(above[0])))
