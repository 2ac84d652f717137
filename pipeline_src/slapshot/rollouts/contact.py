"""The contact phase: from just before the striker touches the object until it can no longer touch it.

Only in this phase is the whole arm simulated, for each hit under its own condition. The arm's initial state
comes from the swing, which was simulated once without the object.
"""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.rollouts.hits import Hits
from slapshot.rollouts.hop import hop
from slapshot.rollouts.reach import first_within, has_parted
from slapshot.scenes.scene import Scene, pair_friction
from slapshot.trajectories.swings import Swings

LEAD = 1  # ticks before the striker is within reach of the object
REACH = 0.001  # m
SETTLING = 0.1  # s, twenty time constants of the contact with the plane
LOOK_AHEAD_EVERY = 5  # ticks between the future times that are checked
MISS_DISTANCE = 0.001  # m, clearance of striker and object at which the contact phase ends
# A striker whose face is tilted downwards presses the object onto the plane, and the rest point is sensitive
# to every instant of that: with the scene's step rest points are off by 23 mm in the median, with half of it
# by 7 mm. Therefore the step is divided by FINER where the z component of the face's normal is below DOWN.
DOWN = -0.025
FINER = 2
# Ticks, duration of an impact. One object in eleven is still being pushed afterwards, for which one step per
# control period suffices: the median and the 90 % quantile of errors change by at most 0.1 and 0.2 mm.
BLOW = 24


@dataclass(frozen=True)
class Launches:
    """State of the object when it leaves the striker, or when it has landed if the striker lifted it.

    Attributes:
        times: (n,) s since the swing's start.
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s); x and y in the world frame.
        begin: (n,) tick at which the contact phase began.
        tracks: (n, ticks, 3) x, y, yaw every control period from `begin` to the end of the contact phase; the
            remaining rows of a hit are NaN. From there the object moves in a straight line to its launch.
    """

    times: Array
    states: Array
    begin: NDArray[np.int64]
    tracks: Array


class ContactSimulator:
    """Simulates contact phases of up to `size` hits at a time, on all threads."""

    def __init__(self, scene: Scene, swings: Swings, size: int, threads: int) -> None:
        self._scene, self._swings = scene, swings
        self._model = scene.compile()
        self._substeps = round(scene.info.control_period / self._model.opt.timestep)
        # Joints other than the robot's and the object's model compliance or backlash and need the scene's
        # step.
        joints = len(scene.info.joints) + len(scene.info.object_joints)
        self._pushed_substeps = 1 if self._model.njnt == joints else self._substeps
        self._batch = Batch(self._model, nsim=size, nthread=threads)
        self._mass = self._batch.expand("body_mass")
        self._inertia = self._batch.expand("body_inertia")
        self._friction = self._batch.expand("pair_friction")
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._ctrl = self._batch.bind("ctrl")
        self._timestep = self._batch.expand("opt.timestep")

    def launches(self, hits: Hits) -> Launches:
        """Simulate at most `size` hits."""
        count = len(hits.swings)
        begin = self._place(hits)
        info = self._scene.info
        targets, ids = self._swings.targets, np.arange(count)
        leans = self._swings.normal[hits.swings, begin, 2] < DOWN
        substeps = np.where(leans, FINER, 1) * self._substeps
        track = [self._pose(ids)[:, :3]]
        tick = begin.copy()
        while len(ids):
            now = np.minimum(tick[ids], targets.shape[1] - 1)
            self._ctrl[ids, : targets.shape[2]] = targets[hits.swings[ids], now]
            if len(track) > BLOW:
                substeps[ids] = self._pushed_substeps
            self._timestep[ids] = info.control_period / substeps[ids]
            for number in np.unique(substeps[ids]).tolist():
                self._batch.step(ids=ids[substeps[ids] == number], nstep=number)
            tick[ids] += 1
            track.append(np.full((count, 3), np.nan))
            track[-1][ids] = self._pose(ids)[:, :3]
            ids = ids[~self._is_over(ids, tick[ids], hits)]
        states, flights = self._landed(hits)
        tracks = np.stack(track, axis=1)
        for places in (states, tracks):
            places[..., :2] += np.array(info.start)
        return Launches(tick * info.control_period + flights, states, begin, tracks)

    @cached_property
    def _settled(self) -> float:
        """Height in m of an object at rest, which penetrates the plane by its weight."""
        data = mujoco.MjData(self._model)
        mujoco.mj_step(self._model, data, round(SETTLING / self._model.opt.timestep))
        return float(data.qpos[self._scene.layout.object_q[2]])

    def _landed(self, hits: Hits) -> tuple[Array, Array]:
        """(n, 6) states relative to the start once the objects have landed, and (n,) s until then."""
        ids, layout = np.arange(len(hits.swings)), self._scene.layout
        heights, rising = self._qpos[ids, layout.object_q[2]], self._qvel[ids, layout.object_v[2]]
        frictions = np.stack([hits.conditions[f"friction_{k}"] for k in ("x", "y", "torsional")], axis=1)
        return hop(self._pose(ids), heights, rising, frictions, self._scene.info.object_radius)

    def _place(self, hits: Hits) -> NDArray[np.int64]:
        """Set masses, friction and initial states; return the tick at which each hit begins."""
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

        info, window = self._scene.info, swings.positions.shape[1]
        middles = np.column_stack(
            [
                hits.start_errors + np.array(info.start),
                np.full(count, info.plane_height + info.object_height / 2),
            ]
        )
        within = first_within(
            hits.swings, swings.first, window, swings.striker, swings.normal, middles,
            info.striker_half_thickness, info.object_radius, info.object_height, REACH,
        )  # fmt: skip
        first = swings.first[hits.swings]
        at = np.clip(within - first - LEAD, 0, None)
        self._qpos[np.ix_(ids, layout.arm_q)] = swings.positions[hits.swings, at]
        self._qvel[np.ix_(ids, layout.arm_v)] = swings.velocities[hits.swings, at]
        self._qpos[np.ix_(ids, layout.object_q[:2])] = hits.start_errors
        self._qpos[ids, layout.object_q[2]] = self._settled
        return first + at

    def _pose(self, ids: NDArray[np.int64]) -> Array:
        """(ids, 6): x, y relative to the start, yaw, vx, vy, spin."""
        layout = self._scene.layout
        planar = [0, 1, 3]
        position = self._qpos[np.ix_(ids, layout.object_q[planar])]
        return np.concatenate([position, self._qvel[np.ix_(ids, layout.object_v[planar])]], axis=1)

    def _is_over(self, ids: NDArray[np.int64], tick: NDArray[np.int64], hits: Hits) -> NDArray[np.bool_]:
        """Which objects the striker cannot touch for the rest of its swing."""
        swings, info = self._swings, self._scene.info
        states = self._pose(ids)
        states[:, :2] += np.array(info.start)
        parted = has_parted(
            hits.swings[ids], tick, info.control_period, swings.striker, swings.normal, states,
            -self._qvel[ids, self._scene.layout.object_v[2]],
            np.maximum(hits.conditions["friction_x"][ids], hits.conditions["friction_y"][ids]),
            info.striker_half_thickness + info.object_radius, MISS_DISTANCE, LOOK_AHEAD_EVERY,
        )  # fmt: skip
        finished = tick >= swings.targets.shape[1] + round(0.2 / info.control_period)
        return parted | finished
