"""Fast simulation of hits: cached swing, contact phase with the whole arm, hop, and planar slide to rest."""

import numpy as np

from slapshot.arrays import Array
from slapshot.rollouts.contact import ContactSimulator, Launches
from slapshot.rollouts.hits import Hits, Outcomes
from slapshot.rollouts.slide import slide
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import Swings

# Hits simulated together: enough to keep all threads busy, few enough to bound memory.
BATCH = 1024


class Collector:
    """Simulates hits of one scene with one pool of swings."""

    def __init__(self, scene: Scene, swings: Swings, threads: int, size: int = BATCH) -> None:
        self._scene = scene
        self._size = size
        self._contact = ContactSimulator(scene, swings, size, threads)

    def collect(self, hits: Hits) -> Outcomes:
        """Simulate any number of hits; the outcome of a hit does not depend on the others."""
        return self._all(hits, None)[0]

    def collect_with_tracks(self, hits: Hits, period: float) -> tuple[Outcomes, list[Array]]:
        """The same, and for each hit a track (rows, 4): t, x, y, yaw every `period` s to rest."""
        return self._all(hits, period)

    def _all(self, hits: Hits, period: float | None) -> tuple[Outcomes, list[Array]]:
        outcomes: list[Outcomes] = []
        tracks: list[Array] = []
        for begin in range(0, len(hits.swings), self._size):
            part = hits.rows(slice(begin, begin + self._size))
            launches = self._contact.launches(part)
            friction = np.stack([part.conditions[f"friction_{k}"] for k in ("x", "y", "torsional")], axis=1)
            radius = self._scene.info.object_radius
            rests, _ = slide(launches.states, friction, radius)
            outcomes.append(Outcomes(launches.times, launches.states, rests[:, :3], rests[:, 3]))
            if period is not None:
                tracks += self._tracks(launches, friction, rests, period)
        return Outcomes.joined(outcomes), tracks

    def _tracks(self, launches: Launches, friction: Array, rests: Array, period: float) -> list[Array]:
        control = self._scene.info.control_period
        fine = slide(
            launches.states, friction, self._scene.info.object_radius,
            control, int(rests[:, 3].max() / control) + 2,
        )[1]  # fmt: skip
        tracks = []
        for i in range(len(rests)):
            contact = launches.tracks[i][~np.isnan(launches.tracks[i][:, 0])]
            struck = control * (launches.begin[i] + np.arange(len(contact)))
            before = struck < launches.times[i]
            sliding = fine[i][: int(np.ceil(rests[i, 3] / control)) + 1]
            slid = launches.times[i] + control * np.arange(len(sliding))
            poses = np.concatenate([contact[before], sliding])
            known = np.concatenate([struck[before], slid])
            times = np.arange(0, slid[-1] + control, period)
            columns = [np.interp(times, known, poses[:, k]) for k in range(3)]
            tracks.append(np.column_stack([times, *columns]))
        return tracks
