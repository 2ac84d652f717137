"""Fast simulation of hits: cached swing, contact with the whole robot, then the puck alone until it rests.

The collector leaves out bodies that can no longer touch the puck, and slides it on a plane in place of the
table's box. Rest points differ from the environment's, because the environment's contacts are chaotic:
shifting the puck by a nanometre moves its rest point by half a millimetre in the median and by a centimetre
at worst. The collector's differ from the environment's about as much; the plane, on which a step takes two
thirds of the time, alone moves them by .2 mm in the median and by less than 2 mm.
"""

from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.domains.fetchslide.execution import CLEAR, REACH
from slapshot.domains.fetchslide.gripper import Grippers
from slapshot.domains.fetchslide.model import (
    CONTROL_PERIOD,
    OBJECT,
    OBJECT_JOINT,
    SUBSTEPS,
    TABLE,
    TABLE_HALF,
    TABLE_MIDDLE,
)
from slapshot.rollouts.hits import Hits, Outcomes
from slapshot.rollouts.reach import has_parted
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import Swings

Rows = NDArray[np.int64]

BATCH = 256  # hits simulated together
AT_REST = 2e-3  # m/s and rad/s
PYRAMID = 2**0.5  # ratio of a pyramidal cone's friction along its edges to that along its axes
MARGIN = 0.005  # m, clearance at which the contact phase ends; heavy pucks deflect the gripper by less
LONGEST = 250  # control periods of a slide


class Collector:
    """Simulates hits with one pool of swings; friction_x is the linear friction, and mass is not used."""

    def __init__(self, scene: Scene, swings: Swings, threads: int, size: int = BATCH) -> None:
        self._swings, self._size = swings, size
        self._robots = Grippers(scene, size, threads)
        self._table = PucksAlone(scene, size, threads)

    def collect(self, hits: Hits) -> Outcomes:
        """Simulate any number of hits; the outcome of a hit does not depend on the others."""
        return self.collect_with_tracks(hits, CONTROL_PERIOD)[0]

    def collect_with_tracks(self, hits: Hits, period: float) -> tuple[Outcomes, list[Array]]:
        """The same, and for each hit a track (rows, 4): t, x, y, yaw every `period` s to rest."""
        outcomes: list[Outcomes] = []
        tracks: list[Array] = []
        for begin in range(0, len(hits.swings), self._size):
            part = hits.rows(slice(begin, begin + self._size))
            outcome, poses = self._collect(part)
            outcomes.append(outcome)
            tracks += [_sampled(track, period) for track in poses]
        return Outcomes.joined(outcomes), tracks

    def _collect(self, hits: Hits) -> tuple[Outcomes, list[Array]]:
        """Simulate at most `size` hits; also returns poses (periods, 3) x, y, yaw of each, start to rest."""
        swings, count = self._swings, len(hits.swings)
        ids = np.arange(count)
        places = swings.starts[hits.swings] + hits.start_errors
        friction = np.stack([hits.conditions[f"friction_{k}"] for k in ("x", "torsional", "rolling")], axis=1)
        self._robots.reset(ids, places, friction)
        rows = hits.swings
        near = self._last_clear(rows, places)
        self._robots.restore(ids, swings.positions[rows, near], swings.velocities[rows, near])
        began, ticks = swings.first[rows] + near, swings.targets.shape[1]
        first = int(began.min())
        before = np.repeat(_planar(self._robots.pucks(ids)[0])[:, None], ticks, axis=1)
        pushed = before[:, first:].copy()
        poses, velocities, parted_at = np.empty((count, 7)), np.empty((count, 6)), np.full(count, ticks)
        parted = np.zeros(count, bool)
        for tick in range(first, ticks + 1):
            ids = np.flatnonzero((began <= tick) & ~parted)
            poses[ids], velocities[ids] = self._robots.pucks(ids)
            gone = self._has_parted(rows[ids], tick, poses[ids], velocities[ids], friction[ids, 0])
            parted_at[ids[gone]], parted[ids[gone]] = tick, True
            ids = ids[~gone]
            if tick == ticks or parted.all():
                break
            pushed[ids, tick - first] = _planar(poses[ids])
            self._robots.command(ids, swings.targets[rows[ids], tick])
        before, ids = before[:, :first], np.arange(count)
        slid, periods = self._table.slide(poses, velocities, friction)
        launches = np.concatenate([_planar(poses), velocities[:, :2], velocities[:, 5:]], axis=1)
        outcomes = Outcomes(
            launch_times=parted_at * CONTROL_PERIOD,
            launches=launches,
            rests=slid[ids, periods],
            durations=periods.astype(np.float64) * CONTROL_PERIOD,
        )
        return outcomes, [
            np.concatenate([before[i], pushed[i, : parted_at[i] - first], slid[i, : periods[i] + 1]])
            for i in range(count)
        ]

    def _last_clear(self, swings: Rows, places: Array) -> Rows:
        """(n,) number of the last state that was kept in which no gripper has come near its puck."""
        first, window = self._swings.first[swings], self._swings.positions.shape[1]
        ticks = first[:, None] + np.arange(window)
        grip = self._swings.striker[swings[:, None], ticks, :2]
        near = np.linalg.norm(grip - places[:, None], axis=2) <= REACH + CLEAR
        return np.where(near.any(1), np.maximum(near.argmax(1) - 1, 0), window - 1)

    def _has_parted(
        self, swings: Rows, tick: int, poses: Array, velocities: Array, friction: Array
    ) -> NDArray[np.bool_]:
        """Which pucks the gripper will not touch again if it follows its path without a puck."""
        states = np.concatenate([_planar(poses), velocities[:, :2], velocities[:, 5:]], axis=1)
        return has_parted(
            swings, np.full(len(swings), tick), CONTROL_PERIOD, self._swings.striker, self._swings.normal,
            states, -velocities[:, 2], PYRAMID * friction, REACH, MARGIN, 1,
        )  # fmt: skip


