"""A session on FetchSlide's robot: the environment's own step, with hidden effects.

A command asks for a velocity of the gripper; the environment puts its mocap body as far ahead of where the
gripper is, and a weld drags the gripper after it. The recorded command is the mocap body's pose. A test
compares the lab's steps with those of the environment.
"""

from functools import cache

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.config.scene import SceneSettings
from slapshot.domains.fetchslide.model import FINGER_JOINTS, GRIPPER, STEP
from slapshot.lab.joints.execution import Execution

_TOWARDS = np.array([1.0, 0.0, 1.0, 0.0])  # added to the gripper's quaternion, as the environment does
_LEAVES = 0.6  # share of the time before an episode in which the gripper leaves its start


class GripperExecution(Execution):
    """Of one position, on a robot that is dragged by its gripper."""

    def begin(self) -> None:
        """As the environment's reset does; an encoder's zero that is off moves no link."""
        batch, names = self.batch, [self.model.joint(i).name for i in range(self.model.njnt)]
        nominal = mujoco.MjModel.from_xml_string(self.rig.xml)
        start = reset_state()
        for i, name in enumerate(names):
            off = self.model.qpos0[i] - nominal.qpos0[nominal.joint(name).qposadr[0]]
            self.qpos[:, i], self.qvel[:, i] = start[name][0] + off, start[name][1]
        self._body = self.model.body(GRIPPER).id
        self._fingers = [self.model.joint(name).qposadr[0] for name in FINGER_JOINTS]
        self._mocap_pos, self._mocap_quat = batch.bind("mocap_pos"), batch.bind("mocap_quat")
        self._xpos, self._xquat = batch.bind("xpos"), batch.bind("xquat")
        self._watched = self.model.site(str(self.rig.site)).id

    def observed(self) -> Array:
        """(episodes, observed): joints (rad), and the site's place (m) where the last step began."""
        return np.concatenate([self.qpos[:, self.dofs], self.site[:, self._watched]], axis=1)

    def command(self, tick: int) -> Array:
        """Put the mocap body ahead of the gripper; its pose (episodes, 7)."""
        settling = round(self.rig.settle / self.rig.clock.period)
        leaves = tick < -(1 - _LEAVES) * settling
        requested = self.excitation.wave[:, max(tick, 0)] if tick >= 0 else self.excitation.centre * leaves
        self._mocap_pos[:, 0] = self._xpos[:, self._body] + STEP * np.clip(requested, -1, 1)
        # MuJoCo would normalise it anyway.
        turned = self._xquat[:, self._body] + _TOWARDS
        self._mocap_quat[:, 0] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        return np.concatenate([self._mocap_pos[:, 0], self._mocap_quat[:, 0]], axis=1)

    def actuate(self, command: Array, position: Array, velocity: Array) -> Array:
        """Nothing: joints have no actuators."""
        return np.zeros_like(position)

    def step(self) -> None:
        """MuJoCo's own, with places that are those of the new state."""
        self.batch.step(stage=mujoco.mjtStage.mjSTAGE_POS)

    def end_period(self) -> None:
        """The environment keeps fingers closed."""
        self.qpos[:, self._fingers] = 0
        self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)


@cache
def reset_state() -> dict[str, tuple[float, float]]:
    """Joint -> position (rad, m) and velocity after the environment's reset."""
    from slapshot.domains.fetchslide import build_scene
    from slapshot.domains.fetchslide.gripper import prepare

    model = build_scene(SceneSettings(domain="fetchslide")).compile()
    positions, velocities = prepare(model)
    return {
        model.joint(i).name: (positions[model.jnt_qposadr[i]], velocities[model.jnt_dofadr[i]])
        for i in range(model.njnt)
    }
