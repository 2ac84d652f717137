"""How much of a kind a rig is to conceal: a whole session is rehearsed with each amplitude that is tried.

The size of a piece of concealed physics is the rms change that it makes to the noiseless record of the joint
whose record changes most, over the standard deviation of the encoders' noise (of a site, along an axis).
"""

from collections.abc import Callable, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.execution import MakeLaw, Motion
from slapshot.lab.joints.hidden_effect import Bounds, Concealed, HiddenEffect, NominalMotion, Shape
from slapshot.lab.joints.noise import NOISE_SD, read_clean
from slapshot.lab.joints.rig import Excitation, Rig
from slapshot.lab.joints.rig_simulator import RigSimulator

CLOSE = 0.05  # share of a size that is asked for by which the one found may differ
TRIES = 9  # simulations of a search
DRAWS = 4  # shapes that are tried until one can be as large as is asked for
_STRIDE = 20.0  # most by which an amplitude changes between tries


class Rehearsal:
    """Of a session on a rig.

    Args:
        rig: that moves.
        excitation: of the session.
        laws: that the rig follows besides what it conceals.
    """

    def __init__(self, rig: Rig, excitation: Excitation, laws: Sequence[MakeLaw] = ()) -> None:
        self._rig, self._excitation, self._laws = rig, excitation, tuple(laws)
        motion = RigSimulator(rig, laws=self._laws).execute(excitation)
        assert motion is not None, "a rig that conceals nothing holds together"
        self._null, self._clean = motion, read_clean(rig, motion, ())
        self._last: tuple[Concealed, Motion] | None = None
        forces, peaks = motion.forces, motion.peak
        if rig.drive == "mocap":
            forces = rig.damping * motion.speeds
            peaks = np.abs(forces).max((0, 1))
        self.setting = NominalMotion(
            rig=rig,
            episodes=motion.told.shape[0],
            seconds=excitation.wave.shape[1] * rig.clock.period,
            positions=self._clean,
            speeds=motion.speeds,
            forces=forces,
            peaks=peaks,
            tip=motion.tip,
        )

    def motion(self, concealed: Sequence[Concealed]) -> Motion | None:
        """Of the rig that conceals so much; None where it falls apart."""
        if not any(c.amplitude and c.kind.moves() for c in concealed):
            return self._null
        if len(concealed) == 1 and self._last is not None and _same(concealed[0], self._last[0]):
            return self._last[1]
        motion = RigSimulator(self._rig, concealed, self._laws).execute(self._excitation)
        if len(concealed) == 1 and motion is not None:
            self._last = concealed[0], motion
        return motion

    def size(self, concealed: Sequence[Concealed], motion: Motion | None = None) -> float:
        """Of all together; infinite where the rig falls apart."""
        motion = motion or self.motion(concealed)
        if motion is None:
            return np.inf
        return change(read_clean(self._rig, motion, concealed), self._clean)

    def find(self, kind: HiddenEffect, asked: float, rng: np.random.Generator) -> Concealed:
        """The kind as large as is asked for, with the first shape that can be, or as near as any can be."""
        nearest: Concealed | None = None
        for _ in range(DRAWS):
            shape = kind.draw(self.setting, rng)
            bounds = kind.bounds(self.setting, shape)
            # Where the most that is possible of one shape was too little, that of the next is tried first.
            short = nearest is not None and nearest.size is not None and nearest.size < asked
            found = self.fit(kind, shape, asked, bounds.largest if short else bounds.usual)
            if nearest is None or _miss(found) < _miss(nearest):
                nearest = found
            if not nearest.bounded:
                break
        assert nearest is not None
        return nearest

    def fit(self, kind: HiddenEffect, shape: Shape, asked: float, first: float) -> Concealed:
        """The amplitude that makes a shape as large as is asked for, or the nearest one that is possible.

        Args:
            kind: of the shape.
            shape: that was drawn.
            asked: size.
            first: amplitude that is tried first.
        """
        bounds = kind.bounds(self.setting, shape)
        amplitude, size = _search(
            lambda a: self.size([Concealed(kind, a, shape)]), asked, bounds, float(first)
        )
        return Concealed(kind, amplitude, shape, size, asked, bounded=abs(size / asked - 1) > 2 * CLOSE)


def change(angles: Array, null: Array) -> float:
    """Rms over episodes and samples of the joint that changes most, over the noise's standard deviation."""
    return float(np.sqrt(((angles - null) ** 2).mean((0, 1)).max()) / NOISE_SD)


def _same(one: Concealed, other: Concealed) -> bool:
    return (one.kind, one.amplitude, one.shape) == (other.kind, other.amplitude, other.shape)


def _miss(found: Concealed) -> float:
    assert found.size is not None
    assert found.asked is not None
    return abs(np.log(max(found.size, 1e-9) / found.asked))


def _search(
    measure: Callable[[float], float], asked: float, bounds: Bounds, first: float
) -> tuple[float, float]:
    """The possible amplitude whose size comes nearest to `asked`, and that size.

    Size grows with amplitude, mostly in proportion, but for some kinds only beyond a threshold: secants
    between logarithms, and every second time halves.
    """
    amplitude = first
    tries: list[tuple[float, float]] = []
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None
    for attempt in range(TRIES):
        size = measure(amplitude)
        tries.append((amplitude, size))
        if size >= asked:
            above = min(above or (amplitude, size), (amplitude, size))
        else:
            below = max(below or (amplitude, size), (amplitude, size))
        end = bounds.largest if above is None else bounds.least if below is None else None
        if abs(size / asked - 1) < CLOSE or amplitude == end:
            break
        if below is not None and above is not None:
            amplitude = _between(below, above, asked, halve=attempt % 2 == 1)
            continue
        ratio = asked / size if size > 0 else _STRIDE
        amplitude *= float(np.clip(ratio, 1 / _STRIDE, _STRIDE))
        amplitude = float(min(max(amplitude, bounds.least), bounds.largest))
    finite = [one for one in tries if np.isfinite(one[1])] or [(0.0, 0.0)]
    return min(finite, key=lambda one: abs(np.log(max(one[1], 1e-9) / asked)))


def _between(below: tuple[float, float], above: tuple[float, float], asked: float, halve: bool) -> float:
    """Where the line through both, on logarithmic axes, passes what is asked for."""
    share = 0.5
    if not halve and np.isfinite(above[1]):
        low, high = np.log(max(below[1], 1e-6)), np.log(above[1])
        # Kept off the ends, so that a bend in the curve cannot hold the search up.
        share = float(np.clip((np.log(asked) - low) / (high - low), 0.1, 0.9))
    return float(np.exp((1 - share) * np.log(below[0]) + share * np.log(above[0])))
