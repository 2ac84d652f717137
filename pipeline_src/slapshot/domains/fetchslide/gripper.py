"""Steps many FetchSlide robots at once, commanded as in the environment.

In a control period, `MujocoFetchSlideEnv.step` resets the mocap body to the gripper's pose, moves it by 0.05
m times the command, rotates it towards (1, 0, 1, 0), and simulates twenty steps; the fingers are closed.
"""

from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.domains.fetchslide.model import (
    FINGER_JOINTS,
    GRIPPER,
    MOCAP,
    OBJECT,
    OBJECT_JOINT,
    STEP,
    SUBSTEPS,
    TABLE,
)
from slapshot.scenes.scene import Scene

Rows = NDArray[np.int64]

_TOWARDS = np.array([1.0, 0.0, 1.0, 0.0])  # added to the gripper's quaternion, as the environment does
# The environment's own initial state (its initial_qpos and _env_setup, including gripper_extra_height).
_BASE = {"robot0:slide0": 0.05, "robot0:slide1": 0.48, "robot0:slide2": 0.0}
_FIRST_MOVE = np.array([-0.498, 0.005, -0.431 - 0.02])  # m
_FIRST_PERIODS = 10
_BASE_BODY, _ARM = "robot0:base_link", "robot0:shoulder_pan_link"
PUCK_HOME = np.array([1.7, 1.1, 0.41])  # m, position of the puck during the set-up


def prepare(model: mujoco.MjModel) -> tuple[Array, Array]:
    """Set the data of the weld constraint as the environment does, and return the state after its reset.

    Returns:
        qpos (nq,) and qvel (nv,); not at rest, as at the start of the environment's episodes.
    """
    data = mujoco.MjData(model)
    for name, value in _BASE.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    puck = model.joint(OBJECT_JOINT).qposadr[0]
    data.qpos[puck : puck + 7] = [*PUCK_HOME, 1, 0, 0, 0]
    model.eq_data[:, :7] = [0, 0, 0, 0, 0, 0, 1]
    mujoco.mj_forward(model, data)
    data.mocap_pos[0] = data.site("robot0:grip").xpos + _FIRST_MOVE
    data.mocap_quat[0] = _TOWARDS
    for _ in range(_FIRST_PERIODS):
        mujoco.mj_step(model, data, SUBSTEPS)
    return data.qpos.copy(), data.qvel.copy()


class Grippers:
    """Simulates up to `size` robots, each with a puck on its table."""

    def __init__(self, scene: Scene, size: int, threads: int) -> None:
        self._model = _without_idle_geoms(scene.compile())
        self._qpos0, self._qvel0 = prepare(self._model)
        self._batch = Batch(self._model, nsim=size, nthread=threads)
        self._friction = self._batch.expand("geom_friction")
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._mocap_pos, self._mocap_quat = self._batch.bind("mocap_pos"), self._batch.bind("mocap_quat")
        self._xpos, self._xquat = self._batch.bind("xpos"), self._batch.bind("xquat")
        self._site = self._batch.bind("site_xpos")
        model = self._model
        self._gripper, self._mocap = model.body(GRIPPER).id, model.body_mocapid[model.body(MOCAP).id]
        self._grip = model.site(scene.info.striker_site).id
        self._fingers = [model.joint(name).qposadr[0] for name in FINGER_JOINTS]
        self._arm_q, self._arm_v = scene.layout.arm_q, scene.layout.arm_v

    @cached_property
    def _puck_q(self) -> Rows:
        return self._model.joint(OBJECT_JOINT).qposadr[0] + np.arange(7)

    @cached_property
    def _puck_v(self) -> Rows:
        return self._model.joint(OBJECT_JOINT).dofadr[0] + np.arange(6)

    def reset(self, ids: Rows, places: Array, friction: Array) -> None:
        """Reset robots as the environment does, with pucks at `places`.

        Args:
            ids: ids of the robots.
            places: (ids, 2) positions of their pucks in m.
            friction: (ids, 3) linear, torsional and rolling friction of puck and table.
        """
        self._batch.reset(ids=ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[ids], self._qvel[ids] = self._qpos0, self._qvel0
        self._qpos[np.ix_(ids, self._puck_q[:2])] = places
        for name in (OBJECT, TABLE):
            self._friction[ids, self._model.geom(name).id] = friction
        self._batch.forward(ids=ids, stage=mujoco.mjtStage.mjSTAGE_POS)

    def restore(self, ids: Rows, positions: Array, velocities: Array) -> None:
        """Restore a state of the robots' joints (ids, joints) that `joints` returned."""
        self._qpos[np.ix_(ids, self._arm_q)], self._qvel[np.ix_(ids, self._arm_v)] = positions, velocities
        self._batch.forward(ids=ids, stage=mujoco.mjtStage.mjSTAGE_POS)

    def command(self, ids: Rows, commands: Array) -> None:
        """Simulate a control period with commands (ids, 3)."""
        self._mocap_pos[ids, self._mocap] = self._xpos[ids, self._gripper] + STEP * commands
        self._mocap_quat[ids, self._mocap] = self._xquat[ids, self._gripper] + _TOWARDS
        self._batch.step(ids=ids, nstep=SUBSTEPS, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[np.ix_(ids, self._fingers)] = 0
        self._batch.forward(ids=ids, stage=mujoco.mjtStage.mjSTAGE_POS)

    def joints(self, ids: Rows) -> tuple[Array, Array]:
        """Joint positions and velocities, (ids, joints) each."""
        return self._qpos[np.ix_(ids, self._arm_q)], self._qvel[np.ix_(ids, self._arm_v)]

    def grip(self, ids: Rows) -> Array:
        """(ids, 3) m, position of the site between the fingers."""
        return self._site[ids, self._grip].copy()

    def pucks(self, ids: Rows) -> tuple[Array, Array]:
        """Pose (ids, 7) and velocity (ids, 6) of the pucks, in MuJoCo's convention for a free joint."""
        return self._qpos[np.ix_(ids, self._puck_q)], self._qvel[np.ix_(ids, self._puck_v)]


def _without_idle_geoms(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model without contacts of geoms that touch nothing: of the robot, all but base, arm and gripper.

    Looking for contacts among them is a tenth of a step. The base stays: it stands on the floor.
    """
    arm = {model.body(_ARM).id}
    for body in range(model.nbody):  # parents come first
        if model.body_parentid[body] in arm:
            arm.add(body)
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        name = model.body(body).name
        if name.startswith("robot0:") and name != _BASE_BODY and body not in arm:
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
    return model
