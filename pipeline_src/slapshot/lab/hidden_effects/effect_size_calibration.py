"""Calibration of effect sizes: simulate noise-free hits of a session with and without a hidden effect.

The displacement of a hidden effect is the rms shift of rest points that it causes, over the hit-to-hit
scatter: the rms distance of a repeated command's rest points from their mean. For effects that hardly move
rest points it is the rms shift of the observed track at equal camera times, from the first launch to the last
rest, over the same scatter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slapshot.errors import InputError
from slapshot.lab.camera import foot_of
from slapshot.lab.hidden_effects.hidden_effect import Concealed, HiddenEffect, NominalMotion, Shape
from slapshot.lab.hit import RigSimulator
from slapshot.lab.hit_types import Hit, HitNoise, HitSpec, draw_hit_noise
from slapshot.lab.release_detection import nearest_pose
from slapshot.lab.rig import Rig
from slapshot.scenes.scene import Scene

HITS = 32  # simulated hits
REPEATED, TIMES = 16, 3  # commands and executions for estimating the scatter
CLOSE = 0.03  # tolerated relative error of the displacement
TRIES = 8  # simulations in a search
_EVERY = 0.01  # s, between times at which tracks are compared
_STRIDE = 20.0  # largest factor between amplitudes of successive tries


class EffectSizeCalibration:
    """Size calibration for a session on a rig without its hidden effects."""

    def __init__(
        self, scene: Scene, rig: Rig, strokes: Sequence[HitSpec], rng: np.random.Generator, cores: int
    ) -> None:
        self._scene, self._rig, self._cores = scene, replace(rig, concealed=()), cores
        still = np.zeros(len(scene.info.joints))
        nothing = HitNoise(np.zeros(2), 1.0, still, 1.0)
        # Spread over the session, for effects that drift.
        chosen = np.unique(np.round(np.linspace(0, len(strokes) - 1, HITS)).astype(int))
        self._strokes = [replace(strokes[i], chance=nothing) for i in chosen]
        bench = RigSimulator(scene, self._rig, cores=cores)
        self._launches = bench.launches(self._strokes, arm=False)
        self._hits = bench.settle(self._strokes, self._launches)
        self.scatter = self._measure_scatter(bench, rng)
        self.nominal = NominalMotion(
            scene=scene,
            foot=foot_of(scene, rig.camera),
            contact_poses=np.array([nearest_pose(scene, s.motion) for s in self._strokes]),
            rests=np.array([hit.rest[:2] for hit in self._hits]),
        )

    def displacement(self, concealed: Concealed) -> float | None:
        """Displacement of this effect alone; None without scatter."""
        return self._shift(concealed, launch=True) / self.scatter if self.scatter > 0 else None

    def find(self, effect: HiddenEffect, shape: Shape, requested: float) -> Concealed:
        """The effect with the amplitude whose displacement is `requested`, or the nearest possible one.

        Raises:
            InputError: there is no scatter to express a displacement in.
        """
        if self.scatter == 0:
            raise InputError(
                "lab.concealed: a displacement needs scatter to be measured by; give an amplitude"
            )

        def measure(amplitude: float, launch: bool) -> float:
            return self._shift(Concealed(effect, amplitude, shape), launch) / self.scatter

        # Effects on the slide hardly change the launch: search with the given launches first, then with whole
        # hits.
        if effect.changes_launch:
            found = _search(lambda a: measure(a, True), requested, effect.typical_amplitude, effect)
        else:
            quick = _search(lambda a: measure(a, False), requested, effect.typical_amplitude, effect)
            found = _search(lambda a: measure(a, True), requested, quick.amplitude, effect)
        ends = found.amplitude in (effect.min_amplitude, effect.max_amplitude)
        bounded = ends and abs(found.displacement / requested - 1) > CLOSE
        return Concealed(effect, found.amplitude, shape, found.displacement, requested, bounded)

    def _measure_scatter(self, bench: RigSimulator, rng: np.random.Generator) -> float:
        every = -(-len(self._strokes) // REPEATED)
        repeated = [stroke for stroke in self._strokes[::every] for _ in range(TIMES)]
        strokes = [replace(s, chance=draw_hit_noise(self._rig.scatter, rng)) for s in repeated]
        rests = np.array([hit.rest[:2] for hit in bench.hits(strokes, arm=False)]).reshape(-1, TIMES, 2)
        # By differences between executions: of equal ones they are 0, and those from a mean are rounded.
        pairs = rests[:, :, None] - rests[:, None]
        return float(np.sqrt((pairs**2).sum() / (2 * TIMES * len(rests) * (TIMES - 1))))

    def _shift(self, concealed: Concealed, launch: bool) -> float:
        """Rms over hits in m; without `launch`, the launches of the nominal rig are used."""
        rig = replace(self._rig, concealed=(concealed,))
        hits = self._hits
        if concealed.effect.phase != "camera":
            bench = RigSimulator(self._scene, rig, cores=self._cores)
            launches = bench.launches(self._strokes, arm=False) if launch else self._launches
            hits = bench.settle(self._strokes, launches)
        squares = [
            _rest_shift(hit, null, rig, stroke) if concealed.effect.observed_in == "rest" else
            _track_shift(hit, null, rig, stroke)
            for hit, null, stroke in zip(hits, self._hits, self._strokes, strict=True)
        ]  # fmt: skip
        return float(np.sqrt(np.mean(squares)))


def _rest_shift(hit: Hit, null: Hit, rig: Rig, stroke: HitSpec) -> float:
    """Squared, in m^2."""
    return float(((rig.seen(hit.track, stroke.place)[-1, 1:] - null.rest[:2]) ** 2).sum())


def _track_shift(hit: Hit, null: Hit, rig: Rig, stroke: HitSpec) -> float:
    """Mean square over the time in which either object moves, in m^2."""
    seen = rig.seen(hit.track, stroke.place)
    first = min(hit.launch_time, null.launch_time)
    times = np.arange(first, max(seen[-1, 0], null.end), _EVERY)
    shift = [
        np.interp(times, seen[:, 0], seen[:, i]) - np.interp(times, null.track[:, 0], null.track[:, i])
        for i in (1, 2)
    ]
    return float((np.square(shift[0]) + np.square(shift[1])).mean())


@dataclass(frozen=True)
class _Try:
    amplitude: float
    displacement: float


def _search(measure: Callable[[float], float], requested: float, first: float, effect: HiddenEffect) -> _Try:
    """The possible amplitude whose displacement is nearest to `requested`, in a few tries from `first`.

    Displacement grows roughly in proportion to amplitude: secant steps on logarithms, bracketed as soon as
    possible.
    """
    amplitude = first
    tries: list[_Try] = []
    below: _Try | None = None
    above: _Try | None = None
    for _ in range(TRIES):
        one = _Try(amplitude, measure(amplitude))
        tries.append(one)
        if one.displacement >= requested:
            above = one
        elif below is None or one.amplitude > below.amplitude:
            below = one
        end = effect.max_amplitude if above is None else effect.min_amplitude if below is None else None
        if abs(one.displacement / requested - 1) < CLOSE or amplitude == end:
            break
        if below is not None and above is not None:
            amplitude = _between(below, above, requested)
            continue
        ratio = requested / one.displacement if one.displacement > 0 else _STRIDE
        amplitude *= float(np.clip(ratio, 1 / _STRIDE, _STRIDE))
        amplitude = min(max(amplitude, effect.min_amplitude), effect.max_amplitude)
    if above is None:  # the displacement was never large enough, and need not be monotonic
        return max(tries, key=lambda one: one.amplitude)
    return min(tries, key=lambda one: abs(one.displacement - requested))


def _between(below: _Try, above: _Try, requested: float) -> float:
    """Interpolate between both on logarithmic axes."""
    low, high = np.log(max(below.displacement, 1e-9)), np.log(above.displacement)
    # Kept away from the ends, so that curvature cannot stall the search.
    share = float(np.clip((np.log(requested) - low) / (high - low), 0.1, 0.9))
    return float(np.exp((1 - share) * np.log(below.amplitude) + share * np.log(above.amplitude)))
