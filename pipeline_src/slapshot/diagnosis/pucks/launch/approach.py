"""The arm by itself, until it comes near the object: without contacts, and shared by what leaves it alone.

Effects of the contact, of the object and of the camera do not change how the arm comes to the object, so that
one approach serves all of them.
"""

import hashlib
import xml.etree.ElementTree as ElementTree
from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.scenes.scene import SceneInfo

NEAR = 0.03  # m between striker and object, from where on both are simulated together
SAME_START = 0.01  # m by which objects may lie elsewhere without the arm touching them in the meantime
_KEPT = 6  # approaches: what is compared with each other
_SETTLED = 0.3  # s, ten times the time constant of MuJoCo's contacts
_AWAY = np.array([0.0, 0.0, -9.0, 0.0])  # m and rad: where an object that slides away is put


@dataclass(frozen=True)
class Approach:
    """How n arms come near their objects.

    Attributes:
        starts: (n, 2) m, of the objects.
        ticks: (n,) control periods after which the striker is NEAR; those of the whole command where it never
            is.
        states: (n, s) integration states then, see `mujoco.mjtState`.
        joints: (n, ticks, joints) rad, of the arm, as far as it came.
    """

    starts: Array
    ticks: NDArray[np.int64]
    states: Array
    joints: Array


class Arm:
    """n arms that nothing touches.

    Attributes:
        batch: of a model whose objects feel no plane and wait where they are put.
        joints: addresses of the arm's joints in qpos.
    """

    def __init__(self, model: mujoco.MjModel, info: SceneInfo, count: int, threads: int) -> None:
        alone = copy(model)
        floor = alone.pair(info.object_pair).id
        others = np.arange(alone.npair) != floor
        alone.pair_margin[floor] = -1.0
        alone.pair_gap[others] = np.maximum(alone.pair_gap[others], NEAR - alone.pair_margin[others])
        self.batch = Batch(alone, nsim=count, nthread=threads)
        self.joints = np.array([model.joint(j).qposadr[0] for j in info.joints])
        self._object_q = np.array([model.joint(j).qposadr[0] for j in info.object_joints])
        self._object_v = np.array([model.joint(j).dofadr[0] for j in info.object_joints])
        self._substeps = round(info.control_period / model.opt.timestep)

    def step(self, running: NDArray[np.int64], targets: Array, resting: Array) -> None:
        """One control period of some arms.

        Args:
            running: (k,) of them.
            targets: (n, joints) rad.
            resting: (k, 4) or (4,), x, y, z in m and yaw in rad of the joints of their objects.
        """
        self.batch.bind("ctrl")[:, : targets.shape[1]] = targets
        self.batch.bind("qpos")[running[:, None], self._object_q] = resting
        self.batch.bind("qvel")[running[:, None], self._object_v] = 0.0
        self.batch.step(ids=running, nstep=self._substeps)


@dataclass(frozen=True)
class CommandedArms:
    """n arms with their commands, each before an object.

    Attributes:
        model: of arm and object.
        info: of the scene.
        targets: (n, ticks, joints) rad; the last is held.
        poses: (n, joints) rad, at first.
        starts: (n, 2) m, where objects lie.
        threads: for MuJoCo.
    """

    model: mujoco.MjModel
    info: SceneInfo
    targets: Array
    poses: Array
    starts: Array
    threads: int

    def digest(self, arm: str) -> str:
        """The same for commands and `arm`s (see `digest_of_arm`) that move alike."""
        return arm + hashlib.sha256(self.targets.tobytes() + self.poses.tobytes()).hexdigest()

    def approach(self) -> Approach:
        """Move the arms until they are near their objects."""
        info, (count, ticks) = self.info, self.targets.shape[:2]
        arm = Arm(self.model, info, count, self.threads)
        everywhere = np.arange(count)
        arm.batch.reset(ids=everywhere, stage=mujoco.mjtStage.mjSTAGE_NONE)
        qpos, contacts = arm.batch.bind("qpos"), arm.batch.bind("ncon")
        qpos[:, arm.joints] = self.poses
        resting = np.zeros((count, 4))
        resting[:, :2] = self.starts - np.array(info.start)
        resting[:, 2] = resting_height(self.model, info)
        joints = np.zeros((count, ticks, len(arm.joints)))
        near, states = np.full(count, ticks - 1), np.empty_like(arm.batch.state)
        running = everywhere
        for tick in range(ticks):
            joints[running, tick] = qpos[running[:, None], arm.joints]
            # Seen one integration step late, which NEAR allows for.
            arrived = contacts[running] > 0 if tick else np.zeros(count, bool)
            if tick == ticks - 1:
                arrived[:] = True
            now = running[arrived]
            near[now], states[now] = tick, arm.batch.state[now]
            running = running[~arrived]
            if not len(running):
                break
            arm.step(running, self.targets[:, tick], resting[running])
        return Approach(self.starts, near, states, joints)

    def withdraw(
        self, states: Array, since: NDArray[np.int64], readings: NDArray[np.int64], joints: Array
    ) -> None:
        """Go on with the arms, whose objects slide away, until joints were looked at.

        Args:
            states: (n, s) integration states after `since` ticks.
            since: (n,) ticks.
            readings: (m,) ticks.
            joints: (n, m, joints) rad, filled from then on.
        """
        last = int(readings.max(initial=0))
        going = np.flatnonzero(since < last)
        if not len(going):
            return
        arm = Arm(self.model, self.info, len(since), self.threads)
        arm.batch.state[:] = states
        qpos, column = arm.batch.bind("qpos"), {int(tick): k for k, tick in enumerate(readings)}
        for tick in range(int(since[going].min()), last):
            running = going[since[going] <= tick]
            arm.step(running, self.targets[:, min(tick, self.targets.shape[1] - 1)], _AWAY)
            if tick + 1 in column:
                joints[running, column[tick + 1]] = qpos[running[:, None], arm.joints]


def resting_height(model: mujoco.MjModel, info: SceneInfo) -> float:
    """Height in m above its place in the model at which the object comes to rest on the plane."""
    alone = copy(model)
    others = np.arange(alone.npair) != alone.pair(info.object_pair).id
    alone.pair_margin[others] = -1.0
    data = mujoco.MjData(alone)
    mujoco.mj_step(alone, data, round(_SETTLED / alone.opt.timestep))
    return float(data.qpos[alone.joint(info.object_joints[2]).qposadr[0]])


def digest_of_arm(spec: mujoco.MjSpec, info: SceneInfo) -> str:
    """The same for compiled specifications of which arms that touch nothing move alike."""
    root = ElementTree.fromstring(spec.to_xml())
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag == "pair" or (child.tag == "body" and child.get("name") == info.object_body):
                parent.remove(child)
    return hashlib.sha256(ElementTree.tostring(root)).hexdigest()


class Approaches:
    """Those that were made last, for models with which arms move alike."""

    def __init__(self) -> None:
        self._made: dict[str, Approach] = {}

    def get(self, arm: str, arms: CommandedArms) -> Approach:
        """One that was made already, where it holds for where objects lie now.

        Args:
            arm: see `digest_of_arm`.
            arms: to move, where it does not.
        """
        digest = arms.digest(arm)
        known = self._made.pop(digest, None)
        if known is None or np.abs(known.starts - arms.starts).max() > SAME_START:
            known = arms.approach()
        self._made[digest] = known
        while len(self._made) > _KEPT:
            self._made.pop(next(iter(self._made)))
        return known
