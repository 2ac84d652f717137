"""Simulated hits with effects of the arm, of the contact, of the slide and of the camera."""

from collections.abc import Mapping, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect
from slapshot.effects.slide_law import ActiveEffect
from slapshot.effects.slide_law import slide as slide_with_effects
from slapshot.rollouts.contact import ContactSimulator
from slapshot.rollouts.hits import Hits, Outcomes
from slapshot.rollouts.slide import slide
from slapshot.scenes.scene import Scene
from slapshot.trajectories.execution import execute
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae

Found = Sequence[tuple[Effect, Mapping[str, float]]]  # effects and the values of their parameters

BATCH = 512  # hits in contact at once
SHORT = 0.02  # s, duration of tracks, which are not used


class AugmentedCollector:
    """Simulates hits of an augmented scene (see `slapshot.diagnosis.pucks.augmented`)."""

    def __init__(
        self, scene: Scene, swings: Swings, effects: Found, camera: Array, threads: int, size: int = BATCH
    ) -> None:
        """Prepare; effects of the slide and the camera act here, those of the arm are in scene and swings.

        Args:
            scene: augmented.
            swings: executed on the augmented scene.
            effects: that were found.
            camera: (2,) m, point of the plane that the camera is aimed at.
            threads: of MuJoCo.
            size: number of hits simulated together.
        """
        self._contact = ContactSimulator(scene, swings, size, threads)
        self._radius, self._camera, self._size = scene.info.object_radius, camera, size
        self._sliding = [(e, v) for e, v in effects if e.acts_on_slide]
        self._seeing = [(e, v) for e, v in effects if e.acts_on_camera]

    def collect(self, hits: Hits) -> Outcomes:
        """Simulate any number of hits; rest points are as the camera reports them, without a yaw."""
        parts = [
            self._contact.launches(hits.rows(slice(begin, begin + self._size)))
            for begin in range(0, len(hits.swings), self._size)
        ]
        states = np.concatenate([part.states for part in parts])
        times = np.concatenate([part.times for part in parts])
        friction = np.stack([hits.conditions[f"friction_{k}"] for k in ("x", "y", "torsional")], axis=1)
        places, durations = self._slide(states, friction)
        for effect, values in self._seeing:
            each = {name: np.full(len(places), value) for name, value in values.items()}
            places = effect.see(each, places[:, None], self._camera)[:, 0]
        rests = np.column_stack([places, np.full(len(places), np.nan)])
        return Outcomes(times, states, rests, durations)

    def _slide(self, states: Array, friction: Array) -> tuple[Array, Array]:
        """Rest points (n, 2) in m and durations (n,) in s."""
        if not self._sliding:
            rests, _ = slide(states, friction, self._radius)
            return rests[:, :2], rests[:, 3]
        rows = np.arange(len(states))
        acting = [
            ActiveEffect(effect, rows, {name: np.full(len(rows), value) for name, value in values.items()})
            for effect, values in self._sliding
        ]
        tracks = slide_with_effects(states, friction, self._radius, SHORT, acting)
        return tracks.rests, tracks.durations


class _Commanded:
    """A trajectory model whose commands are changed by effects before they reach the servos."""

    def __init__(self, model: TrajectoryVae, effects: Found, period: float) -> None:
        self.sizes = model.sizes
        self._model, self._effects, self._period = model, effects, period

    def motion(self, latent: Array) -> "_CommandedMotion":
        return _CommandedMotion(self._model.motion(latent), self._effects, self._period)


class _CommandedMotion:
    def __init__(self, motion: Motion, effects: Found, period: float) -> None:
        self.position = motion.position
        self._motion, self._effects, self._period = motion, effects, period

    def servo_targets(self, times: Array, servo_time: float) -> Array:
        targets = self._motion.servo_targets(times, servo_time)
        for effect, values in self._effects:
            targets = effect.command(values, targets, self._period)
        return targets


def swings_with_effects(
    swings: Swings, model: TrajectoryVae, scene: Scene, effects: Found, cores: int
) -> Swings:
    """Execute the swings on an augmented scene; those that are not safe there are left out."""
    commanded = _Commanded(model, effects, scene.info.control_period)
    executed, usable = execute(scene, commanded, swings.latents, swings.splits, cores)  # type: ignore[arg-type]
    return executed.of(usable)
