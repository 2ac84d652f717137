"""The contact phase: from just before the striker touches the object until it cannot touch it again.

Only here is the whole arm simulated, for each hit under its own condition. The arm's state at the start
comes from the swing, which was simulated once without the object.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import GRAVITY, Array
from slapshot.rollouts.hits import Hits
from slapshot.scenes.scene import Scene, pair_friction
from slapshot.trajectories.execution import striker_gap
from slapshot.trajectories.swings import Swings

LEAD = 1  # ticks before the striker is within reach of the object
REACH = 0.003  # m
CHECK_EVERY = 3  # ticks between looks at which hits are over
LOOK_AHEAD_EVERY = 5  # ticks between the moments of the future that a look considers
MISS_DISTANCE = 0.003  # m by which the striker must miss the object for good
# A hop is over when the object is this near the plane (m) and this slow (m/s) across it. Looser hands over
# objects that still rise, whose next landing takes speed; at 0.01 errors halve and hits take a tenth longer.
FLAT, SETTLED = 1e-3, 0.02


@dataclass(frozen=True)
class Launches:
    """How the object leaves the striker.

    Attributes:
        times: (n,) s since the swing's start.
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s), x and y in the world.
        begin: (n,) tick at which the contact phase began.
        tracks: (n, ticks, 3) x, y, yaw one a control period since `begin`; a hit's rows past its
            launch are NaN.
    """

    times: Array
    states: Array
    begin: NDArray[np.int64]
    tracks: Array


class ContactSimulator:
    """Simulates contact phases of up to `size` hits at a time, on all threads."""

    def __init__(self, scene: Scene, swings: Swings, size: int, threads: int) -> None:
        self._scene, self._swings, self._size = scene, swings, size
        self._model = scene.compile()
        self._substeps = round(scene.info.control_period / self._model.opt.timestep)
        self._batch = Batch(self._model, nsim=size, nthread=threads)
        self._mass = self._batch.expand("body_mass")
        self._inertia = self._batch.expand("body_inertia")
        self._friction = self._batch.expand("pair_friction")
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._ctrl = self._batch.bind("ctrl")

    def launches(self, hits: Hits) -> Launches:
        """Simulate at most `size` hits."""
        count = len(hits.swings)
        begin = self._place(hits)
        info = self._scene.info
        ticks = self._swings.targets.shape[1]
        ids = np.arange(count)
        targets = self._swings.targets[hits.swings]
        states, times = np.empty((count, 6)), np.empty(count)
        track: list[Array] = []
        tick = begin.copy()
        while len(ids):
            track.append(np.full((count, 3), np.nan))
            track[-1][ids] = self._pose(ids)[:, :3]
            self._ctrl[ids, : targets.shape[2]] = targets[ids, np.minimum(tick[ids], ticks - 1)]
            self._batch.step(ids=ids, nstep=self._substeps)
            tick[ids] += 1
            if len(track) % CHECK_EVERY == 0:
                over = self._is_over(ids, tick[ids], hits)
                done = ids[over]
                states[done], times[done] = self._pose(done), tick[done] * info.control_period
                ids = ids[~over]
        start = np.array(info.start)
        states[:, :2] += start
        tracks = np.stack(track, axis=1)
        tracks[:, :, :2] += start
        return Launches(times, states, begin, tracks)

    def _place(self, hits: Hits) -> NDArray[np.int64]:
        """Set masses, friction and state; return the tick at which each hit begins."""
        layout, swings, count = self._scene.layout, self._swings, len(hits.swings)
        body = layout.object_body
        mass = hits.conditions["mass"]
        self._inertia[:count, body] = (
            self._model.body_inertia[body] * (mass / self._model.body_mass[body])[:, None]
        )
        self._mass[:count, body] = mass
        self._friction[:count, layout.object_pair] = np.stack(pair_friction(hits.conditions), axis=1)
        ids = np.arange(count)
        self._batch.set_const(ids=ids)
        self._batch.reset(ids=ids, stage=mujoco.mjtStage.mjSTAGE_NONE)

        window = swings.positions.shape[1]
        rows = swings.first[hits.swings][:, None] + np.arange(window)
        gap = striker_gap(
            self._scene,
            np.take_along_axis(swings.striker[hits.swings], rows[:, :, None], 1),
            np.take_along_axis(swings.normal[hits.swings], rows[:, :, None], 1),
            hits.start_errors + np.array(self._scene.info.start),
        )
        within = gap < REACH
        at = np.where(within.any(1), within.argmax(1), window - 1) - LEAD
        at = np.clip(at, 0, None)
        self._qpos[np.ix_(ids, layout.arm_q)] = swings.positions[hits.swings, at]
        self._qvel[np.ix_(ids, layout.arm_v)] = swings.velocities[hits.swings, at]
        self._qpos[np.ix_(ids, layout.object_q[:2])] = hits.start_errors
        return swings.first[hits.swings] + at

    def _pose(self, ids: NDArray[np.int64]) -> Array:
        """(ids, 6): x, y relative to the start, yaw, vx, vy, spin."""
        layout = self._scene.layout
        planar = [0, 1, 3]
        position = self._qpos[np.ix_(ids, layout.object_q[planar])]
        return np.concatenate([position, self._qvel[np.ix_(ids, layout.object_v[planar])]], axis=1)

    def _is_over(self, ids: NDArray[np.int64], tick: NDArray[np.int64], hits: Hits) -> NDArray[np.bool_]:
        """Which hits are flat on the plane and out of the striker's reach for the rest of its swing."""
        layout, info = self._scene.layout, self._scene.info
        height = self._qpos[ids, layout.object_q[2]]
        rising = self._qvel[ids, layout.object_v[2]]
        over = (np.abs(height) < FLAT) & (np.abs(rising) < SETTLED)
        # Two looks, because the future is costly: who is out of reach now, and of those, who stays so.
        for ahead in (np.zeros(1, int), np.arange(0, self._swings.targets.shape[1], LOOK_AHEAD_EVERY)):
            rows = np.flatnonzero(over)
            over[rows] = self._least_gap(ids[rows], tick[rows], hits, ahead) > MISS_DISTANCE
        finished = tick >= self._swings.targets.shape[1] + round(0.2 / info.control_period)
        return over | finished

    def _least_gap(
        self, ids: NDArray[np.int64], tick: NDArray[np.int64], hits: Hits, ahead: NDArray[np.int64]
    ) -> Array:
        """(ids,) smallest distance in m between striker and object at the ticks `ahead`.

        The object is slowed as hard as friction can; the striker goes on as it did without object.
        """
        swings, info = self._swings, self._scene.info
        future = np.minimum(tick[:, None] + ahead, swings.targets.shape[1] - 1)
        which = hits.swings[ids][:, None]
        striker = swings.striker[which, future][:, :, :2]
        normal = swings.normal[which, future][:, :, :2]
        normal = normal / np.linalg.norm(normal, axis=2, keepdims=True)
        pose = self._pose(ids)
        place = pose[:, :2] + np.array(info.start)
        speed = np.linalg.norm(pose[:, 3:5], axis=1)
        hardest = GRAVITY * np.maximum(hits.conditions["friction_x"][ids], hits.conditions["friction_y"][ids])
        time = np.minimum(ahead * info.control_period, (speed / hardest)[:, None])
        share = time - hardest[:, None] * time**2 / (2 * np.maximum(speed, 1e-9))[:, None]
        object_ahead = place[:, None] + pose[:, None, 3:5] * share[:, :, None]
        gap = ((object_ahead - striker) * normal).sum(2)
        return gap.min(1) - info.striker_half_thickness - info.object_radius
