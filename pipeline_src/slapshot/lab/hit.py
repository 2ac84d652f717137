"""Hits on the rig: the arm executes a motion, the blade strikes the object, the object slides to rest.

Arm, blade and object are simulated in MuJoCo from rest until blade and object have separated for good. From
there `slide` integrates the object's motion with the surface forces at every point of its support. On a flat
board with isotropic friction MuJoCo gives the same rest point within 2 mm, but more slowly.

A flexible blade needs time steps of 0.05 ms, but bends only where it strikes. Until shortly before it reaches
the object, and after it has parted from it, it is simulated as rigid, in long steps of fourth order.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.lab.blade import compile_rig
from slapshot.lab.executed_trajectory import ExecutedPath
from slapshot.lab.hit_types import Hit, HitNoise, HitSpec, Launch
from slapshot.lab.release_detection import StrikerPath
from slapshot.lab.rig import Rig
from slapshot.lab.rig_batch import BATCH_SIZE, RigBatch, Rows
from slapshot.lab.slide import slide
from slapshot.scenes.scene import Scene, SceneInfo
from slapshot.trajectories.motion import Motion

TIMESTEP = 2e-4  # s
SETTLE = 0.05  # s simulated after the motion's end
LONGEST_CONTACT = 0.5  # s after the motion's end by which blade and object have separated at the latest
# s before the executed path reaches the object from which on a flexible blade bends. The arm is ahead of its
# path by less, and what vibrates because bending starts there is damped out by then.
NEAR = 0.03


class RigSimulator:
    """Simulates hits on the rig; the result of a hit depends neither on the other hits nor on `cores`."""

    def __init__(self, scene: Scene, rig: Rig, timestep: float = TIMESTEP, cores: int = 1) -> None:
        info = scene.info
        self._scene, self._rig, self._cores = scene, rig, cores
        self._contact = RigBatch(scene, rig, compile_rig(scene, rig.striker, timestep, rig.edits), cores)
        self._free = self._contact
        # A hidden effect is compared with what happens without it, in the same steps; and edits may hide
        # springs and stops in joints, for which long steps are not stable.
        if rig.blade is not None and not rig.edits:
            rigid = scene.compile(info.control_period)
            rigid.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
            self._free = RigBatch(scene, rig, rigid, cores)
        self._arm = np.array([self._free.model.joint(name).qposadr[0] for name in info.joints])
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
            self._rig.ground,
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

    def _strike(self, strokes: Sequence[HitSpec], arm: bool) -> list[Launch]:
        """Launches of at most BATCH_SIZE hits."""
        period, rows = self._scene.info.control_period, np.arange(len(strokes))
        paths = [self._path(stroke) for stroke in strokes]
        strikers = [StrikerPath(self._scene, self._free.model, self._arm, path) for path in paths]
        motion = _Executed(paths, self._scene.info)
        self._place(strokes, paths, strikers)
        motion.read(0, rows, self._free)

        near = np.array([self._near(*each) for each in zip(strikers, strokes, strict=True)])
        for _ in motion.ticks(self._free, np.zeros_like(near), near):
            pass
        self._contact.take_over(rows, self._free)
        released = np.array([round((path.duration + LONGEST_CONTACT) / period) for path in paths])
        for tick, moving in motion.ticks(self._contact, near, released):
            sliding = moving[self._contact.slides(moving)]
            for i, state in zip(sliding.tolist(), self._contact.states(sliding), strict=True):
                if strikers[i].misses(state, tick * period, self._contact.hardest(i)):
                    released[i] = tick
        launches = self._contact.released(rows)
        ends = released
        if arm:
            ends = np.array([round((path.duration + SETTLE) / period) for path in paths])
            self._free.take_over(rows, self._contact)
            for _ in motion.ticks(self._free, released, ends):
                pass
        return [
            Launch(
                motion.poses[i, : released[i] + 1],
                motion.joints[i, : ends[i] + 1],
                released[i] * period,
                launches[i],
            )
            for i in rows
        ]

    def _near(self, striker: StrikerPath, stroke: HitSpec) -> int:
        """Number of control periods before the blade is near the object."""
        early = striker.time_at(self._start + stroke.chance.start_error) - NEAR
        return max(0, int(early / self._scene.info.control_period))

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
        self, strokes: Sequence[HitSpec], paths: Sequence[ExecutedPath], strikers: Sequence[StrikerPath]
    ) -> None:
        """Set the initial state at rest: arms at the start of their paths, objects with start errors."""
        mass = np.array([self._rig.objects[stroke.object_id].mass for stroke in strokes])
        friction = np.array([self._friction(stroke) for stroke in strokes])
        speed = [striker.speed_at(self._start) for striker in strikers]
        for batch in dict.fromkeys((self._free, self._contact)):
            batch.reset(mass, friction, speed)
        self._free.place(
            np.array([path.position(np.zeros(1))[0] for path in paths]),
            np.array([stroke.chance.start_error for stroke in strokes]),
            np.array([self._rig.yaw(stroke.chance.quirk) for stroke in strokes]),
        )


class _Executed:
    """Commands of some hits, and how arm and object move: (hits, ticks) joints and poses."""

    def __init__(self, paths: Sequence[ExecutedPath], info: SceneInfo) -> None:
        self._period = info.control_period
        ticks = [round((path.duration + LONGEST_CONTACT) / self._period) for path in paths]
        self._targets = np.zeros((len(paths), max(ticks) + 1, len(info.joints)))
        for i, path in enumerate(paths):
            self._targets[i, : ticks[i] + 1] = path.targets(ticks[i] + 1, self._period, info.servo_time)
        self.joints = np.full(self._targets.shape, np.nan)  # rad
        self.poses = np.full((*self._targets.shape[:2], 3), np.nan)  # x, y in m, yaw in rad

    def ticks(self, batch: RigBatch, first: Rows, last: Rows) -> Iterator[tuple[int, Rows]]:
        """Simulate each hit from its tick `first` to its tick `last`, which may be lowered on the way.

        Yields:
            every tick that is reached, and the hits that have.
        """
        tick = int(first.min())
        while tick < last.max():
            rows = np.flatnonzero((first <= tick) & (tick < last))
            if len(rows):
                batch.step(rows, self._targets[rows, tick], tick * self._period)
            tick += 1
            if len(rows):
                self.read(tick, rows, batch)
                yield tick, rows

    def read(self, tick: int, rows: Rows, batch: RigBatch) -> None:
        """Note where arm and object are."""
        self.joints[rows, tick] = batch.joints(rows)
        self.poses[rows, tick] = batch.states(rows)[:, :3]
