"""Hits side by side in MuJoCo: a batch of simulations of arm, blade and object, and their state."""

from collections.abc import Sequence
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import GRAVITY, Array
from slapshot.lab.blade import striker_pairs
from slapshot.lab.rig import Rig
from slapshot.lab.surface import feel
from slapshot.scenes.scene import Scene

Rows = NDArray[np.int64]

BATCH_SIZE = 64  # hits simulated together, which share the overhead of Python
FLAT = 1e-3  # m above the board: an object that is no higher counts as sliding
# m/s, largest vertical speed of an object that counts as sliding. An object may still hop when it is
# launched, and friction slows it only where it lands: `released` accounts for what is left.
LEVEL = 0.01
MOVING = 0.01  # m/s: slower objects have not been hit yet
_ROLLING = 1e-4  # placeholder: contacts of dimension 4 do not use it
_PLANAR = [0, 1, 3]  # x, y, yaw among x, y, z, yaw


class RigBatch:
    """At most BATCH_SIZE hits, each a row, on one model of arm, blade and object."""

    def __init__(self, scene: Scene, rig: Rig, model: mujoco.MjModel, cores: int) -> None:
        self.model = model
        self._cores, self._rig, self._ground = cores, rig, rig.ground
        info = scene.info
        self._substeps = round(info.control_period / model.opt.timestep)
        self._period = info.control_period
        self._arm = np.array([model.joint(name).qposadr[0] for name in info.joints])
        self._object_q = np.array([model.joint(name).qposadr[0] for name in info.object_joints])
        self._object_v = np.array([model.joint(name).dofadr[0] for name in info.object_joints])
        self._body = model.body(info.object_body).id
        self._pair = model.pair(info.object_pair).id
        self._striker_pairs = striker_pairs(model, scene)
        self._start = np.array(info.start)
        self._same_everywhere = not any(map(len, self._ground))

    @cached_property
    def _batch(self) -> Batch:
        return Batch(self.model, nsim=BATCH_SIZE, nthread=self._cores)

    @cached_property
    def _qpos(self) -> Array:
        return self._batch.bind("qpos")

    @cached_property
    def _qvel(self) -> Array:
        return self._batch.bind("qvel")

    def reset(self, mass: Array, friction: Array, speed: Sequence[float]) -> None:
        """Prepare the first rows.

        Args:
            mass: (rows,) kg, of the objects.
            friction: (rows, 3) along x and along y, and torsional in m.
            speed: m/s, of the striker where it reaches the object; for contacts that depend on it.
        """
        batch, model, rows = self._batch, self.model, np.arange(len(mass))
        self._mass, self._friction = mass, friction
        self._hardest = np.zeros(len(mass))
        scale = mass / model.body_mass[self._body]
        batch.expand("body_mass")[rows, self._body] = model.body_mass[self._body] * scale
        inertia = model.body_inertia[self._body] * scale[:, None]
        batch.expand("body_inertia")[rows, self._body] = inertia
        batch.set_const(ids=rows)  # updates the subtree masses that gravity acts on
        if self._rig.bounces:
            solref = batch.expand("pair_solref")
            for i, pair in np.ndindex(len(mass), len(self._striker_pairs)):
                contact = self._striker_pairs[pair]
                solref[i, contact] = self._rig.bounce(model.pair_solref[contact], speed[i])
        batch.reset(ids=rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._felt = np.zeros(len(mass), bool)

    def place(self, arm: Array, start_error: Array, yaw: Array) -> None:
        """Set the first rows' state at rest: (rows, joints) rad, (rows, 2) m and (rows,) rad of objects."""
        rows = np.arange(len(arm))
        self._qpos[rows[:, None], self._arm] = arm
        self._qpos[rows[:, None], self._object_q[:2]] = start_error
        self._qpos[rows, self._object_q[3]] = yaw

    def take_over(self, rows: Rows, other: "RigBatch") -> None:
        """Go on from another batch's state of these rows; joints that only this model has stay at rest."""
        for name in (self.model.joint(i).name for i in range(self.model.njnt)):
            if mujoco.mj_name2id(other.model, mujoco.mjtObj.mjOBJ_JOINT, name) < 0:
                continue
            here, there = self.model.joint(name), other.model.joint(name)
            self._qpos[rows, here.qposadr[0]] = other._qpos[rows, there.qposadr[0]]
            self._qvel[rows, here.dofadr[0]] = other._qvel[rows, there.dofadr[0]]

    def step(self, rows: Rows, targets: Array, now: float) -> None:
        """Simulate one control period from `now` (s) on, with servo targets (rows, joints) in rad."""
        self._batch.bind("ctrl")[rows, : targets.shape[1]] = targets
        if not (self._same_everywhere and self._felt[rows].all()):
            self._feel(rows, now)
        self._batch.step(ids=rows, nstep=self._substeps)

    def joints(self, rows: Rows) -> Array:
        """(rows, joints) positions in rad."""
        return self._qpos[rows[:, None], self._arm]

    def states(self, rows: Rows) -> Array:
        """(rows, 6) x, y (m, world frame), yaw (rad), vx, vy (m/s), spin (rad/s) of objects."""
        columns = rows[:, None]
        state = np.concatenate(
            [self._qpos[columns, self._object_q[_PLANAR]], self._qvel[columns, self._object_v[_PLANAR]]],
            axis=1,
        )
        state[:, :2] += self._start
        return state

    def released(self, rows: Rows) -> Array:
        """`states` of objects from which on they slide: the same once what is left of a hop has ended.

        An object that rises at w is pressed on the board by m w less until it lies on it, and one that falls
        by as much more; that takes a few milliseconds, in which it loses mu w of its speed less or more.
        """
        states = self.states(rows)
        speed = np.linalg.norm(states[:, 3:5], axis=1, keepdims=True)
        against = self._friction[rows, :2] * states[:, 3:5] / np.maximum(speed, MOVING)
        states[:, 3:5] += against * self._qvel[rows, self._object_v[2]][:, None]
        return states

    def slides(self, rows: Rows) -> NDArray[np.bool_]:
        """(rows,) whether objects have been hit and no longer hop."""
        height, rising = self._qpos[rows, self._object_q[2]], self._qvel[rows, self._object_v[2]]
        speed = np.linalg.norm(self._qvel[rows[:, None], self._object_v[:2]], axis=1)
        return (np.abs(height) <= FLAT) & (np.abs(rising) <= LEVEL) & (speed >= MOVING)

    def hardest(self, row: int) -> float:
        """Largest deceleration of the object, m/s^2, where it was at the start of the last step."""
        return float(self._hardest[row])

    def _feel(self, rows: Rows, now: float) -> None:
        """Apply the local surface forces to objects."""
        states, friction = self.states(rows), self._friction[rows]
        mean = np.sqrt(friction[:, 0] * friction[:, 1])
        forces, factors = np.empty((len(rows), 4)), np.empty((len(rows), 2))
        feel(self._ground, states, np.full(len(rows), now), mean, forces, factors)
        mass = self._mass[rows, None]
        applied = -mass * GRAVITY * forces[:, :2] + mass * forces[:, 2:]
        qfrc = self._batch.bind("qfrc_applied")
        qfrc[rows[:, None], self._object_v[:2]] = applied
        if len(self._ground.centres):  # body forces act on the centre of mass
            yaw, (out_x, out_y, _) = states[:, 2], self._ground.centres[0]
            ox = np.cos(yaw) * out_x - np.sin(yaw) * out_y
            oy = np.sin(yaw) * out_x + np.cos(yaw) * out_y
            qfrc[rows, self._object_v[3]] = ox * applied[:, 1] - oy * applied[:, 0]
        pair = self._batch.expand("pair_friction")
        along = friction * np.exp(factors[:, :1]) * factors[:, 1:]
        # Tangent 1 of a horizontal contact is the world's y axis.
        pair[rows, self._pair, :3] = along[:, [1, 0, 2]]
        pair[rows, self._pair, 3:] = _ROLLING
        hardest = GRAVITY * friction[:, :2].max(1) * factors[:, 1]
        self._hardest[rows] = hardest + np.hypot(forces[:, 2], forces[:, 3])
        self._felt[rows] = True
