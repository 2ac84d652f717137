"""A stand-in rig that executes new commands, as a robot would, and returns its camera's observations."""

from collections.abc import Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.config.lab import StandIns
from slapshot.lab.camera import observe
from slapshot.lab.hit import RigSimulator
from slapshot.lab.hit_types import HitNoise, HitSpec, draw_hit_noise
from slapshot.lab.rig import draw_rig
from slapshot.lab.rng_streams import recording_streams
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion


class LiveRig:
    """The rig of a recording, for further hits; only for settings without hidden effects in `concealed`."""

    def __init__(self, scene: Scene, settings: StandIns, seed: list[int], cores: int = 1) -> None:
        """Draw the rig as the stage `lab` draws it.

        Args:
            scene: nominal model of the rig.
            settings: block `lab` of the configuration.
            seed: of the recording: the domain's seed and the rig's number.
            cores: number of cores.
        """
        if settings.concealed:
            raise NotImplementedError("amplitudes of further kinds are rehearsed with a session's commands")
        self._rig = draw_rig(settings, recording_streams(seed)[0])
        self._bench = RigSimulator(scene, self._rig, cores=cores)
        self._joints = len(scene.info.joints)

    @property
    def objects(self) -> list[str]:
        """Ids of the objects that can be hit."""
        return list(self._rig.objects)

    def execute(
        self, motions: Sequence[Motion], object_ids: Sequence[str], rng: np.random.Generator
    ) -> Array:
        """(n, 2) rest points in m as the camera observes them; NaN where the object was not seen at rest.

        Args:
            motions: to execute, known to be safe.
            object_ids: object of each hit.
            rng: source of the hit-to-hit variation; spawns one stream per hit.
        """
        streams = [stream.spawn(2) for stream in rng.spawn(len(motions))]
        chances = [draw_hit_noise(self._rig.scatter, stream[0]) for stream in streams]
        strokes = [HitSpec(m, o, c) for m, o, c in zip(motions, object_ids, chances, strict=True)]
        hits = self._bench.hits(strokes, arm=False)
        seen = [
            observe(hit.track, self._rig.camera, stream[1], self._rig.seen(hit.track, 0.0)).rest
            for hit, stream in zip(hits, streams, strict=True)
        ]
        return np.array([np.full(2, np.nan) if rest is None else rest for rest in seen]).reshape(-1, 2)

    def without_chance(self, motions: Sequence[Motion], object_ids: Sequence[str]) -> Array:
        """(n, 2) true rest points in m without hit-to-hit variation; for an oracle only."""
        nothing = HitNoise(np.zeros(2), 1.0, np.zeros(self._joints), 1.0)
        strokes = [HitSpec(m, o, nothing) for m, o in zip(motions, object_ids, strict=True)]
        return np.array([hit.rest[:2] for hit in self._bench.hits(strokes, arm=False)]).reshape(-1, 2)