class PucksAlone:
    """Simulates the same puck with the same steps, without the robot, once it is out of reach.

    The table is the plane of its top, which pucks leave where their middle does.
    """

    def __init__(self, scene: Scene, size: int, threads: int) -> None:
        self._model = _puck_on_plane(scene)
        self._batch = Batch(self._model, nsim=size, nthread=threads)
        self._friction = self._batch.expand("geom_friction")
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")

    @cached_property
    def _geoms(self) -> list[int]:
        return [self._model.geom(name).id for name in (OBJECT, TABLE)]

    def slide(self, poses: Array, velocities: Array, friction: Array) -> tuple[Array, Rows]:
        """Let pucks slide to rest.

        Args:
            poses: (n, 7).
            velocities: (n, 6).
            friction: (n, 3) linear, torsional, rolling.

        Returns:
            (n, periods + 1, 3) x, y, yaw at the start and after each control period; (n,) the number of
            periods until the puck is at rest or leaves the table.
        """
        count = len(poses)
        ids = np.arange(count)
        self._batch.reset(ids=ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[:count], self._qvel[:count] = poses, velocities
        for geom in self._geoms:
            self._friction[:count, geom] = friction
        seen = [_planar(poses)]
        periods = np.zeros(count, np.int64)
        while len(ids) and len(seen) <= LONGEST:
            self._batch.step(ids=ids, nstep=SUBSTEPS)
            seen.append(seen[-1].copy())
            aside = np.abs(self._qpos[ids, :2] - np.array(TABLE_MIDDLE))
            ids = ids[(aside <= np.array(TABLE_HALF)).all(1)]
            seen[-1][ids] = _planar(self._qpos[ids])
            periods[ids] = len(seen) - 1
            ids = ids[np.abs(self._qvel[ids]).max(1) > AT_REST]
        return np.stack(seen, axis=1), periods


def _puck_on_plane(scene: Scene) -> mujoco.MjModel:
    """The scene's puck, and its table as a plane."""
    spec = scene.spec()
    for equality in list(spec.equalities):
        spec.delete(equality)
    for exclude in list(spec.excludes):
        spec.delete(exclude)
    for body in list(spec.worldbody.bodies):
        if body.name.startswith("robot0:"):
            spec.delete(body)
    spec.delete(spec.geom("floor0"))
    table = spec.geom(TABLE)
    table.pos = np.array(table.pos) + np.array([0, 0, table.size[2]])
    table.type = mujoco.mjtGeom.mjGEOM_PLANE
    model = spec.compile()
    # One body is one island of constraints; looking for others is a tenth of a step.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    if model.joint(OBJECT_JOINT).qposadr[0] != 0 or model.nv != 6:
        raise AssertionError("something other than the puck moves")
    return model


def _planar(poses: Array) -> Array:
    """(n, 3) x, y (m) and yaw (rad) of poses (n, 7) with quaternions w, x, y, z."""
    w, x, y, z = poses[:, 3:].T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    return np.column_stack([poses[:, :2], yaw])


def _sampled(poses: Array, period: float) -> Array:
    """(rows, 4) t, x, y, yaw every `period` s, from poses at control periods; the last row is at rest."""
    times = np.arange(0.0, len(poses) * CONTROL_PERIOD, period)
    rows = np.minimum(np.round(times / CONTROL_PERIOD).astype(int), len(poses) - 1)
    return np.column_stack([times, poses[rows]])
