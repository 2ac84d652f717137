"""Hits on the rig: the arm executes a motion, the blade strikes the object, the object slides to rest.

Arm, blade and object are simulated in MuJoCo from rest until blade and object have separated for good. From
there `slide` integrates the object's motion with the surface forces at every point of its support. On a flat
board with isotropic friction MuJoCo gives the same rest point within 2 mm, but more slowly.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import GRAVITY, Array
from slapshot.lab.blade import compile_rig, striker_pairs
from slapshot.lab.executed_trajectory import ExecutedPath
from slapshot.lab.hit_types import Hit, HitNoise, HitSpec, Launch
from slapshot.lab.release_detection import StrikerPath
from slapshot.lab.rig import Rig
from slapshot.lab.slide import slide
from slapshot.lab.surface import feel
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion

TIMESTEP = 2e-4  # s
SETTLE = 0.05  # s simulated after the motion's end
LONGEST_CONTACT = 0.5  # s after the motion's end by which blade and object have separated at the latest
FLAT = 1e-3  # m above the board: an object that is no higher counts as sliding
# m/s, largest vertical speed of an object that counts as sliding. An object may still hop when it is
# launched, and friction slows it only where it lands. From a launch with vertical speed w, the board's normal
# impulse over a time t is m (g t - w), whereas `slide` assumes m g t. This is exact for w = 0; for w = 5 cm/s
# the speed is wrong by mu w, or 1 %.
LEVEL = 0.01
MOVING = 0.01  # m/s: slower objects have not been hit yet
BATCH_SIZE = 64  # hits simulated together, which share the overhead of Python
_ROLLING = 1e-4  # placeholder: contacts of dimension 4 do not use it
_PLANAR = [0, 1, 3]  # x, y, yaw among x, y, z, yaw


class RigSimulator:
    """Simulates hits on the rig; the result of a hit depends neither on the other hits nor on `cores`."""

    def __init__(self, scene: Scene, rig: Rig, timestep: float = TIMESTEP, cores: int = 1) -> None:
        info = scene.info
        self._scene, self._rig, self._cores = scene, rig, cores
        self._ground = rig.ground
        self._model = model = compile_rig(scene, rig.striker, timestep, rig.edits)
        self._substeps = round(info.control_period / model.opt.timestep)
        self._arm = np.array([model.joint(name).qposadr[0] for name in info.joints])
        self._object_q = np.array([model.joint(name).qposadr[0] for name in info.object_joints])
        self._object_v = np.array([model.joint(name).dofadr[0] for name in info.object_joints])
        self._body = model.body(info.object_body).id
        self._pair = model.pair(info.object_pair).id
        self._striker_pairs = striker_pairs(model, scene)
        self._start = np.array(info.start)

    def hit(self, motion: Motion, object_id: str, chance: HitNoise) -> Hit:
        """Execute one motion on an object placed at the scene's start plus the start error."""
        return self.hits([HitSpec(motion, object_id, chance)])[0]

    def hits(self, strokes: Sequence[HitSpec], arm: bool = True) -> list[Hit]:
        """Execute hits; without `arm`, the joint trajectories end at the launch of the object."""
        return self.settle(strokes, self.launches(strokes, arm))

    def settle(self, strokes: Sequence[HitSpec], launches: Sequence[Launch]) -> list[Hit]:
        """Let launched objects slide to rest."""
        with ThreadPoolExecutor(self._cores) as pool:
            return list(pool.map(self._settle, strokes, launches))

    def _settle(self, stroke: HitSpec, launch: Launch) -> Hit:
        friction, period = self._friction(stroke), self._scene.info.control_period
        slid = slide(
            launch.state,
            (friction[0], friction[1], friction[2]),
            self._scene.info.object_radius,
            period,
            self._ground,
            launch.time,
        )
        # The launch is the last row of the first part and the first row of the second one.
        poses = np.concatenate([launch.track, slid.track[1:], slid.rest[None]])
        times = np.arange(len(poses)) * period
        times[-1] = end = launch.time + slid.duration
        return Hit(
            track=np.column_stack([times, poses]),
            joints=np.column_stack([np.arange(len(launch.joints)) * period, launch.joints]),
            launch_time=launch.time,
            launch=launch.state,
            rest=slid.rest,
            end=end,
        )

    def launches(self, strokes: Sequence[HitSpec], arm: bool = True) -> list[Launch]:
        """Simulate hits in MuJoCo up to the launch; with `arm`, up to the end of the motion."""
        found: list[Launch] = []
        for first in range(0, len(strokes), BATCH_SIZE):
            found += self._strike(strokes[first : first + BATCH_SIZE], arm)
        return found

    @cached_property
    def _batch(self) -> Batch:
        return Batch(self._model, nsim=BATCH_SIZE, nthread=self._cores)

    @cached_property
    def _qpos(self) -> Array:
        return self._batch.bind("qpos")

    @cached_property
    def _qvel(self) -> Array:
        return self._batch.bind("qvel")

    def _strike(self, strokes: Sequence[HitSpec], arm: bool) -> list[Launch]:
        """Launches of at most BATCH_SIZE hits."""
        info, period = self._scene.info, self._scene.info.control_period
        paths = [self._path(stroke) for stroke in strokes]
        ends = np.array([round((path.duration + SETTLE) / period) for path in paths])
        latest = np.array([round((path.duration + LONGEST_CONTACT) / period) for path in paths])
        targets = np.zeros((len(strokes), latest.max() + 1, len(info.joints)))
        for i, path in enumerate(paths):
            targets[i, : latest[i] + 1] = path.targets(latest[i] + 1, period, info.servo_time)
        strikers = [StrikerPath(self._scene, self._model, self._arm, path) for path in paths]
        friction = np.array([self._friction(stroke) for stroke in strokes])
        mass = np.array([self._rig.objects[stroke.object_id].mass for stroke in strokes])
        self._place(strokes, paths, strikers, mass)

        batch, rows = self._batch, np.arange(len(strokes))
        qpos, ctrl = self._qpos, batch.bind("ctrl")
        joints = np.full((len(strokes), latest.max() + 1, len(info.joints)), np.nan)
        poses = np.full((len(strokes), latest.max() + 1, 3), np.nan)
        launched = np.full(len(strokes), -1)
        states = self._states(rows)
        final = states.copy()
        joints[:, 0], poses[:, 0] = qpos[rows[:, None], self._arm], states[:, :3]
        same_everywhere = not any(map(len, self._ground))
        tick = 0
        while len(rows):
            ctrl[rows, : len(info.joints)] = targets[rows, tick]
            if tick == 0 or not same_everywhere:
                hardest = self._feel(rows, states[rows], tick * period, mass, friction)
            batch.step(ids=rows, nstep=self._substeps)
            tick += 1
            joints[rows, tick] = qpos[rows[:, None], self._arm]
            states[rows] = self._states(rows)
            poses[rows, tick] = states[rows, :3]
            candidates = rows[self._lies_flat(rows, states[rows]) & (launched[rows] < 0)]
            for i in candidates.tolist():
                if strikers[i].misses(states[i], tick * period, hardest[i]):
                    launched[i], final[i] = tick, states[i]
            lost = rows[(launched[rows] < 0) & (tick >= latest[rows])]
            launched[lost], final[lost] = tick, states[lost]
            rows = rows[(launched[rows] < 0) | (arm & (tick < ends[rows]))]
        return [
            Launch(poses[i, : launched[i] + 1], _cut(joints[i], ends[i], launched[i], arm),
                   launched[i] * period, final[i])
            for i in range(len(strokes))
        ]  # fmt: skip

    def _path(self, stroke: HitSpec) -> ExecutedPath:
        chance = stroke.chance
        return ExecutedPath(
            stroke.motion,
            chance.pace,
            chance.joint_offset,
            self._rig.delay(chance.quirk),
            self._rig.filters,
            self._rig.settling,
        )

    def _friction(self, stroke: HitSpec) -> Array:
        """(3,) coefficients of friction along x and along y, and torsional friction in m."""
        truth = self._rig.objects[stroke.object_id]
        factor = stroke.chance.friction * self._rig.friction_factor(stroke.place)
        return factor * np.array((truth.friction_x, truth.friction_y, truth.friction_torsional))

    def _place(
        self,
        strokes: Sequence[HitSpec],
        paths: Sequence[ExecutedPath],
        strikers: Sequence[StrikerPath],
        mass: Array,
    ) -> None:
        """Set the initial state at rest: arms at the start of their paths, objects with start errors."""
        batch, model, rows = self._batch, self._model, np.arange(len(strokes))
        scale = mass / model.body_mass[self._body]
        batch.expand("body_mass")[rows, self._body] = model.body_mass[self._body] * scale
        inertia = model.body_inertia[self._body] * scale[:, None]
        batch.expand("body_inertia")[rows, self._body] = inertia
        batch.set_const(ids=rows)  # updates the subtree masses that gravity acts on
        if self._rig.bounces:
            solref = batch.expand("pair_solref")
            for i, striker in enumerate(strikers):
                speed = striker.speed_at(self._start)
                for pair in self._striker_pairs:
                    solref[i, pair] = self._rig.bounce(model.pair_solref[pair], speed)
        batch.reset(ids=rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        qpos = self._qpos
        qpos[rows[:, None], self._arm] = [path.position(np.zeros(1))[0] for path in paths]
        qpos[rows[:, None], self._object_q[:2]] = [stroke.chance.start_error for stroke in strokes]
        qpos[rows, self._object_q[3]] = [self._rig.yaw(stroke.chance.quirk) for stroke in strokes]

    def _states(self, rows: NDArray[np.int64]) -> Array:
        """(rows, 6) x, y (m, world frame), yaw (rad), vx, vy (m/s), spin (rad/s) of objects."""
        columns = rows[:, None]
        state = np.concatenate(
            [self._qpos[columns, self._object_q[_PLANAR]], self._qvel[columns, self._object_v[_PLANAR]]],
            axis=1,
        )
        state[:, :2] += self._start
        return state

    def _lies_flat(self, rows: NDArray[np.int64], states: Array) -> NDArray[np.bool_]:
        """(rows,) whether objects have been hit and no longer hop."""
        height, rising = self._qpos[rows, self._object_q[2]], self._qvel[rows, self._object_v[2]]
        speed = np.hypot(states[:, 3], states[:, 4])
        return (np.abs(height) <= FLAT) & (np.abs(rising) <= LEVEL) & (speed >= MOVING)

    def _feel(
        self, rows: NDArray[np.int64], states: Array, now: float, mass: Array, friction: Array
    ) -> Array:
        """Apply the local surface forces to objects; return their largest deceleration, (strokes,) m/s^2."""
        mean = np.sqrt(friction[rows, 0] * friction[rows, 1])
        forces, factors = np.empty((len(rows), 4)), np.empty((len(rows), 2))
        feel(self._ground, states, np.full(len(rows), now), mean, forces, factors)
        mass = mass[rows, None]
        applied = -mass * GRAVITY * forces[:, :2] + mass * forces[:, 2:]
        qfrc = self._batch.bind("qfrc_applied")
        qfrc[rows[:, None], self._object_v[:2]] = applied
        if len(self._ground.centres):  # body forces act on the centre of mass
            yaw, (out_x, out_y, _) = states[:, 2], self._ground.centres[0]
            ox = np.cos(yaw) * out_x - np.sin(yaw) * out_y
            oy = np.sin(yaw) * out_x + np.cos(yaw) * out_y
            qfrc[rows, self._object_v[3]] = ox * applied[:, 1] - oy * applied[:, 0]
        pair = self._batch.expand("pair_friction")
        along = friction[rows] * np.exp(factors[:, :1]) * factors[:, 1:]
        # Tangent 1 of a horizontal contact is the world's y axis.
        pair[rows, self._pair, :3] = along[:, [1, 0, 2]]
        pair[rows, self._pair, 3:] = _ROLLING
        hardest = np.zeros(len(friction))
        hardest[rows] = GRAVITY * friction[rows, :2].max(1) * factors[:, 1]
        hardest[rows] += np.hypot(forces[:, 2], forces[:, 3])
        return hardest


def _cut(joints: Array, end: int, launched: int, arm: bool) -> Array:
    return joints[: end + 1] if arm else joints[: launched + 1]
